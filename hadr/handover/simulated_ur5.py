"""A UR5 that moves in time without physics: as told, within its limits."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hadr.camera import Array
from hadr.handover import ur5
from hadr.handover.grasping.gripper import FLANGE_FROM_TOOL, LARGEST_OPENING
from hadr.handover.poses import check_pose
from hadr.handover.robot import UnreachableError

HOME_JOINTS: Array = np.deg2rad([5.99, -130.74, 121.43, 9.32, 95.99, 0.0])
"""Waiting pose: elbow up, the tool at (0.34, 0.12, 0.38) m, level and facing forward along x."""

WORKSPACE = (-0.85, -0.85, 0.05), (1.0, 0.85, 1.1)
"""The box in the base frame that the tool point may not leave: two corners, metres."""
SOFT = 0.001
"""The fingers' pads press on what is narrower by so much than they are apart, metres."""
TABLE = 0.03
"""Height that no part of the arm beyond the shoulder may go below, metres."""
TOOL_SPEED = 0.25
"""Largest speed of the tool point, m/s: ISO 10218-1's reduced speed."""
SWING = 1.0
"""A joint that turns farther than this, radians, swings the arm to another posture."""
JOINT_ACCELERATION = 5.0
"""Largest acceleration of a joint, rad/s2: our choice, as the physical arm's."""


@dataclass(frozen=True)
class ArmConfig:
    """Settings of the simulated arm.

    Attributes:
        speed_fraction: Part of the joints' top speed (180 degrees per second) that is used;
            a quarter is slow enough to be watched beside a person.
        finger_speed: Speed of opening and closing, metres per second.
    """

    speed_fraction: float = 0.25
    finger_speed: float = 0.1

    def __post_init__(self) -> None:
        if not 0 < self.speed_fraction <= 1:
            raise ValueError(f"speed_fraction must lie in (0, 1], got {self.speed_fraction}")


def solutions_by_way(base_from_tool: Array, start: Array) -> Array:
    """Joint angles (n, 6) for a tool pose (4, 4), limits unchecked, the shortest way first."""
    target = check_pose(base_from_tool, "base_from_tool")
    flange = ur5.BASE_LINK_FROM_DH_BASE @ target @ np.linalg.inv(FLANGE_FROM_TOOL)
    found = ur5.inverse_kinematics(flange, free_angle=float(start[5]))
    found = ur5.nearest_turns(found, start)
    by_way: Array = found[np.abs(found - start).max(axis=1).argsort(kind="stable")]
    return by_way


def in_workspace(point: Array, margin: float = 0.0) -> bool:
    """Say whether a point (3,) lies in the `WORKSPACE`, by a margin; metres."""
    low, high = np.add(WORKSPACE[0], margin), np.subtract(WORKSPACE[1], margin)
    return bool(np.all(point >= low) and np.all(point <= high))


def broken_limit(
    joints: Array, tool: Array, to_flange: Array, lowest: float, margin: float = 0.0
) -> str:
    """Name the limit that joint angles (6,) break, or return an empty string.

    Of them come the tool point (3,), in the workspace by a margin, the way to the flange (3,) from
    the shoulder, and the height of the lowest link beyond it; metres, base frame.
    """
    if np.any(joints < ur5.JOINT_LOWER) or np.any(joints > ur5.JOINT_UPPER):
        return f"joint angles {np.round(joints, 3)} rad lie outside the joint limits"
    if not in_workspace(tool, margin):
        return f"tool point {np.round(tool, 3)} m lies outside the workspace box"
    reach = float(np.linalg.norm(to_flange))
    if reach > ur5.REACH:
        return f"flange {reach:.3f} m from the shoulder, reach is {ur5.REACH} m"
    if lowest < TABLE:
        return f"a link would be at height {lowest:.3f} m, the table at {TABLE} m"
    return ""


