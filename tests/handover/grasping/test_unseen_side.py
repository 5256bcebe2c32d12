"""Axes of known shapes, and the far half that no camera saw."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hadr.handover.grasping.unseen_side import symmetry_axis, turned_about_axis, unseen_side

EYE = np.array([-1.0, 0.0, 0.0])


def half_cone(lean: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The near half of a cup that is 5 cm wide below and 8 cm above, 10 cm tall; its axis."""
    angle, height = np.meshgrid(np.linspace(np.pi / 2, 3 * np.pi / 2, 25), np.linspace(0, 0.1, 20))
    radius = 0.025 + 0.15 * height
    out = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
    points = radius[..., None] * out + height[..., None] * [0, 0, 1.0]
    normals = (out - [0, 0, 0.15]) / np.hypot(1, 0.15)
    turn = Rotation.from_euler("x", lean).as_matrix()  # sideways as the camera sees it
    at = np.array([0.5, 0.1, 0.2])
    return points.reshape(-1, 3) @ turn.T + at, normals.reshape(-1, 3) @ turn.T, turn[:, 2]


@pytest.mark.parametrize("lean", [0.0, 0.3])
def test_axis_of_half_a_cup(lean: float) -> None:
    points, normals, true = half_cone(lean)
    axis = symmetry_axis(points, normals)
    assert abs(axis.direction @ true) > np.cos(np.deg2rad(2.0))
    beside = np.cross(axis.direction, axis.point - [0.5, 0.1, 0.2])
    assert np.linalg.norm(beside) < 0.002
    assert axis.miss < 0.001


def test_a_handle_does_not_move_the_axis() -> None:
    points, normals, true = half_cone()
    handle = np.random.default_rng(0).uniform(-1, 1, (60, 3)) * [0.005, 0.03, 0.03]
    handle_normals = np.tile([0.0, 0.0, 1.0], (60, 1))
    axis = symmetry_axis(
        np.concatenate([points, handle + np.array([0.5, 0.2, 0.25])]),
        np.concatenate([normals, handle_normals]),
    )
    assert abs(axis.direction @ true) > np.cos(np.deg2rad(3.0))
    assert np.linalg.norm(np.cross(axis.direction, axis.point - [0.5, 0.1, 0.2])) < 0.003


@pytest.mark.parametrize("lean", [0.0, 0.3])
def test_the_far_half_of_a_cup(lean: float) -> None:
    points, normals, true = half_cone(lean)
    guessed, guessed_normals = unseen_side(points, normals, EYE)
    assert len(guessed) > 0.9 * len(points)
    from_axis = guessed - [0.5, 0.1, 0.2]
    height = from_axis @ true
    outward = from_axis - height[:, None] * true
    radius = np.linalg.norm(outward, axis=1)
    np.testing.assert_allclose(radius, 0.025 + 0.15 * height, atol=0.004)
    assert (from_axis[:, 0] > -0.004).all()  # behind the axis, as the camera sees it
    facing = (guessed_normals * outward).sum(axis=1) / np.maximum(radius, 1e-9)
    assert facing.min() > 0.95


def test_the_unseen_sides_of_a_box() -> None:
    # the sides at -x, -y and +z of a box of 12 x 5 x 15 cm around (0.5, 0, 0.3) are seen
    rng = np.random.default_rng(0)
    half, points, normals = np.array([0.06, 0.025, 0.075]), [], []
    for axis, sign in ((0, -1.0), (1, -1.0), (2, 1.0)):
        side = rng.uniform(-1, 1, (200, 3)) * half
        side[:, axis] = sign * half[axis]
        points.append(side)
        normals.append(np.tile(sign * np.eye(3)[axis], (200, 1)))
    cloud = np.concatenate(points) + np.array([0.5, 0, 0.3])
    guessed, guessed_normals = unseen_side(cloud, np.concatenate(normals), EYE)
    off = (guessed - [0.5, 0, 0.3]) / half
    expected = [(0, 1.0), (1, 1.0), (2, -1.0)]
    for i, (axis, sign) in enumerate(expected):
        one = slice(200 * i, 200 * (i + 1))
        np.testing.assert_allclose(off[one, axis], sign, atol=0.05)
        np.testing.assert_allclose(guessed_normals[one, axis], sign, atol=1e-9)
    assert np.abs(off).max() < 1.05


def test_nothing_is_guessed_along_the_axis() -> None:
    points, normals, _ = half_cone()
    guessed, _ = unseen_side(points, normals, np.array([0.5, 0.1, 2.0]))
    assert guessed.shape == (0, 3)


def test_what_is_hidden_on_one_side_is_filled_in_from_another() -> None:
    points, normals, _ = half_cone()
    seen = points[:, 1] < 0.1  # a quarter of the cup
    turned = turned_about_axis(points[seen], normals[seen])
    angle = np.arctan2(turned[:, 1] - 0.1, turned[:, 0] - 0.5)
    counts, _ = np.histogram(angle, bins=6, range=(-np.pi, np.pi))
    assert counts.min() > 100
    height = turned[:, 2] - 0.2
    radius = np.hypot(turned[:, 0] - 0.5, turned[:, 1] - 0.1)
    np.testing.assert_allclose(radius, 0.025 + 0.15 * height, atol=0.006)
