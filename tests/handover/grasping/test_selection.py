"""The choice of a grasp: it faces the human, keeps off the hand, can be reached."""

import numpy as np

from hadr.handover.grasping.collision import hand_distance
from hadr.handover.grasping.selection import GraspSelection
from hadr.handover.poses import camera_at
from hadr.handover.robot import SimulatedUR5
from hadr.simulation.trials.rehearsal import rehearsed_scene, visible_points

SCENE = rehearsed_scene()
EYE = camera_at(np.array([0.0, -0.55, 0.65]), np.array([0.55, 0.0, 0.3]))[:3, 3]


def test_it_faces_the_human_and_keeps_off_the_hand() -> None:
    points, robot = visible_points(SCENE, EYE), SimulatedUR5()
    choose = GraspSelection(np.random.default_rng(0), EYE)
    chosen = choose(points, SCENE.keypoints, robot)
    assert chosen is not None
    assert chosen.pose[0, 2] > 0.4  # approaches forward, to the human
    assert robot.reachable(chosen.pose)
    assert hand_distance(chosen.pose, chosen.width, SCENE.keypoints) > 0.02


def test_none_is_returned_where_nothing_can_be_reached() -> None:
    points = visible_points(SCENE, EYE) + np.array([1.0, 0, 0])
    choose = GraspSelection(np.random.default_rng(0), EYE + np.array([1.0, 0, 0]))
    assert choose(points, SCENE.keypoints + np.array([1.0, 0, 0]), SimulatedUR5()) is None


def test_without_rescoring_it_takes_the_score_alone() -> None:
    points, robot = visible_points(SCENE, EYE), SimulatedUR5()
    plain = GraspSelection(np.random.default_rng(0), EYE, rescoring=False)
    chosen = plain(points, SCENE.keypoints, robot)
    assert chosen is not None
    assert 0 < chosen.score <= 1
    rescored = GraspSelection(np.random.default_rng(0), EYE)(points, SCENE.keypoints, robot)
    assert rescored is not None
    wish = np.array([0.4, 0.0, -0.2])
    assert rescored.pose[:3, 2] @ wish >= chosen.pose[:3, 2] @ wish - 1e-9


def test_it_keeps_off_measured_points() -> None:
    points, robot = visible_points(SCENE, EYE), SimulatedUR5()
    free = GraspSelection(np.random.default_rng(0), EYE)(points, SCENE.keypoints, robot)
    assert free is not None
    # a wall where that gripper waits; then walls all around
    wall = np.random.default_rng(0).normal(0, 0.02, (200, 3)) + free.pose[:3, 3]
    wall -= 0.12 * free.pose[:3, 2]
    other = GraspSelection(np.random.default_rng(0), EYE)(points, SCENE.keypoints, robot, wall)
    assert other is None or np.abs(other.pose - free.pose).max() > 0.01
    out = np.random.default_rng(1).normal(size=(4000, 3))
    shell = points.mean(axis=0) + 0.16 * out / np.linalg.norm(out, axis=1, keepdims=True)
    shut = GraspSelection(np.random.default_rng(0), EYE, rounds=1)
    assert shut(points, SCENE.keypoints, robot, shell) is None
