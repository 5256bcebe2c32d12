import numpy as np
import pytest
from numpy.random import default_rng

from hadr.camera import Intrinsics
from hadr.corruption import (
    ANALYTIC,
    BACKGROUND_SHARE,
    MISSING_SHARE,
    SENSOR,
    CorruptionConfig,
    corrupt,
    depth_jumps,
    edge_noise,
    ellipse_dropout,
    erase_mask,
    see_through,
    smooth_noise,
    stereo_noise,
)
from hadr.figures.depth.corruption_examples import corruption_statistics
from hadr.frame_io import read_depth, read_mask

CAMERA = Intrinsics(fx=640.0, fy=640.0, cx=79.5, cy=59.5, width=160, height=120)


def plane(z: float) -> np.ndarray:
    return np.full((120, 160), z, np.float32)


def disc(radius: float = 30.0) -> np.ndarray:
    v, u = np.indices((120, 160))
    return (u - 80) ** 2 + (v - 60) ** 2 <= radius**2


def two_steps() -> np.ndarray:
    depth = plane(1.0)
    depth[:, :80] = 0.5
    return depth


def test_erase_mask_changes_exactly_the_mask() -> None:
    depth, mask = two_steps(), disc()
    erased = erase_mask(depth, mask)
    np.testing.assert_array_equal(erased[~mask], depth[~mask])
    assert (erased[mask] == 0).all()
    assert (depth > 0).all(), "the input must stay as it was"


def test_see_through_has_the_asked_shares_and_the_backgrounds_depth() -> None:
    depth, background, mask = plane(0.5), plane(0.9), disc()
    seen = see_through(
        depth, background, mask, default_rng(0), missing_share=0.3, background_share=0.5
    )
    inside = seen[mask]
    n = inside.size
    assert (inside == 0).sum() == round(0.3 * n)
    assert (inside == np.float32(0.9)).sum() == round(0.8 * n) - round(0.3 * n)
    assert (inside == np.float32(0.5)).sum() == n - round(0.8 * n)
    np.testing.assert_array_equal(seen[~mask], depth[~mask])


def test_depth_is_quantised_to_whole_steps_of_disparity() -> None:
    """f b / z = 640 * 0.05 / 0.8 = 40 pixels."""
    rng = default_rng(0)
    measured = stereo_noise(
        plane(0.8), CAMERA, rng, baseline_m=0.05, disparity_std=0, disparity_step=3.0
    )
    np.testing.assert_allclose(measured, 32 / 39, rtol=1e-6)  # round(40 / 3) * 3 = 39


@pytest.mark.parametrize("z", [0.4, 0.8, 1.6])
def test_noise_grows_with_the_square_of_the_distance(z: float) -> None:
    measured = stereo_noise(
        plane(z), CAMERA, default_rng(3), baseline_m=0.055, disparity_step=0, disparity_std=0.1
    )
    expected = z**2 / (CAMERA.fx * 0.055) * 0.1
    assert measured.std() == pytest.approx(expected, rel=0.03)
    assert np.median(measured) == pytest.approx(z, abs=0.02 * expected)


def test_stereo_keeps_missing_pixels_and_refuses_nonsense() -> None:
    depth = plane(0.8)
    depth[:10] = 0
    measured = stereo_noise(depth, CAMERA, default_rng(0))
    assert (measured[:10] == 0).all()
    assert (measured[10:] > 0).all()
    with pytest.raises(ValueError, match=r"baseline_m must be positive.*got -0.1"):
        stereo_noise(depth, CAMERA, default_rng(0), baseline_m=-0.1)


def test_one_ellipse_has_the_area_of_an_ellipse() -> None:
    """Gamma(10^6, a / 10^6) is a to a thousandth, so a circle of radius a: pi a^2 pixels."""
    counts = []
    for seed in range(40):
        dropped = ellipse_dropout(
            np.ones((400, 400), np.float32),
            None,
            default_rng(seed),
            probability=1.0,
            mean_count=1.0,
            radius_shape=1e6,
            radius_scale=20e-6,
        )
        counts.append((dropped == 0).sum())
    largest_single = [c for c in counts if 0 < c <= 1300]
    assert max(largest_single) == pytest.approx(np.pi * 20**2, rel=0.02)


def test_ellipses_erase_only_inside_the_mask_and_mostly_with_the_probability() -> None:
    depth, mask = plane(0.7), disc()
    touched = 0
    for seed in range(200):
        dropped = ellipse_dropout(depth, mask, default_rng(seed))
        np.testing.assert_array_equal(dropped[~mask], depth[~mask])
        touched += bool((dropped == 0).any())
    assert touched == pytest.approx(0.8 * 200, abs=3 * np.sqrt(200 * 0.8 * 0.2))


def test_ellipse_count_is_poisson_20_by_default() -> None:
    """Tiny ellipses on a huge image hardly overlap: holes per picture have mean 20."""
    holes = [
        (
            ellipse_dropout(
                np.ones((500, 500), np.float32),
                None,
                default_rng(seed),
                probability=1.0,
                radius_shape=1e6,
                radius_scale=0.6e-6,
            )
            == 0
        ).sum()
        for seed in range(100)
    ]
    assert np.mean(holes) == pytest.approx(20, abs=3 * np.sqrt(20 / 100))


def test_edge_noise_leaves_a_plane_and_missing_pixels_alone() -> None:
    depth = plane(0.8)
    depth[40:50, 40:50] = 0
    np.testing.assert_array_equal(edge_noise(depth, default_rng(0)), depth)


