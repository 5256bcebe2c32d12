"""Distances between poses, and what lies between them, by hand."""

import numpy as np
import pytest

from hadr.handover.poses import between, camera_at, pose_distance, toward


def test_pose_distance_by_hand() -> None:
    first, second = np.eye(4), np.eye(4)
    second[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    second[:3, 3] = [0.03, 0.04, 0]
    distance, angle = pose_distance(first, second)
    assert distance == pytest.approx(0.05)
    assert angle == pytest.approx(np.pi / 2)


def test_a_camera_looks_at_its_point_upright() -> None:
    pose = camera_at(np.array([1.0, 0, 0]), np.zeros(3))
    np.testing.assert_allclose(pose[:3, 1:3].T, [[0, 0, -1], [-1, 0, 0]], atol=1e-12)


def test_a_camera_that_looks_straight_down_or_at_itself() -> None:
    pose = camera_at(np.array([0.6, 0, 1]), np.array([0.6, 0, 0.3]))
    np.testing.assert_allclose(pose[:3, :3], [[0, -1, 0], [-1, 0, 0], [0, 0, -1]], atol=1e-12)
    with pytest.raises(ValueError, match=r"a camera at \[1.0, 2.0, 3.0\] can't look at itself"):
        camera_at(np.array([1.0, 2, 3]), np.array([1.0, 2, 3]))


def test_a_pose_between_two() -> None:
    second = np.eye(4)
    second[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    second[:3, 3] = [0.2, 0, 0]
    half = between(np.eye(4), second, 0.5)
    s = np.sqrt(0.5)
    np.testing.assert_allclose(half[:3, :3], [[s, -s, 0], [s, s, 0], [0, 0, 1]], atol=1e-12)
    np.testing.assert_allclose(half[:3, 3], [0.1, 0, 0])
    np.testing.assert_array_equal(toward(np.eye(4), second, 1.0, 4.0), second)
    np.testing.assert_allclose(toward(np.eye(4), second, 0.05, 4.0)[0, 3], 0.05)
    # 9 degrees of 90: a tenth of the way, although the distance would allow more
    np.testing.assert_allclose(toward(np.eye(4), second, 1.0, np.deg2rad(9))[0, 3], 0.02)
