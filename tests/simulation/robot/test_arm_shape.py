"""The arm's surfaces: where the real links are, closed, moved by the kinematics."""

import numpy as np
import pytest
import trimesh

from hadr.handover import ur5
from hadr.handover.simulated_ur5 import HOME_JOINTS, SimulatedUR5
from hadr.simulation.robot.arm_shape import arm_surfaces

POSES = [
    np.zeros(6),
    HOME_JOINTS,
    np.array([0.4, -1.2, 1.0, -2.0, 0.7, 2.5]),
]


def everything(joints: np.ndarray, width: float = 0.05) -> trimesh.Trimesh:
    return trimesh.util.concatenate(
        [trimesh.Trimesh(s.vertices, s.faces) for s, _ in arm_surfaces(joints, width)]
    )


@pytest.mark.parametrize("joints", POSES)
def test_each_point_of_the_real_links_lies_inside(joints: np.ndarray) -> None:
    outline = ur5.link_outline(joints) @ ur5.BASE_LINK_FROM_DH_BASE[:3, :3].T
    middles = (outline[1:] + outline[:-1]) / 2
    points = np.concatenate([outline[1:-1], middles])
    inside = np.zeros(len(points), dtype=bool)
    for surface, _ in arm_surfaces(joints, 0.05):
        mesh = trimesh.Trimesh(surface.vertices, surface.faces)
        inside |= np.any(
            [part.contains(points) for part in mesh.split(only_watertight=True)], axis=0
        )
    assert inside.all(), points[~inside]


def test_normals_point_outward_and_surfaces_are_closed() -> None:
    for surface, color in arm_surfaces(HOME_JOINTS, 0.03):
        mesh = trimesh.Trimesh(surface.vertices, surface.faces)  # welds the corners
        assert mesh.is_watertight
        assert mesh.volume > 0
        np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1.0, atol=1e-6)
        assert all(0 <= channel <= 1 for channel in color)
        a, b, c = (surface.vertices[surface.faces[:, i]] for i in range(3))
        flat = np.cross(b - a, c - a)
        big = np.linalg.norm(flat, axis=1) > 1e-9
        mean = surface.normals[surface.faces].mean(axis=1)
        assert ((flat * mean).sum(1)[big] > 0).mean() > 0.99


@pytest.mark.parametrize("width", [0.0, 0.031, 0.085])
def test_the_pads_stand_as_far_apart_as_told(width: float) -> None:
    tool = SimulatedUR5().tool_pose()
    mesh = everything(HOME_JOINTS, width)
    x, y, z = ((mesh.vertices - tool[:3, 3]) @ tool[:3, :3]).T
    fingers = (z > -0.06 + 1e-6) & (np.abs(y) < 0.011)
    assert np.abs(x[fingers]).min() == pytest.approx(width / 2, abs=1e-9)
    assert np.abs(x[fingers]).max() == pytest.approx(width / 2 + 0.01, abs=1e-9)
    assert z.max() == pytest.approx(0.0, abs=1e-9)
    assert np.ptp(y[fingers]) == pytest.approx(0.02, abs=1e-9)


def test_the_sizes_are_those_of_a_ur5() -> None:
    straight_up = np.radians([0, -90, 0, -90, 0, 0])
    mesh = everything(straight_up)
    low, high = mesh.bounds
    assert low[2] == pytest.approx(0.0, abs=1e-9)
    # the flange is 1.001 m high (by hand), its housing 38 mm round
    assert high[2] == pytest.approx(1.0011 + 0.038, abs=0.015)
    foot = mesh.vertices[mesh.vertices[:, 2] < 0.01]
    assert np.hypot(foot[:, 0], foot[:, 1]).max() == pytest.approx(0.075, abs=1e-6)


@pytest.mark.parametrize("width", [-0.003, 0.088, 0.2, np.nan])
def test_an_impossible_width_is_refused(width: float) -> None:
    with pytest.raises(ValueError, match=r"gripper_width must lie between 0 and 0\.085"):
        arm_surfaces(HOME_JOINTS, width)


def test_pads_that_give_way_are_drawn_closed() -> None:
    for (a, _), (b, _) in zip(
        arm_surfaces(HOME_JOINTS, -0.001), arm_surfaces(HOME_JOINTS, 0.0), strict=True
    ):
        np.testing.assert_array_equal(a.vertices, b.vertices)
