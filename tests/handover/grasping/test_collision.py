"""How near the gripper comes to the hand on its way, and what is in its way."""

import numpy as np
import pytest

from hadr.hand import forward_kinematics, keypoints_from_skeleton
from hadr.handover.grasping.collision import (
    free_of_hand,
    free_of_object,
    free_of_scene,
    hand_distance,
    way_to_hand,
)
from hadr.handover.grasping.grasps import Grasps

FAR = np.array([[5.0, 5.0, 5.0]])


def grasp(width: float = 0.06) -> Grasps:
    """A grasp at the origin: approach along x, closing along y, height along z."""
    row = [1.0, width, 0.02, 0.02, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, -1]
    return Grasps.from_rows(np.array([row]), "base")


def points_at(x: float, y: float, z: float, count: int = 10) -> np.ndarray:
    """So many points in one place, metres."""
    return np.tile([x, y, z], (count, 1))


@pytest.mark.parametrize(
    ("place", "free"),
    [
        ((0.0, 0.0, 0.05), 0.04 - 0.01),  # between the fingers, above them by 4 cm
        ((0.065, 0.0, -0.03), 0.025 - 0.01),  # beside the right finger
        ((0.0, 0.05, -0.10), 0.02 - 0.01),  # above the palm, which is 3 cm from the middle
        ((0.0, 0.0, -0.10), -0.01),  # inside the palm
        ((0.04 + 0.03, 0.0, 0.04), 0.05 - 0.01),  # 3 and 4 cm from a fingertip's edge
    ],
)
def test_distance_to_a_hand_in_one_place(place: tuple[float, float, float], free: float) -> None:
    keypoints = np.tile(place, (21, 1))
    if place == (0.0, 0.0, 0.05):
        free = float(np.hypot(0.03, 0.05)) - 0.01  # nearest edge of a finger, 3 cm aside
    assert hand_distance(np.eye(4), 0.06, keypoints) == pytest.approx(free)


def test_the_way_counts_and_not_only_its_end() -> None:
    # beside where the palm passes: 16 + 10 cm behind the grasp's point
    passed = np.tile([-0.25, 0.0, 0.06], (21, 1))
    way = way_to_hand(grasp(), passed)
    assert way[0] == pytest.approx(0.06 - 0.03 - 0.01)
    # 8 cm past the grasp's point: the tips stop 3 cm before it
    ahead = np.tile([0.08, 0.035, 0.0], (21, 1))
    assert way_to_hand(grasp(), ahead)[0] == pytest.approx(0.03 - 0.01)


@pytest.mark.parametrize(
    ("place", "free"),
    [
        ((0.02, 0.0, 0.0), True),  # between the fingers
        ((0.02, 0.035, 0.0), False),  # where the right finger ends
        ((0.02, 0.035, 0.015), True),  # above that finger
        ((-0.005, 0.0, 0.0), True),  # the bar stops 1 cm before the grasp's point ...
        ((-0.012, 0.0, 0.0), False),  # ... here
        ((-0.02, 0.0, 0.025), False),  # the palm is wider than the bar
        ((-0.02, 0.0, 0.035), True),
        ((-0.15, 0.035, 0.0), False),  # on the fingers' way from the pre-grasp
    ],
)
def test_object_in_the_way(place: tuple[float, float, float], free: bool) -> None:
    assert free_of_object(grasp(), points_at(*place))[0] == free
    assert free_of_object(grasp(), points_at(*place, count=3))[0]  # noise


def test_scene_in_the_way() -> None:
    wall = points_at(0.02, 0.0, 0.018)  # 8 mm above the fingers' side, between them
    beside = points_at(0.02, 0.035, 0.018)
    assert free_of_scene(grasp(), wall, FAR)[0]
    assert not free_of_scene(grasp(), beside, FAR)[0]
    assert free_of_scene(grasp(), beside, FAR, clearance=0.005)[0]
    # the same points next to the object's own are its rim
    assert free_of_scene(grasp(), beside, points_at(0.02, 0.035, 0.012))[0]


def test_many_grasps_are_checked_as_one_by_one() -> None:
    rng = np.random.default_rng(0)
    rows = np.concatenate([grasp(width).to_rows() for width in rng.uniform(0.02, 0.08, 30)])
    turns = np.linalg.qr(rng.normal(size=(30, 3, 3)))[0]
    turns *= np.linalg.det(turns)[:, None, None]
    rows[:, 4:13], rows[:, 13:16] = turns.reshape(30, 9), rng.normal(0, 0.05, (30, 3))
    together = Grasps.from_rows(rows, "base")
    points, keypoints = rng.normal(0, 0.08, (60, 3)), rng.normal(0.1, 0.1, (21, 3))
    ways = way_to_hand(together, keypoints)
    free = free_of_object(together, points)
    assert 3 < free.sum() < 27
    for i in range(30):
        one = together.select(np.array([i]))
        assert free_of_object(one, points)[0] == free[i]
        assert way_to_hand(one, keypoints)[0] == pytest.approx(ways[i])
    assert len(free_of_object(together.select(np.zeros(30, dtype=bool)), points)) == 0


def test_free_of_hand_looks_at_the_whole_way() -> None:
    hand = keypoints_from_skeleton(forward_kinematics(np.zeros(20)).joints)
    away = hand + np.array([0.5, 0.5, 0.0])
    in_the_way = hand - hand.mean(axis=0) + [-0.07, 0.0, 0.0]  # between pre-grasp and grasp
    assert free_of_hand(grasp(), away)[0]
    assert not free_of_hand(grasp(), in_the_way)[0]
