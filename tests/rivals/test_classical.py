import cv2
import numpy as np
import pytest

from hadr.rivals.classical import hand_median, hand_region, inpaint, nearest_valid, raw


def ramp() -> np.ndarray:
    """Depth 0.50 m in column 0, 1 cm deeper each column."""
    return np.tile(0.5 + 0.01 * np.arange(40, dtype=np.float32), (30, 1))


def hole(columns: slice = slice(15, 25)) -> np.ndarray:
    mask = np.zeros((30, 40), bool)
    mask[:, columns] = True
    return mask


def test_raw_only_turns_nan_into_missing() -> None:
    depth = ramp()
    depth[0, 0] = np.nan
    left = raw(depth, hole())
    assert left[0, 0] == 0
    np.testing.assert_array_equal(left.ravel()[1:], depth.ravel()[1:])


def test_nearest_takes_the_closer_side_and_never_what_the_mask_held() -> None:
    depth, mask = ramp(), hole()
    depth[mask] = 3.0
    filled = nearest_valid(depth, mask)
    np.testing.assert_allclose(filled[:, 15:20], 0.64, atol=1e-6)  # column 14
    np.testing.assert_allclose(filled[:, 20:25], 0.75, atol=1e-6)  # column 25
    np.testing.assert_array_equal(filled[~mask], depth[~mask])
    assert (depth[mask] == 3.0).all(), "the input must stay as it was"


def test_nearest_skips_missing_pixels_outside_the_mask() -> None:
    depth, mask = ramp(), hole()
    depth[:, 14] = 0
    depth[:, 25] = np.nan
    filled = nearest_valid(depth, mask)
    np.testing.assert_allclose(filled[:, 15], 0.63, atol=1e-6)  # column 13
    np.testing.assert_allclose(filled[:, 24], 0.76, atol=1e-6)  # column 26
    assert (filled[:, [14, 25]] == 0).all()


def test_inpainting_a_plane_keeps_it_even_beside_missing_pixels() -> None:
    depth, mask = np.full((60, 80), 0.7234, np.float32), np.zeros((60, 80), bool)
    mask[20:40, 30:50] = True
    depth[18:42, 28:30] = 0
    filled = inpaint(depth, mask)
    np.testing.assert_allclose(filled[mask], 0.7234, atol=5.01e-4)
    assert (filled[18:42, 28:30] == 0).all(), "only the mask's pixels are restored"


def test_inpainting_deep_scenes_uses_millimetres() -> None:
    depth, mask = np.full((30, 40), 9.0, np.float32), hole()
    np.testing.assert_allclose(inpaint(depth, mask)[mask], 9.0, atol=5.01e-3)


def test_inpainting_equals_opencv_on_the_whole_image() -> None:
    rng = np.random.default_rng(0)
    depth = cv2.GaussianBlur(rng.random((120, 160)).astype(np.float32), (0, 0), 6) + 0.5
    mask = np.zeros(depth.shape, bool)
    mask[50:70, 60:90] = True
    steps = np.rint(np.where(mask, 0, depth) / 1e-4).astype(np.uint16)
    whole = cv2.inpaint(steps, mask.astype(np.uint8), 3.0, cv2.INPAINT_TELEA) * 1e-4
    np.testing.assert_allclose(inpaint(depth, mask)[mask], whole[mask], atol=1e-6)


def square_hand() -> tuple[np.ndarray, np.ndarray]:
    """21 keypoints on the square (10..20, 5..15), all 0.6 m away."""
    uv = np.full((21, 2), 15.0)
    uv[:4] = [(10, 5), (20, 5), (20, 15), (10, 15)]
    return uv, np.full(21, 0.6)


def test_hand_region_is_the_convex_hull() -> None:
    uv, _ = square_hand()
    region = hand_region((30, 40), uv)
    expected = np.zeros((30, 40), bool)
    expected[5:16, 10:21] = True
    np.testing.assert_array_equal(region, expected)


def test_hand_median_leaves_out_the_forearm_and_the_glass() -> None:
    uv, z = square_hand()
    depth = np.full((30, 40), 1.5, np.float32)
    hand_mask = np.zeros((30, 40), bool)
    hand_mask[5:30, 10:21] = True
    depth[5:16, 10:21] = 0.62
    depth[16:30, 10:21] = 0.9  # the forearm: more pixels than the hand
    mask = np.zeros((30, 40), bool)
    mask[5:12, 12:19] = True
    depth[mask] = 2.0  # what the camera saw through the glass
    filled = hand_median(depth, mask, uv, z, hand_mask)
    np.testing.assert_allclose(filled[mask], 0.62, atol=1e-6)
    np.testing.assert_array_equal(filled[~mask], depth[~mask])
    without_hand_mask = hand_median(depth, mask, uv, z)
    np.testing.assert_allclose(without_hand_mask[mask], 0.62, atol=1e-6)


def test_hand_median_without_hand_mask_ignores_the_background_in_the_hull() -> None:
    uv, z = square_hand()
    depth = np.full((30, 40), 1.5, np.float32)
    depth[5:9, 10:21] = 0.61  # four of eleven rows are hand, the rest shows the wall
    mask = np.zeros((30, 40), bool)
    mask[20:25, 30:35] = True
    np.testing.assert_allclose(hand_median(depth, mask, uv, z)[mask], 0.61, atol=1e-6)


def test_hand_median_falls_back_to_the_keypoints() -> None:
    uv, z = square_hand()
    mask = np.ones((30, 40), bool)
    np.testing.assert_allclose(hand_median(ramp(), mask, uv, z), 0.6, atol=1e-6)


def test_errors_say_what_is_wrong() -> None:
    with pytest.raises(ValueError, match=r"mask \(H, W\) bool, got .* \(30, 40\) uint8"):
        nearest_valid(ramp(), hole().astype(np.uint8))
    with pytest.raises(ValueError, match="no pixel outside the mask has a depth"):
        nearest_valid(ramp(), np.ones((30, 40), bool))
    with pytest.raises(ValueError, match="no pixel outside the mask has a depth"):
        inpaint(np.zeros((30, 40), np.float32), hole())
    with pytest.raises(ValueError, match=r"keypoints_uv must be \(21, 2\).*\(20, 2\)"):
        hand_region((30, 40), np.zeros((20, 2)))


def test_an_empty_mask_changes_nothing() -> None:
    empty = np.zeros((30, 40), bool)
    np.testing.assert_array_equal(inpaint(ramp(), empty), ramp())
    np.testing.assert_array_equal(nearest_valid(ramp(), empty), ramp())
