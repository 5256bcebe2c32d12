"""Candidates around a cylinder, the filters, and the choice."""

import numpy as np
import pytest

from hadr.hand import forward_kinematics, keypoints_from_skeleton
from hadr.handover.grasping.candidates import sample_grasps, surface_normals
from hadr.handover.grasping.collision import (
    fork,
    fork_points,
    free_of_hand,
    free_of_object,
    hand_distance,
)
from hadr.handover.grasping.grasps import Grasps
from hadr.handover.grasping.selection import GraspSelection
from hadr.handover.poses import camera_at
from hadr.handover.robot import SimulatedUR5
from hadr.simulation.trials.rehearsal import rehearsed_scene, visible_points

RADIUS = 0.03


def cylinder() -> np.ndarray:
    """Half a standing cylinder of radius 3 cm at x = 0.5, as seen from the origin, metres."""
    angle, height = np.meshgrid(np.linspace(np.pi / 2, 3 * np.pi / 2, 40), np.linspace(0, 0.12, 40))
    ring = np.stack([0.5 + RADIUS * np.cos(angle), RADIUS * np.sin(angle), height], axis=-1)
    return ring.reshape(-1, 3)


def straight_grasp(width: float = 0.07) -> Grasps:
    """One grasp that meets the cylinder at half height, along x, closing along y."""
    row = [1.0, width, 0.02, 0.02, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0.47, 0, 0.06, -1]
    return Grasps.from_rows(np.array([row]), "base")


def test_normals_of_a_cylinder_point_to_the_viewer() -> None:
    points = cylinder()
    normals = surface_normals(points, np.array([-2.0, 0, 0.06]))
    expected = (points - [0.5, 0, 0]) * [1, 1, 0] / RADIUS
    middle = np.abs(points[:, 2] - 0.06) < 0.04
    middle &= np.abs(points[:, 1]) < 0.025
    assert (normals * expected).sum(axis=1)[middle].min() > 0.98


def test_candidates_hold_the_cylinder() -> None:
    grasps = sample_grasps(cylinder(), np.random.default_rng(0), viewpoint=np.array([-2, 0, 0.06]))
    assert len(grasps) > 20
    assert (np.diff(grasps.scores) <= 0).all()
    assert ((grasps.scores >= 0) & (grasps.scores <= 1)).all()
    # the best ones close across the cylinder, and no opening is smaller than what it holds
    best = grasps.select(np.arange(5))
    assert (np.abs(best.axis("closing")[:, 2]) < 0.5).all()
    assert (grasps.widths <= 0.085).all()


def test_candidates_are_the_same_for_the_same_seed() -> None:
    first, second = (sample_grasps(cylinder(), np.random.default_rng(5)).to_rows() for _ in "ab")
    np.testing.assert_array_equal(first, second)


def test_bad_points_are_refused() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match=r"at least 30 rows.*\(5, 3\)"):
        sample_grasps(np.zeros((5, 3)), rng)
    broken = cylinder()
    broken[3] = np.nan
    with pytest.raises(ValueError, match="must be finite"):
        sample_grasps(broken, rng)
    with pytest.raises(ValueError, match="wider than the gripper"):
        sample_grasps(cylinder(), rng, largest_width=0.014)


def test_fork_has_the_gripper_s_size() -> None:
    left, right, bar, stem = fork(0.06)
    np.testing.assert_allclose([left[0, 0], right[0, 0]], [-0.035, 0.035])
    assert np.linalg.norm(left[1] - left[0]) == pytest.approx(0.06)
    np.testing.assert_allclose(bar[:, 2], -0.06)
    assert stem[1, 2] == pytest.approx(-0.12)


def test_fork_points_are_in_the_pose_s_frame() -> None:
    pose = np.eye(4)
    pose[:3, :3] = [[0, 0, 1], [1, 0, 0], [0, 1, 0]]  # approach along x
    pose[:3, 3] = [1, 2, 3]
    points = fork_points(pose, 0.06)
    assert points[:, 0].min() == pytest.approx(1 - 0.12)
    assert points[:, 0].max() == pytest.approx(1.0)
    np.testing.assert_allclose([points[:, 1].min(), points[:, 1].max()], [2 - 0.035, 2 + 0.035])


