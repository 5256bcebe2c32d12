"""The reference that runs before the tool, and how fast it may beside a hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hadr.handover import ur5
from hadr.handover.grasping.collision import links_gaps, person
from hadr.handover.guarded_arm import GuardedArm, HaltError
from hadr.handover.observation import HandWatch
from hadr.handover.poses import pose_distance
from hadr.handover.safety import allowed_speed
from hadr.handover.simulated_ur5 import SimulatedUR5
from hadr.handover.stages import HandoverConfig

OFF = HandoverConfig().human_uncertainty


def beside(
    hand: np.ndarray, velocity: np.ndarray | None, monkeypatch: pytest.MonkeyPatch, age: float
) -> GuardedArm:
    """An arm at home whose watch has seen a hand that goes at a velocity."""
    watch = HandWatch(np.eye(4))
    watch.keypoints, watch._path = hand, [(0.0, hand)]
    monkeypatch.setattr(HandWatch, "velocity", lambda *_: velocity)
    monkeypatch.setattr(HandWatch, "age", age)
    return GuardedArm(SimulatedUR5(), HandoverConfig(), watch)


def hand_above_the_forearm() -> np.ndarray:
    """Keypoints (21, 3) of a flat hand above the arm's forearm, metres."""
    hand = np.tile([-0.05, 0.0, 0.62], (21, 1))  # flat, its wrist and its own forearm at +x
    for finger in range(5):
        hand[1 + 4 * finger : 5 + 4 * finger, 0] -= [0.09, 0.12, 0.14, 0.16]
        hand[1 + 4 * finger : 5 + 4 * finger, 1] += 0.01 * (finger - 2)
    return hand


def test_the_reference_moves_at_its_speed_and_does_not_run_ahead() -> None:
    tool, goal, told = np.eye(4), np.eye(4), []
    goal[0, 3] = 1.0
    robot = SimpleNamespace(
        tool_pose=tool.copy, joint_positions=lambda: np.zeros(6), gripper_width=lambda: 0.08,
        protective_stop="", servo_to=lambda pose, dt, **_: told.append(pose.copy()),
        release=lambda: None, finger_force=lambda: 0.0, tool_wrench=lambda: np.zeros(6),
    )  # fmt: skip
    arm = GuardedArm(robot, HandoverConfig(), HandWatch(np.eye(4)))
    for _ in range(4):
        arm.go(goal, 1.0, 0.02)
    np.testing.assert_allclose([pose[0, 3] for pose in told], [0.02, 0.04, 0.05, 0.05])
    arm.hold(0.02)
    np.testing.assert_array_equal(told[-1], np.eye(4))
    tool[2, 3] = -0.01  # the tool sags
    arm.read()
    arm.hold(0.02)
    np.testing.assert_array_equal(told[-1], np.eye(4))  # holds where it began to
    arm.release()
    arm.hold(0.02)
    np.testing.assert_array_equal(told[-1], tool)
    goal = tool.copy()
    goal[:3, :3] = Rotation.from_euler("z", 1.0).as_matrix()
    for _ in range(2):
        arm.go(goal, 1.0, 0.02, factor=0.5)
    turns = [pose_distance(tool, pose)[1] for pose in told[-2:]]
    assert turns == pytest.approx([0.01, 0.02])  # half of 1 rad/s


def test_a_nearly_singular_arm_may_only_get_less_so(monkeypatch: pytest.MonkeyPatch) -> None:
    values = iter([0.006, 0.004, 0.0045, 0.003])
    arm = GuardedArm(SimulatedUR5(), HandoverConfig(), HandWatch(np.eye(4)))
    monkeypatch.setattr(ur5, "singularity", lambda _: next(values))
    arm.check_joints(0.0)
    with pytest.raises(HaltError, match=r"the arm is singular: .* 0\.0040 and falling"):
        arm.check_joints(0.02)
    arm.check_joints(0.04)
    with pytest.raises(HaltError, match=r"0\.0030 and falling"):
        arm.check_joints(0.06)


