import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hadr.camera import Intrinsics
from hadr.synthesis.depth_sensor.stereo_matching import STEPS, Matching, align_to_color, match

IMAGER = Intrinsics(100.0, 100.0, 10.0, 5.0, 21, 11)


def speckle_pair(disparity: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A smooth random picture and its copy moved left by a disparity, by Fourier's shift."""
    rng = np.random.default_rng(seed)
    scene = cv2.GaussianBlur(rng.normal(size=(80, 256)), (0, 0), 1.3)
    frequency = np.fft.fftfreq(256)
    moved = np.fft.ifft(np.fft.fft(scene, axis=1) * np.exp(2j * np.pi * frequency * disparity))
    scale = 40 / scene.std()
    left, right = (np.clip(128 + scale * image.real, 0, 255) for image in (scene, moved))
    return left.round().astype(np.uint8), right.round().astype(np.uint8)


@pytest.mark.parametrize("disparity", [12.0, 20.25, 33.5, 40.75])
def test_a_known_shift_is_found_to_a_small_part_of_a_pixel(disparity):
    found = match(*speckle_pair(disparity), Matching(disparities=64))
    inner = found[10:-10, 80:-20]
    assert (inner > 0).mean() > 0.98
    error = inner[inner > 0] - disparity
    assert abs(np.median(error)) < 0.05
    assert np.percentile(np.abs(error), 95) < 0.15
    np.testing.assert_array_equal(found * STEPS, np.rint(found * STEPS))


def test_without_refinement_the_disparity_is_the_semi_global_matchers():
    disparity = 20.3  # 9.6 sixteenths of a pixel beyond a whole one
    found = match(*speckle_pair(disparity), Matching(disparities=64, iterations=0))
    inner = found[10:-10, 80:-20]
    assert (inner > 0).mean() > 0.98
    assert np.abs(inner[inner > 0] - disparity).max() < 0.5
    np.testing.assert_array_equal(found * 16, np.rint(found * 16))  # its steps are coarser


def test_pictures_that_have_nothing_in_common_do_not_match():
    left, _ = speckle_pair(20.0, seed=1)
    _, right = speckle_pair(20.0, seed=2)
    assert (match(left, right, Matching(disparities=64)) > 0).mean() < 0.02


def test_a_picture_without_texture_does_not_match():
    rng = np.random.default_rng(0)
    left, right = (
        np.clip(np.rint(120 + 1.0 * rng.normal(size=(80, 256))), 0, 255).astype(np.uint8)
        for _ in range(2)
    )
    assert (match(left, right, Matching(disparities=64)) > 0).mean() < 0.02


def test_pictures_of_two_shapes_or_types_are_refused():
    left, right = speckle_pair(20.0)
    with pytest.raises(ValueError, match=r"got \(80, 256\) uint8 and \(80, 255\) uint8"):
        match(left, right[:, 1:], Matching())
    with pytest.raises(ValueError, match="float64"):
        match(left.astype(float), right.astype(float), Matching())


def test_one_depth_pixel_lands_where_geometry_says():
    """The imager stands 0.1 m to the right, so its picture of a point lies further left."""
    depth = np.zeros(IMAGER.shape, np.float32)
    depth[5, 8] = 2.0  # X = (8 - 10) / 100 * 2 = -0.04 in the imager's frame, 0.06 in colour's
    aligned = align_to_color(depth, IMAGER, IMAGER, 0.1)
    assert aligned[5, 13] == 2.0  # 100 * 0.06 / 2 + 10
    assert set(zip(*np.nonzero(aligned), strict=True)) == {(5, 13)}


def test_a_wall_stays_whole_in_a_finer_picture():
    depth = np.full(IMAGER.shape, 1.5, np.float32)
    color = IMAGER.resized(63, 33)
    aligned = align_to_color(depth, IMAGER, color, 0.015)
    moved = 3 * 100 * 0.015 / 1.5  # three colour pixels
    np.testing.assert_array_equal(aligned[:, round(moved) :], 1.5)
    assert (aligned[:, : round(moved) - 1] == 0).all()


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.floats(-0.05, 0.05))
def test_alignment_invents_no_depth_and_keeps_the_nearest(seed, x):
    rng = np.random.default_rng(seed)
    depth = np.where(rng.random(IMAGER.shape) < 0.5, rng.uniform(0.4, 3, IMAGER.shape), 0)
    depth = depth.astype(np.float32)
    aligned = align_to_color(depth, IMAGER, IMAGER, x)
    assert set(np.unique(aligned)) <= {0.0, *np.unique(depth).tolist()}
    v, u = np.nonzero(depth)
    at = np.rint(100 * ((u - 10) / 100 + x / depth[v, u]) + 10).astype(int)
    inside = (at >= 0) & (at < IMAGER.width)
    there = aligned[v[inside], at[inside]]
    assert (there > 0).all()
    assert (there <= depth[v, u][inside] + 1e-6).all()
