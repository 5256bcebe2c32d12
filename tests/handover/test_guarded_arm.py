"""The reference that runs before the tool."""

from types import SimpleNamespace

import numpy as np

from hadr.handover.guarded_arm import GuardedArm
from hadr.handover.observation import HandWatch
from hadr.handover.safety import SafetyConfig
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
