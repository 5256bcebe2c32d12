"""The reference that runs before the tool, and how fast it may beside a hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from hadr.handover.guarded_arm import GuardedArm
from hadr.handover.observation import HandWatch
from hadr.handover.safety import SafetyConfig
from hadr.handover.simulated_ur5 import SimulatedUR5
from hadr.handover.stages import HandoverConfig


def test_the_reference_moves_at_its_speed_and_does_not_run_ahead() -> None:
    tool, goal, told = np.eye(4), np.eye(4), []
    goal[0, 3] = 1.0
    robot = SimpleNamespace(
        tool_pose=tool.copy, joint_positions=lambda: np.zeros(6), gripper_width=lambda: 0.08,
        protective_stop="", servo_to=lambda pose, dt: told.append(pose.copy()),
        release=lambda: None, finger_force=lambda: 0.0, tool_wrench=lambda: np.zeros(6),
    )  # fmt: skip
    arm = GuardedArm(robot, HandoverConfig(), HandWatch(np.eye(4), SafetyConfig()))
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


@pytest.mark.parametrize(
    ("age", "toward", "speed"),
    [(0.2, 0.1, 0.04), (0.0, 0.1, 0.2), (0.2, 0.0, 0.25)],
    ids=["both", "a picture of now", "a hand that stands"],
)
def test_beside_a_hand_its_speed_follows_from_the_hands_and_the_pictures_age(
    age: float, toward: float, speed: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By hand: of 60 mm 15 must stay and 10 are uncertainty; the hand takes its part of 35."""
    arm = GuardedArm(SimulatedUR5(), HandoverConfig(), HandWatch(np.eye(4), SafetyConfig()))
    tool = arm.reading.tool[:3, 3]
    arm.watch.keypoints = np.zeros((21, 3))
    monkeypatch.setattr(GuardedArm, "free", lambda *_: 0.060)
    monkeypatch.setattr(HandWatch, "middle", tool + np.array([0.2, 0.0, 0.0]))
    monkeypatch.setattr(HandWatch, "velocity", lambda *_: np.array([-toward, 0.0, 0.0]))
    monkeypatch.setattr(HandWatch, "age", age)
    assert 0.25 * arm.allowed([], 0.015, 0.25) == pytest.approx(speed)
