"""The depth sensor's formula: shadows where they must lie, and the truth without its faults."""

import numpy as np

from hadr.camera import TRANSHAND_CAMERA
from hadr.simulation.camera.depth_sensor import DepthSensor, in_shadow


def test_shadows_lie_on_the_left_of_what_is_near() -> None:
    depth = np.full((3, 100), 2.0, np.float32)
    depth[:, 60:80] = 0.5
    hidden = in_shadow(depth, 10.0)  # disparities 5 and 20 pixels
    # column 45 + k of the background falls on the right imager's 40 + k, as the object's 60 + k
    np.testing.assert_array_equal(np.flatnonzero(hidden[1]), np.arange(45, 60))
    assert not in_shadow(np.full((2, 50), 1.0, np.float32), 10.0).any()


def test_a_perfect_sensor_measures_the_truth() -> None:
    sensor = DepthSensor(missing=0, behind=0, disparity_std=0, disparity_step=0, lost=0)
    depth = np.full((20, 30), 0.8, np.float32)
    none = np.zeros(depth.shape, bool)
    camera = TRANSHAND_CAMERA.resized(30, 20)
    raw = sensor.measure(depth, depth, none, camera, np.random.default_rng(0))
    np.testing.assert_allclose(raw, depth, atol=1e-6)
    far = sensor.measure(depth * 6, depth * 6, none, camera, np.random.default_rng(0))
    assert (far == 0).all()  # 4.8 m is too far


def test_depth_error_grows_with_the_square_of_the_distance() -> None:
    sensor = DepthSensor(disparity_step=0.0, lost=0.0)
    camera = TRANSHAND_CAMERA.resized(256, 144)
    none = np.zeros(camera.shape, bool)
    spread = []
    for distance in (0.5, 1.0, 2.0):
        flat = np.full(camera.shape, distance, np.float32)
        raw = sensor.measure(flat, flat, none, camera, np.random.default_rng(1))
        spread.append((raw[:, 40:] - distance)[raw[:, 40:] > 0].std())
    # dz = z^2 / (f b) * 0.08 pixels
    expected = 0.08 * np.array([0.25, 1.0, 4.0]) / (425 * 0.05)
    np.testing.assert_allclose(spread, expected, rtol=0.05)


def test_shares_on_glass_are_those_asked_for() -> None:
    sensor = DepthSensor(disparity_std=0, disparity_step=0, lost=0)
    camera = TRANSHAND_CAMERA.resized(256, 144)
    glass = np.zeros(camera.shape, bool)
    glass[40:100, 100:150] = True
    behind = np.full(camera.shape, 0.68, np.float32)  # near, so that no outline is frayed much
    depth = np.where(glass, 0.66, 0.68).astype(np.float32)
    raw = sensor.measure(depth, behind, glass, camera, np.random.default_rng(3))
    inner = np.zeros_like(glass)
    inner[44:96, 104:146] = True
    assert abs((raw[inner] == 0).mean() - 0.75) < 0.05
    through = raw[inner & (raw > 0)]
    assert abs((through > 0.6605).mean() - 0.19 / 0.25) < 0.15
    assert through.max() < 0.6805