def test_edge_noise_touches_only_the_band_and_stays_between_both_surfaces() -> None:
    depth = two_steps()
    noisy = edge_noise(depth, default_rng(0), width_px=2, flying_share=0.5)
    changed = noisy != depth
    columns = np.flatnonzero(changed.any(axis=0))
    assert columns.min() >= 78
    assert columns.max() <= 81
    assert noisy.min() >= 0.5
    assert noisy.max() <= 1.0
    flying = (noisy > 0.5) & (noisy < 1.0)
    band = 4 * 120
    assert flying.sum() == pytest.approx(0.5 * band, abs=3 * np.sqrt(band * 0.25))
    assert noisy[flying].mean() == pytest.approx(0.75, abs=0.05)


def test_depth_jumps_marks_both_sides_of_a_step() -> None:
    jumps = depth_jumps(two_steps(), jump_m=0.02, width_px=1)
    assert np.flatnonzero(jumps.any(axis=0)).tolist() == [79, 80]
    assert not depth_jumps(two_steps(), jump_m=0.6).any()


def test_corrupt_is_the_oracle_by_default_keeps_its_order_and_repeats_with_the_seed() -> None:
    depth, mask = two_steps(), disc()
    oracle = corrupt(depth, mask, CAMERA, default_rng(0))
    np.testing.assert_array_equal(oracle, erase_mask(depth, mask))
    first, again, other = (
        corrupt(depth, mask, CAMERA, default_rng(seed), ANALYTIC, plane(1.3)) for seed in (5, 5, 6)
    )
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()
    rng = default_rng(5)
    seen = see_through(depth, plane(1.3), mask, rng)
    np.testing.assert_array_equal(first, edge_noise(stereo_noise(seen, CAMERA, rng), rng))
    everything = CorruptionConfig(erase=True, see_through=True, stereo=True, edges=True)
    erased = corrupt(depth, mask, CAMERA, default_rng(0), everything, plane(1.3))
    assert (erased[mask] == 0).all()


def test_a_captured_depth_replaces_the_true_one() -> None:
    depth, mask = two_steps(), disc()
    raw = np.full_like(depth, 0.7)
    raw[:5], raw[5:9] = np.nan, -1.0
    taken = corrupt(depth, mask, CAMERA, default_rng(0), SENSOR, raw_depth=raw)
    assert (taken[:9] == 0).all()
    assert (taken[9:] == np.float32(0.7)).all()
    assert taken.dtype == np.float32
    with pytest.raises(ValueError, match="captured needs raw_depth"):
        corrupt(depth, mask, CAMERA, default_rng(0), SENSOR)
    with pytest.raises(ValueError, match=r"depth and raw_depth .* got \(120, 160\) and \(2, 2\)"):
        corrupt(depth, mask, CAMERA, default_rng(0), SENSOR, raw_depth=np.ones((2, 2)))


def test_the_default_shares_are_the_real_ones(realdata) -> None:
    """Missing, and more than 1 cm behind: the mean of two real frames, each counting once."""
    shares = []
    for scene in ("000000080", "000000130"):
        folder = realdata / "cleargrasp_d435"
        raw = np.nan_to_num(read_depth(folder / f"{scene}-transparent-depth-img.exr"))
        truth = np.nan_to_num(read_depth(folder / f"{scene}-opaque-depth-img.exr"))
        known = read_mask(folder / f"{scene}-mask.png") & (truth > 0)
        seen = known & (raw > 0)
        behind = seen & (raw - truth > 0.01)
        shares.append((1 - seen.sum() / known.sum(), behind.sum() / known.sum()))
    missing, background = np.mean(shares, axis=0)
    assert pytest.approx(missing, abs=0.01) == MISSING_SHARE
    assert pytest.approx(background, abs=0.01) == BACKGROUND_SHARE


def test_statistics_of_a_hand_made_picture() -> None:
    truth = plane(0.5)
    mask = np.zeros_like(truth, bool)
    mask[0, :10] = True
    measured = truth.copy()
    measured[0, :4] = (0, np.nan, 0, 0)
    measured[0, 4:8] = (0.53, 0.54, 0.55, 0.505)
    truth[0, 9] = np.nan
    found = corruption_statistics(measured, truth, mask)
    assert found.pixels == 9
    assert found.missing_share == pytest.approx(4 / 9)
    assert found.bias_m == pytest.approx(0.03)  # the median of 3, 4, 5, 0.5 and 0 cm
    assert found.within_1cm_share == pytest.approx(2 / 9)


def test_errors_name_the_values() -> None:
    depth, mask = plane(0.5), disc()
    with pytest.raises(ValueError, match=r"depth and mask .* got \(120, 160\) and \(3, 3\)"):
        erase_mask(depth, np.ones((3, 3), bool))
    with pytest.raises(ValueError, match=r"depth must be float metres, got uint16"):
        erase_mask(np.full(mask.shape, 500, np.uint16), mask)
    with pytest.raises(ValueError, match=r"at most 1, got 0.7 and 0.6"):
        see_through(depth, depth, mask, default_rng(0), missing_share=0.7, background_share=0.6)
    with pytest.raises(ValueError, match="see_through needs background_depth"):
        corrupt(depth, mask, CAMERA, default_rng(0), ANALYTIC)


def test_smooth_noise_is_standardised_and_smooth() -> None:
    noise = smooth_noise((200, 200), 4.0, default_rng(0))
    assert noise.mean() == pytest.approx(0, abs=1e-12)
    assert noise.std() == pytest.approx(1)
    neighbours = (noise[:, 1:] * noise[:, :-1]).mean()
    assert neighbours == pytest.approx(np.exp(-1 / (4 * 4.0**2)), abs=0.005)
