"""What a robot must offer to the handover.

The workflow knows only `Robot`. `hadr.handover.simulated_ur5`, a driver for a real arm and a
physics engine offer the same methods. Poses are written in the robot's base frame (ROS
`base_link`: x forward, z up) and end at the gripper's tool point, whose z axis points out of the
gripper: the approach axis. Joint angles are those of a UR5: from them the guard knows where wrist
and forearm are, and how nearly singular the arm is.
"""

from typing import Protocol

from hadr.camera import Array

UNLOCK_AFTER = 5.0
"""The simulated person releases a protective stop after this time, seconds: no sooner does a UR5's
dashboard server let anyone ("Cannot unlock protective stop until 5s after occurrence")."""


class UnreachableError(ValueError):
    """No joint angles bring the arm to the target; the message says what stands in the way."""


class Robot(Protocol):
    """An arm with a parallel gripper, seen from the workflow."""

    def tool_pose(self) -> Array:
        """Return base_from_tool now, shape (4, 4), metres."""

    def joint_positions(self) -> Array:
        """Return the joint angles now, shape (6,), radians."""

    def joints_at(self, base_from_tool: Array) -> Array:
        """Return the joint angles (6,) with which it would stand there; `UnreachableError`."""

    def reachable(self, base_from_tool: Array) -> bool:
        """Say whether the tool could stand at this pose, shape (4, 4), within all limits."""

    def straight_way(self, base_from_tool: Array) -> bool:
        """Say whether it could go from here to a pose, shape (4, 4), without a detour."""

    def servo_to(
        self, base_from_tool: Array, dt: float, *, speed: float = ..., swing: bool = True
    ) -> None:
        """Move toward a tool pose, shape (4, 4), for dt seconds, keeping every limit.

        The tool point is at most so fast, m/s, whichever way the arm takes. Where the tool cannot
        go straight the arm may swing through other poses, or stands if it shall not.
        """

    def stop(self) -> None:
        """Stand still; no later command moves the arm until `release`."""

    def release(self) -> None:
        """Let the arm move again after `stop`. From a protective stop only a person releases it."""

    @property
    def protective_stop(self) -> str:
        """Why the arm stopped by itself and stands until a person releases it there; else empty."""

    def set_gripper(self, width: float, force: float) -> None:
        """Open or close the fingers to a width in metres, pressing by at most a force, newtons."""

    def gripper_width(self) -> float:
        """Return the distance between the fingers now, metres."""

    def finger_force(self) -> float:
        """Return how hard both fingers press on what is between them, newtons; 0: on nothing."""

    def tool_wrench(self) -> Array:
        """Return force and torque about the tool point on the gripper, shape (6,), base frame.

        Newtons and newton metres, less the gripper's own weight, as of a zeroed sensor.
        """
