import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from hadr.hand import ANGLE_LIMITS, HandShape, forward_kinematics, keypoints_from_skeleton
from hadr.synthesis.hand.mesh import hand_mesh
from hadr.synthesis.hand.skinning import skin_vertices


def curled(amount: float) -> np.ndarray:
    angles = np.zeros(20)
    angles[5::4], angles[6::4], angles[7::4] = amount, amount, 0.6 * amount
    return angles


def solid(angles: np.ndarray, shape: HandShape | None = None, step: float = 0.004):
    surface = hand_mesh(forward_kinematics(angles, shape), shape, step=step).surface
    return trimesh.Trimesh(surface.vertices, surface.faces, process=False)


def winding(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """How often the surface goes around each point: 1 inside, 0 outside (solid angles)."""
    numbers = []
    for point in points:
        a, b, c = np.moveaxis(mesh.triangles - point, 1, 0)
        la, lb, lc = (np.linalg.norm(e, axis=1) for e in (a, b, c))
        above = np.einsum("ij,ij->i", a, np.cross(b, c))
        dots = [np.einsum("ij,ij->i", p, q) for p, q in ((a, b), (b, c), (c, a))]
        below = la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb
        numbers.append(np.arctan2(above, below).sum() / (2 * np.pi))
    return np.array(numbers)


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from(["right", "left"]))
def test_closed_in_every_pose_with_the_keypoints_in_the_flesh(seed, side):
    rng = np.random.default_rng(seed)
    shape = HandShape(side=side, scale=rng.uniform(0.85, 1.1))
    angles = rng.uniform(ANGLE_LIMITS[:, 0], ANGLE_LIMITS[:, 1])
    mesh = solid(angles, shape)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0
    keypoints = keypoints_from_skeleton(forward_kinematics(angles, shape).joints)
    assert winding(mesh, keypoints).min() > 0.99


def test_a_left_hand_is_the_mirror_image():
    shapes = HandShape("right"), HandShape("left")
    right, left = (skin_vertices(forward_kinematics(curled(0.6), s), s) for s in shapes)
    np.testing.assert_allclose(left[0], right[0] * [-1, 1, 1], atol=1e-7)
    assert (left[1] == right[1]).all()
    meshes = [solid(curled(0.6), shape) for shape in shapes]
    assert meshes[1].volume == pytest.approx(meshes[0].volume, rel=1e-5)


def test_normals_point_outward_with_length_one():
    for side in ("right", "left"):
        shape = HandShape(side)
        surface = hand_mesh(forward_kinematics(curled(0.3), shape), shape, step=0.004).surface
        np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1, atol=1e-9)
        elbow = (surface.vertices[:, 1] < -0.6) & (surface.vertices[:, 1] > -0.72)
        radial = surface.vertices[elbow] * [1, 0, 1]
        assert (surface.normals[elbow] * radial).sum(1).min() > 0.03


def test_resolution_is_checked():
    with pytest.raises(ValueError, match=r"between 0.001 and 0.010 metres, got 0.1"):
        hand_mesh(forward_kinematics(np.zeros(20)), step=0.1)