class SimulatedUR5:
    """A UR5 that moves as told, as fast as joints and tool may: no forces, no inertia.

    Attributes:
        between_fingers: Width of what stands between the fingers, metres: they close no further.
            Whoever knows the object sets it; there is no contact in this arm.
        wrench: What `tool_wrench` returns. Whoever plays a hand that pulls sets it.
        protective_stop: Empty, as this arm feels no force. Whoever plays one writes its reason
            here, and clears it as a person would.
    """

    def __init__(self, config: ArmConfig | None = None) -> None:
        self.config = config or ArmConfig()
        self._joints, self._velocity = HOME_JOINTS.copy(), np.zeros(6)
        self._opening = self._target_opening = LARGEST_OPENING
        self._stopped = False
        self._force = 0.0
        self.between_fingers = 0.0
        self.wrench: Array = np.zeros(6)
        self.protective_stop = ""

    def tool_pose(self) -> Array:
        """Return base_from_tool now, shape (4, 4), metres."""
        return self.tool_pose_at(self._joints)

    def tool_pose_at(self, joints: Array) -> Array:
        """Return base_from_tool for joint angles (6,) in radians, shape (4, 4), metres."""
        flange = ur5.forward_kinematics(joints)
        return ur5.BASE_LINK_FROM_DH_BASE @ flange @ FLANGE_FROM_TOOL

    def joint_positions(self) -> Array:
        """Return the six joint angles now, radians."""
        return self._joints.copy()

    def outline(self) -> Array:
        """Return points along the links in the base frame, shape (9, 3), metres."""
        rotation = ur5.BASE_LINK_FROM_DH_BASE[:3, :3]
        points: Array = ur5.link_outline(self._joints) @ rotation.T
        return points

    def joint_solutions(self, base_from_tool: Array) -> Array:
        """Joint angles (n, 6) that reach a tool pose (4, 4) within every limit, nearest first.

        UnreachableError, where none is left, names the limit that the nearest breaks.
        """
        return np.array(list(self._within_limits(base_from_tool)))

    def joints_at(self, base_from_tool: Array) -> Array:
        """Return the nearest joint angles (6,) for a tool pose, see `joint_solutions`."""
        return next(self._within_limits(base_from_tool))

    def _within_limits(self, base_from_tool: Array) -> Iterator[Array]:
        found, kept = solutions_by_way(base_from_tool, self._joints), 0
        for joints in found:
            if not self._broken_limit(joints):
                kept += 1
                yield joints
        if not kept:
            problem = self._broken_limit(found[0])
            raise UnreachableError(f"no joint angles keep every limit: {problem}")

    def reachable(self, base_from_tool: Array) -> bool:
        """Say whether the tool could stand at this pose, shape (4, 4), within all limits."""
        try:
            self.joint_solutions(base_from_tool)
        except UnreachableError:
            return False
        return True

    def straight_way(self, base_from_tool: Array) -> bool:
        """Say whether the tool could stand at a pose: this arm's joints go there evenly."""
        return self.reachable(base_from_tool)

    def servo_to(
        self, base_from_tool: Array, dt: float, *, speed: float = TOOL_SPEED, swing: bool = True
    ) -> None:
        """Move toward a tool pose (4, 4) for dt seconds, at most 0.1, all joints in step.

        The tool point is at most so fast, m/s. An arm that shall not swing stands where a joint
        would turn by more than `SWING`. Where the arm may not go on it brakes; before a limit it
        stands at once. UnreachableError where the target, or the next point on the way to it,
        breaks a limit; ValueError for no rigid transform, or dt out of range.
        """
        if not 0 < dt <= 0.1:
            raise ValueError(f"dt must be more than 0 and at most 0.1 seconds, got {dt}")
        if self._stopped or self.protective_stop:
            self._speed_up(np.zeros(6), dt)
            return
        try:
            goal = self.joints_at(base_from_tool)
        except UnreachableError:
            self._speed_up(np.zeros(6), dt)
            raise
        way = goal - self._joints
        longest = max(float(np.abs(way).max()), 1e-12)
        if longest > SWING and not swing:
            self._speed_up(np.zeros(6), dt)
            return
        # so fast that from the end of this step on it can brake before the goal
        braking = JOINT_ACCELERATION * (np.sqrt(dt**2 + 2 * longest / JOINT_ACCELERATION) - dt)
        turn = min(ur5.JOINT_SPEED * self.config.speed_fraction, float(braking))
        problem = self._speed_up(way * turn / longest, dt, speed)
        if problem:
            raise UnreachableError(f"the way to the target breaks a limit: {problem}")
        self._move_fingers(dt)

    def _speed_up(self, wanted: Array, dt: float, speed: float = TOOL_SPEED) -> str:
        """Come nearer to joint velocities (6,) and move with them; name a limit that stops it.

        They are less where the tool point would be faster than a speed, m/s.
        """
        change = self._slowed(wanted, min(speed, 0.9 * TOOL_SPEED), dt) - self._velocity
        most = JOINT_ACCELERATION * dt / max(float(np.abs(change).max()), 1e-12)
        velocity = self._slowed(self._velocity + min(1.0, most) * change, TOOL_SPEED, dt)
        problem = self._broken_limit(self._joints + velocity * dt)
        self._velocity = np.zeros(6) if problem else velocity
        self._joints = self._joints + self._velocity * dt
        return problem

    def _slowed(self, velocity: Array, speed: float, dt: float) -> Array:
        """Joint velocities (6,), all smaller where the tool point would move faster than that."""
        ahead = self.tool_pose_at(self._joints + velocity * dt)[:3, 3]
        way = float(np.linalg.norm(ahead - self.tool_pose()[:3, 3]))
        return velocity * min(1.0, speed * dt / max(way, 1e-12))

    def stop(self) -> None:
        """Stand still at once; later commands do nothing until `release`."""
        self._stopped, self._velocity = True, np.zeros(6)

    def release(self) -> None:
        """Let the arm move again after a stop, from rest."""
        self._stopped = False

    def set_gripper(self, width: float, force: float) -> None:
        """Open or close the fingers to a width in metres; the force in newtons is what they feel.

        ValueError for a width that is not finite or lies outside 0 to the largest opening.
        """
        if not 0 <= width <= LARGEST_OPENING:
            raise ValueError(
                f"gripper width must lie between 0 and {LARGEST_OPENING} m, got {width}"
            )
        self._target_opening, self._force = width, force

    def gripper_width(self) -> float:
        """Return the distance between the fingers now, metres."""
        return self._opening

    def finger_force(self) -> float:
        """Return the fingers' force, newtons, where something keeps them from closing."""
        pressed = self._target_opening < self._opening <= self.between_fingers + SOFT
        return self._force if pressed else 0.0

    def tool_wrench(self) -> Array:
        """Return `wrench`, shape (6,): nothing is touched without physics."""
        return self.wrench.copy()

    def _move_fingers(self, dt: float) -> None:
        step = self.config.finger_speed * dt
        blocked = min(self._opening, self.between_fingers)
        goal = max(self._target_opening, blocked)
        self._opening += float(np.clip(goal - self._opening, -step, step))

    def _broken_limit(self, joints: Array) -> str:
        """Name the limit that joint angles (6,) break, or return an empty string."""
        links, tool = ur5.link_capsules(joints), self.tool_pose_at(joints)[:3, 3]
        lowest = (np.minimum(links[2:, 2], links[2:, 5]) - links[2:, 6]).min()
        return broken_limit(joints, tool, links[-1, 3:6] - links[0, 3:6], lowest)