def test_hand_distance_by_hand() -> None:
    # a hand shrunk to one point (nearly) 10 cm in front of the right fingertip
    keypoints = np.tile([0.035, 0.0, 0.10], (21, 1))
    free = hand_distance(np.eye(4), 0.06, keypoints)
    assert free == pytest.approx(0.10 - 0.010)


def test_free_of_object_wants_the_object_between_the_fingers() -> None:
    points = cylinder()
    assert free_of_object(straight_grasp(0.07), points)[0]
    assert not free_of_object(straight_grasp(0.04), points)[0]  # fingers inside the cylinder
    assert not free_of_object(straight_grasp(0.07), points, forward=0.09)[0]  # the bar is


def test_free_of_hand_looks_at_the_whole_way() -> None:
    hand = keypoints_from_skeleton(forward_kinematics(np.zeros(20)).joints)
    away = hand + np.array([0.5, 0.5, 0.0])
    in_the_way = hand - hand.mean(axis=0) + [0.40, 0.0, 0.06]  # between pre-grasp and grasp
    assert free_of_hand(straight_grasp(), away)[0]
    assert not free_of_hand(straight_grasp(), in_the_way)[0]


def test_selection_faces_the_human_and_keeps_off_the_hand() -> None:
    scene = rehearsed_scene()
    camera = camera_at(np.array([0.0, -0.55, 0.65]), np.array([0.55, 0.0, 0.3]))
    points, robot = visible_points(scene, camera[:3, 3]), SimulatedUR5()
    choose = GraspSelection(np.random.default_rng(0), camera[:3, 3])
    chosen = choose(points, scene.keypoints, robot)
    assert chosen is not None
    assert chosen.pose[0, 2] > 0.4  # approaches forward, to the human
    assert robot.reachable(chosen.pose)
    assert hand_distance(chosen.pose, chosen.width, scene.keypoints) > 0.02


def test_selection_returns_none_where_nothing_can_be_reached() -> None:
    scene = rehearsed_scene()
    camera = camera_at(np.array([0.0, -0.55, 0.65]), np.array([0.55, 0.0, 0.3]))
    points = visible_points(scene, camera[:3, 3]) + np.array([1.0, 0, 0])
    choose = GraspSelection(np.random.default_rng(0), camera[:3, 3] + [1.0, 0, 0])
    assert choose(points, scene.keypoints + np.array([1.0, 0, 0]), SimulatedUR5()) is None


def test_selection_without_rescoring_takes_the_score_alone() -> None:
    scene = rehearsed_scene()
    eye = camera_at(np.array([0.0, -0.55, 0.65]), np.array([0.55, 0.0, 0.3]))[:3, 3]
    points, robot = visible_points(scene, eye), SimulatedUR5()
    plain = GraspSelection(np.random.default_rng(0), eye, rescoring=False)
    chosen = plain(points, scene.keypoints, robot)
    assert chosen is not None
    assert 0 < chosen.score <= 1
    rescored = GraspSelection(np.random.default_rng(0), eye)(points, scene.keypoints, robot)
    assert rescored is not None
    wish = np.array([0.4, 0.0, -0.2])
    assert rescored.pose[:3, 2] @ wish >= chosen.pose[:3, 2] @ wish - 1e-9


def test_selection_keeps_off_measured_points() -> None:
    scene = rehearsed_scene()
    eye = camera_at(np.array([0.0, -0.55, 0.65]), np.array([0.55, 0.0, 0.3]))[:3, 3]
    points, robot = visible_points(scene, eye), SimulatedUR5()
    free = GraspSelection(np.random.default_rng(0), eye)(points, scene.keypoints, robot)
    assert free is not None
    # a wall where that gripper waits; then walls all around
    wall = np.random.default_rng(0).normal(0, 0.02, (200, 3)) + free.pose[:3, 3]
    wall -= 0.12 * free.pose[:3, 2]
    other = GraspSelection(np.random.default_rng(0), eye)(points, scene.keypoints, robot, wall)
    assert other is None or np.abs(other.pose - free.pose).max() > 0.01
    out = np.random.default_rng(1).normal(size=(4000, 3))
    shell = points.mean(axis=0) + 0.16 * out / np.linalg.norm(out, axis=1, keepdims=True)
    shut = GraspSelection(np.random.default_rng(0), eye, rounds=1)
    assert shut(points, scene.keypoints, robot, shell) is None
