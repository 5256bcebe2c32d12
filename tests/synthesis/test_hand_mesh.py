import numpy as np
import pytest

from hadr.hand import HandShape, forward_kinematics, keypoints_from_skeleton
from hadr.synthesis.hand_mesh import hand_mesh, surface_nets


def curled(amount: float) -> np.ndarray:
    angles = np.zeros(20)
    angles[5::4], angles[6::4], angles[7::4] = amount, amount, 0.6 * amount
    return angles


def edge_counts(faces: np.ndarray) -> np.ndarray:
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return np.unique(edges, axis=0, return_counts=True)[1]


def signed_volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def test_surface_nets_finds_a_sphere():
    axis = np.arange(-12, 13) * 0.1
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    field = (np.sqrt(x**2 + y**2 + z**2) - 0.83).astype(np.float32)
    surface = surface_nets(field, np.full(3, -1.2), 0.1)
    assert np.abs(np.linalg.norm(surface.vertices, axis=1) - 0.83).max() < 0.012
    assert (edge_counts(surface.faces) == 2).all()
    volume = signed_volume(surface.vertices, surface.faces)
    assert volume == pytest.approx(4 / 3 * np.pi * 0.83**3, rel=0.02)
    radial = surface.vertices / np.linalg.norm(surface.vertices, axis=1, keepdims=True)
    assert (surface.normals * radial).sum(1).min() > 0.99


@pytest.mark.parametrize("amount", [0.0, 0.7, 1.4])
def test_the_hand_is_closed_and_has_a_hands_volume(amount):
    skeleton = forward_kinematics(curled(amount))
    surface = hand_mesh(skeleton, step=0.004).surface
    assert (edge_counts(surface.faces) % 2 == 0).all()
    beyond_wrist = surface.vertices[:, 1] > 0
    assert beyond_wrist.any()
    assert 0.002 < signed_volume(surface.vertices, surface.faces) < 0.006


def test_the_joints_lie_in_the_flesh():
    """Every keypoint is nearer to the skin than the thickest part of the hand is thick."""
    skeleton = forward_kinematics(curled(0.5))
    surface = hand_mesh(skeleton, step=0.003).surface
    points = keypoints_from_skeleton(skeleton.joints)
    for point in points:
        distance = np.linalg.norm(surface.vertices - point, axis=1)
        nearest = surface.vertices[distance.argmin()] - point
        assert distance.min() < 0.022
        # Inside: the skin's outward normal at the nearest vertex points away from the joint.
        assert nearest @ surface.normals[distance.argmin()] > -0.003


def test_a_left_hand_is_the_mirror_image():
    meshes = {
        side: hand_mesh(
            forward_kinematics(curled(0.6), HandShape(side)), HandShape(side), step=0.004
        )
        for side in ("right", "left")
    }
    right, left = (meshes[side].surface for side in ("right", "left"))
    assert signed_volume(left.vertices, left.faces) == pytest.approx(
        signed_volume(right.vertices, right.faces), rel=0.01
    )
    low, high = right.vertices.min(0), right.vertices.max(0)
    np.testing.assert_allclose(left.vertices.min(0), [-high[0], low[1], low[2]], atol=0.003)
    np.testing.assert_allclose(left.vertices.max(0), [-low[0], high[1], high[2]], atol=0.003)
    assert abs(low[0] + high[0]) > 0.02  # the thumb makes the two sides differ


def test_resolution_is_checked():
    with pytest.raises(ValueError, match=r"between 0.001 and 0.010 metres, got 0.1"):
        hand_mesh(forward_kinematics(np.zeros(20)), step=0.1)