@pytest.mark.parametrize(("room", "may"), [(0.06, True), (0.04, False)])
def test_the_robot_is_told_its_speed_and_swings_only_with_room(
    room: float, may: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    arm = beside(np.zeros((21, 3)), np.zeros(3), monkeypatch, 0.0)
    told: list[dict[str, object]] = []
    arm.robot.servo_to = lambda *_, **how: told.append(how)  # type: ignore[method-assign]
    monkeypatch.setattr(GuardedArm, "free", lambda *_, **__: room)
    arm.go(np.eye(4), 0.2, 0.02, factor=0.5, swing=True)
    arm.go(np.eye(4), 0.2, 0.02)
    assert told == [{"speed": 0.1, "swing": may}, {"speed": 0.2, "swing": False}]


@pytest.mark.parametrize(
    ("age", "toward", "speed"),
    [(0.2, 0.1, 0.04), (0.0, 0.1, 0.2), (0.2, 0.0, 0.25)],
    ids=["both", "a picture of now", "a hand that stands"],
)
def test_beside_a_hand_its_speed_follows_from_the_hands_and_the_pictures_age(
    age: float, toward: float, speed: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By hand: of 60 mm 15 must stay and 10 are uncertainty; the hand takes its part of 35."""
    arm = beside(np.zeros((21, 3)), np.array([-toward, 0.0, 0.0]), monkeypatch, age)
    space = lambda _, hand=None: 0.060 + (0.0 if hand is None else hand[0, 0])  # noqa: E731
    monkeypatch.setattr(GuardedArm, "free", space)
    assert 0.25 * arm.allowed([], 0.015, 0.25) == pytest.approx(speed)


DOWN, UP, ALONG = np.array([[0, 0, -0.3], [0, 0, 0.3], [0.296, 0.032, 0.049]])


@pytest.mark.parametrize(
    ("velocity", "closing"),
    [(DOWN, 0.3), (UP, 0.0), (ALONG, 0.0)],
    ids=["straight for it", "away from it", "along it"],
)
def test_the_speed_of_a_hand_counts_toward_the_part_that_is_nearest(
    velocity: np.ndarray, closing: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the hand above the forearm the way to the tool point is another one."""
    arm = beside(hand_above_the_forearm(), velocity, monkeypatch, 0.1)
    forearm, free = ur5.link_surfaces(arm.reading.joints)[4:5], arm.free(arm.reading.tool)
    assert free == pytest.approx(float(links_gaps(forearm, person(arm.watch.keypoints)).min()))
    wanted = allowed_speed(free, closing, 0.1, 0.015, OFF)
    assert arm.allowed([arm.reading.tool], 0.015, 1.0) == pytest.approx(wanted, rel=0.05)


def test_a_hand_of_unknown_speed_counts_as_one_that_walks(monkeypatch: pytest.MonkeyPatch) -> None:
    arm = beside(np.zeros((21, 3)), None, monkeypatch, 0.1)
    monkeypatch.setattr(GuardedArm, "free", lambda *_, **__: 0.6)
    assert arm.allowed([], 0.015, 1.0) == pytest.approx(allowed_speed(0.6, 1.6, 0.1, 0.015, OFF))


def test_the_arms_links_are_asked_for_at_every_pose_of_a_way(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    arm = beside(hand_above_the_forearm(), None, monkeypatch, 0.1)
    tool = arm.reading.tool
    raised = tool.copy()
    raised[2, 3] += 0.04
    there = ur5.joints_toward(arm.reading.joints, raised @ np.linalg.inv(tool))
    nearest = float(links_gaps(ur5.link_surfaces(there), person(arm.watch.keypoints)).min())
    assert nearest < arm.free() - 0.01
    assert arm.free(tool, raised, tool) == pytest.approx(nearest)


@pytest.mark.parametrize("way", [None, np.array([1.0, 0.0, 0.0])], ids=["any", "on a way"])
def test_who_pulls_pulls_until_it_is_clearly_less(way: np.ndarray | None) -> None:
    """By hand: what is across a way counts by half. Noise about the limit changes nothing."""
    robot = SimulatedUR5()
    arm, felt = GuardedArm(robot, HandoverConfig(), HandWatch(np.eye(4))), []
    for force in (2.9, 3.1, 2.9, 3.1, 2.1, 1.9, 2.9, float("nan"), 3.1, float("nan"), 2.9):
        robot.wrench[1] = force if way is None else 2 * force
        arm.read()
        felt.append(arm.pull(way))
        assert arm.pull(way) == felt[-1]  # asked twice in a step
    assert felt == pytest.approx([0, 3.1, 2.9, 3.1, 2.1, 0, 0, 0, 3.1, 0, 0])
