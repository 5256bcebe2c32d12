"""How near the gripper comes to the hand on its way, and what is in its way."""

from types import SimpleNamespace

import numpy as np
import pytest

from hadr.camera import transform_points
from hadr.hand import forward_kinematics, keypoints_from_skeleton
from hadr.handover import ur5
from hadr.handover.grasping.collision import (
    FLESH,
    FOREARM_RADIUS,
    LARGE,
    free_of_hand,
    free_of_object,
    free_of_scene,
    hand_distance,
    links_gaps,
    person,
    way_to_hand,
)
from hadr.handover.grasping.grasps import Grasps, Way, forward_of
from hadr.handover.guarded_arm import GuardedArm
from hadr.handover.simulated_ur5 import SimulatedUR5
from hadr.handover.stages import HandoverConfig
from hadr.simulation.world.scenes import held_scene

FAR = np.array([[5.0, 5.0, 5.0]])
BALL = LARGE * float(max(FLESH))
"""What keypoints that are all in one place have around them, metres."""


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
        ((0.0, 0.0, 0.05), np.hypot(0.03, 0.05) - BALL),  # before the fingers, 3 cm beside each
        ((0.065, 0.0, -0.03), 0.025 - BALL),  # beside the right finger
        ((0.0, 0.05, -0.10), 0.02 - BALL),  # above the palm, which is 3 cm from the middle
        ((0.0, 0.0, -0.10), -0.03 - BALL),  # inside the palm, 3 cm below its top
        ((0.04 + 0.03, 0.0, 0.04), 0.05 - BALL),  # 3 and 4 cm from a fingertip's edge
    ],
)
def test_distance_to_a_hand_in_one_place(place: tuple[float, float, float], free: float) -> None:
    keypoints = np.tile(place, (21, 1))
    assert hand_distance(np.eye(4), 0.06, keypoints) == pytest.approx(free)


def test_the_guard_sees_the_same_body_as_the_planning() -> None:
    """A gripper of lines left 30 mm to a hand that touched the palm's side by 5."""
    keypoints = np.tile([0.055, 0.0, -0.14], (21, 1))  # 15 mm beside the palm, flesh is 20
    robot = SimulatedUR5()
    tool = robot.tool_pose()
    watch = SimpleNamespace(keypoints=transform_points(tool, keypoints))
    arm = GuardedArm(robot, HandoverConfig(), watch)
    assert hand_distance(np.eye(4), 0.06, keypoints) == pytest.approx(-0.005)
    assert arm.free(width=0.06) == pytest.approx(-0.005)
    far = forward_of(tool, -0.3)
    assert arm.free(far, tool, width=0.06) == pytest.approx(-0.005)


def test_the_forearm_goes_on_behind_the_wrist() -> None:
    hand = keypoints_from_skeleton(forward_kinematics(np.zeros(20)).joints)  # wrist 0, knuckle +y
    tool = np.eye(4)
    tool[:3, 3] = [0.0, -0.20, -0.10]  # fingertips 10 cm below the forearm's middle line
    assert hand_distance(tool, 0.06, hand) == pytest.approx(np.hypot(0.03, 0.10) - 0.035, abs=5e-4)
    tool[1, 3] = -0.24 - 0.10 - 0.01  # 10 cm beyond the elbow, a finger is 2 cm high
    nearest = np.linalg.norm([0.03, 0.10, 0.10]) - 0.035
    assert hand_distance(tool, 0.06, hand) == pytest.approx(nearest, abs=5e-4)


def test_wrist_and_forearm_of_the_arm_count() -> None:
    robot = SimulatedUR5()
    links, tool = ur5.link_surfaces(robot.joint_positions()), robot.tool_pose()
    outline = robot.outline()
    for start, end, radius in ((4, 5, 0.045), (5, 6, 0.040), (6, 7, 0.040)):
        middle = (outline[start] + outline[end]) / 2
        across = np.cross(outline[end] - outline[start], [0.3, 0.5, 0.7])
        for away in (0.06, 0.02):
            place = middle + away * across / np.linalg.norm(across)
            keypoints = np.tile(place, (21, 1))
            alone = hand_distance(tool, 0.085, keypoints)
            free = hand_distance(tool, 0.085, keypoints, links)
            assert free <= min(alone, away - radius - BALL) + 1e-9
            assert free > -0.06
    with pytest.raises(ValueError, match="no number: nan"):
        hand_distance(np.full((4, 4), np.nan), 0.085, keypoints)


def test_links_at_a_known_distance() -> None:
    capsule = np.array([[0.0, 0, 0, 0.4, 0, 0, 0.045]])
    beside = np.tile([0.2, 0.1, 0.0], (21, 1))
    assert links_gaps(capsule, person(beside)).min() == pytest.approx(0.1 - 0.045 - BALL)
    beyond = np.tile([0.43, 0.04, 0.0], (21, 1))
    assert links_gaps(capsule, person(beyond)).min() == pytest.approx(0.05 - 0.045 - BALL)


def test_the_way_counts_and_not_only_its_end() -> None:
    # beside where the palm passes: 14.5 + 10 cm behind the grasp's point
    passed = np.tile([-0.24, 0.0, 0.06], (21, 1))
    way = way_to_hand(grasp(), passed)
    assert way[0] == pytest.approx(0.06 - 0.03 - BALL)
    # 8 cm past the grasp's point: the tips stop 3 cm before it
    ahead = np.tile([0.08, 0.035, 0.0], (21, 1))
    assert way_to_hand(grasp(), ahead)[0] == pytest.approx(0.03 - BALL)


def test_a_longer_way_is_checked_to_its_end() -> None:
    hand, rim = np.tile([0.10, 0.035, 0.0], (21, 1)), points_at(0.075, 0.035, 0.0)
    for forward, feel in ((0.05, 0.0), (0.07, 0.0), (0.05, 0.02)):
        way = Way(forward=forward, feel=feel)
        assert way_to_hand(grasp(), hand, way)[0] == pytest.approx(0.10 - way.last - BALL)
        assert free_of_scene(grasp(), rim, FAR, way=way)[0] == (way.last < 0.065)
        # the object is what the fingers feel for: only the planned way must be free of it
        assert free_of_object(grasp(), points_at(0.06, 0.035, 0.0), way)[0] == (forward < 0.06)


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
    assert free_of_scene(grasp(), points_at(0.02, 0.035, 0.021), FAR)[0]
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


@pytest.mark.parametrize(("object_id", "hold"), [("0001", 904), ("0004", 901), ("0010", 900)])
def test_the_drawn_skin_lies_in_the_flesh_that_the_guard_reckons_with(
    object_id: str, hold: int
) -> None:
    scene = held_scene(object_id, hold)
    skin = scene.hand(0.006).surface.vertices
    of_hand = skin[skin[:, 1] > -0.03]  # wrist frame: the forearm has its own radius
    middles, radii = person(keypoints_from_skeleton(scene.skeleton.joints))
    lines = np.linalg.norm(of_hand[:, None] - middles, axis=2)
    thin = np.where(radii == FOREARM_RADIUS, radii, 0.010)  # as it was once
    assert 0.009 < np.percentile((lines - thin).min(axis=1), 95) < 0.017
    outside = np.percentile((lines - radii).min(axis=1), [50, 95, 99])
    assert outside[0] < 0
    assert outside[1] < 0.008
    assert outside[2] < 0.0112
