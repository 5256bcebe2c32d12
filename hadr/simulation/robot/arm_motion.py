"""Where the arm goes next: differential inverse kinematics as a quadratic program.

The tool goes straight where it can, else the joints turn evenly, to another branch of solutions or
past the home pose. Every limit is a row of the program, see `hadr.simulation.robot.motion_limits`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import mink
import numpy as np

from hadr.camera import Array
from hadr.handover import ur5
from hadr.handover.poses import between, norm, pose_distance
from hadr.handover.robot import UnreachableError
from hadr.handover.simulated_ur5 import HOME_JOINTS, TOOL_SPEED, ArmConfig, solutions_by_way
from hadr.simulation.robot.arm_model import kinematic_model, pose_of
from hadr.simulation.robot.motion_limits import MotionConfig, MotionRows

TOOL_ACCELERATION = 0.8
"""How hard the tool slows down before its target, m/s2."""
LEAST_SINGULAR_VALUE = 0.005
"""A straight way past a pose of a smaller `hadr.handover.ur5.singularity` leads nowhere, and such a
pose counts as out of reach."""


@dataclass
class ArmMotion:
    """The commanded motion: joint angles (6,) and velocities now, radians, and the way to a target.

    `arm` has its settings, `motion` how it may move.
    """

    arm: ArmConfig
    motion: MotionConfig = field(default_factory=MotionConfig)

    def __post_init__(self) -> None:
        model = kinematic_model()
        self.joints, self.velocity = HOME_JOINTS.copy(), np.zeros(6)
        self._configuration = mink.Configuration(model, self.joints)
        self._trial = mink.Configuration(model, self.joints)
        self.rows = MotionRows(model, self.arm, self.motion)
        self._site = model.site("tool").id
        self._frame = mink.FrameTask("tool", "site", position_cost=1.0, orientation_cost=0.3)
        self._posture = mink.PostureTask(model, cost=0.02)
        self._goal: Array | None = None
        self._goal_pose = np.zeros((4, 4))
        self._way = [self.joints]
        self._start = np.zeros(3)
        self._idle, self._best, self._by_joints = 0.0, np.inf, False

    def pose(self) -> Array:
        """The commanded base_from_tool (4, 4), metres."""
        return pose_of(self._configuration.data.site(self._site))

    def joint_goals(self, base_from_tool: Array, near: Array | None = None) -> Iterator[Array]:
        """Joint angles (6,) that reach a pose (4, 4) within every limit, the shortest way first.

        The way begins at joint angles `near`, or where the arm stands. UnreachableError, where none
        keeps every limit, names one of them.
        """
        problems = []
        for joints in solutions_by_way(base_from_tool, self.joints if near is None else near):
            self._trial.update(joints)
            problems.append(self.rows.broken(self._trial))
            if not problems[-1]:
                yield joints
        if all(problems):
            raise UnreachableError(f"no joint angles keep every limit: {problems[0]}")

    def _plan(self, target: Array, *, swing: bool) -> None:
        """Choose joint angles for a target, and the way: straight, or else in joint space."""
        if not swing and self._by_joints:
            self._by_joints, self._goal = False, None
        moved = (1.0, 1.0) if self._goal is None else pose_distance(self._goal_pose, target)
        if moved[0] < 0.005 and moved[1] < 0.03:
            return
        if self._goal is not None and moved[0] < 0.10 and moved[1] < 0.5:
            goal = next(self.joint_goals(target, self._goal))
            if np.abs(goal - self._goal).max() < 1.0:
                self._way[-1] = self._goal = goal
                self._goal_pose = target.copy()
                return
        end = self.straight_way(target)
        away = pose_distance(self.pose(), target)
        if end is None and (not swing or (away[0] < 0.06 and away[1] < 0.35)):
            end = self.joints.copy()  # all but there: no other branch
        if end is None:
            self._find_way(target)
        else:
            self._goal, self._goal_pose, self._way = end, target.copy(), [end]
        self._by_joints, self._best, self._idle = end is None, np.inf, 0.0
        self._start = self.pose()[:3, 3].copy()

    def straight_way(self, target: Array) -> Array | None:
        """Joint angles (6,) at the end of the tool's straight way, None where it leads nowhere.

        Nor does it past a nearly singular pose. UnreachableError: the target breaks a limit.
        """
        next(self.joint_goals(target))
        here = self.pose()
        distance, angle = pose_distance(here, target)
        count = int(np.ceil(max(distance / 0.04, angle / 0.2, 3.0)))
        joints = self.joints
        for share in np.arange(1, count + 1) / count:
            try:
                goal = next(self.joint_goals(between(here, target, share), joints))
            except UnreachableError:
                return None
            if np.abs(goal - joints).max() > 0.7 or ur5.singularity(goal) < LEAST_SINGULAR_VALUE:
                return None
            joints = goal
        return joints

    def _find_way(self, target: Array) -> None:
        """Look for a way in joint space that keeps every limit, rather a nowhere singular one."""
        goals = list(self.joint_goals(target))
        ways = [[goal] for goal in goals] + [[HOME_JOINTS, goal] for goal in goals]
        free = (
            way for least in (LEAST_SINGULAR_VALUE, 0.0) for way in ways if self._free(way, least)
        )
        self._way = next(free, ways[len(goals)])
        self._goal, self._goal_pose = self._way[-1], target.copy()

    def _free(self, way: list[Array], least: float) -> bool:
        """Whether turning evenly past these points keeps every limit, and off singular poses."""
        start = self.joints
        for end in way:
            count = int(np.ceil(np.abs(end - start).max() / 0.2))
            for share in np.arange(1, count) / max(count, 1):
                joints = start + share * (end - start)
                self._trial.update(joints)
                if ur5.singularity(joints) < least or self.rows.broken(self._trial):
                    return False
            start = end
        return True

    def advance(
        self, target: Array, dt: float, *, speed: float = TOOL_SPEED, swing: bool = True
    ) -> None:
        """Move the command toward a tool pose (4, 4) for one step of dt seconds.

        The tool point is at most so fast, m/s; an arm that may not swing goes straight or stands.
        UnreachableError where the target breaks a limit; the command has not changed then.
        """
        self._plan(target, swing=swing)
        self.rows.tool_speed = min(speed, TOOL_SPEED)
        now = self.pose()
        distance, angle = pose_distance(now, target)
        self._choose_way(target, distance, angle, dt, swing=swing)
        self._frame.set_target(mink.SE3.from_matrix(self._reference(now, target, dt)))
        way = (self._way[0] if self._by_joints else self._way[-1]) - self.joints
        longest = float(np.abs(way).max())
        turn = self.rows.speed * min(1.0, speed / TOOL_SPEED)
        fast = _slowing(longest, turn, 0.5 * self.rows.acceleration, dt)
        self._posture.set_target(self.joints + way * fast * dt / max(longest, 1e-9))
        tasks = [self._posture] if self._by_joints else [self._frame, self._posture]
        self.rows.velocity = self.velocity
        try:
            velocity = mink.solve_ik(
                self._configuration, tasks, dt, "daqp", damping=1e-7, limits=[self.rows]
            )
        except mink.NoSolutionFound:
            velocity = self.velocity * (1.0 - dt / self.rows.braking_time)
        self._speed_up(velocity, dt)

    def _reference(self, now: Array, target: Array, dt: float) -> Array:
        """The tool pose for the next moment, on the way's line; slower while joints push it off."""
        c = self.motion
        moving = self._configuration.get_frame_jacobian("tool", "site") @ self.velocity
        speed, spin = norm(moving[:3]), norm(moving[3:])
        line = target[:3, 3] - self._start
        left = target[:3, 3] - now[:3, 3]
        length = norm(line)
        along = line * ((left @ line) / length**2) if length > 0.01 else left
        aside = left - along
        ahead, off = norm(along), norm(aside)
        fast = min(
            _slowing(ahead, self.rows.tool_speed, TOOL_ACCELERATION, dt) / (1 + off / 0.004),
            speed + TOOL_ACCELERATION * dt,
        )
        back = _slowing(off, TOOL_SPEED / 2, TOOL_ACCELERATION, dt)
        angle = pose_distance(now, target)[1]
        turn = min(
            _slowing(angle, c.turn_speed, c.turn_acceleration, dt), spin + c.turn_acceleration * dt
        )
        pose = between(now, target, turn * dt / max(angle, 1e-9))
        pose[:3, 3] = (
            now[:3, 3] + (fast / max(ahead, 1e-9) * along + back / max(off, 1e-9) * aside) * dt
        )
        return pose

    def brake(self, dt: float, acceleration: float) -> None:
        """Slow all joints down in step for dt seconds, at most at an acceleration in rad/s2."""
        fastest = float(np.abs(self.velocity).max())
        velocity = self.velocity * max(0.0, 1.0 - acceleration * dt / max(fastest, 1e-12))
        self._speed_up(velocity, dt)

    def _speed_up(self, velocity: Array, dt: float) -> None:
        """Come to joint velocities (6,) in dt seconds, evenly: at the rows' acceleration."""
        self.put(self.joints + (self.velocity + velocity) / 2 * dt, velocity)

    def forget(self) -> None:
        """Look for a way anew at the next call: the arm was stopped on the one before."""
        self._goal = None

    def put(self, joints: Array, velocity: Array) -> None:
        """Say where the command stands: joint angles (6,) and velocities (6,)."""
        self.joints, self.velocity = joints, velocity
        self._configuration.update(joints)

    def _choose_way(
        self, target: Array, distance: float, angle: float, dt: float, *, swing: bool
    ) -> None:
        """A straight way that comes no nearer gives way to one in joint space, where it may."""
        if self._by_joints:
            if np.abs(self._way[0] - self.joints).max() < 0.05:
                self._by_joints = len(self._way) > 1
                self._start = self.pose()[:3, 3].copy()
                self._way = self._way[-1:]
            return
        left = distance + 0.1 * angle
        arrived = distance < 0.002 and angle < 0.02
        self._idle = 0.0 if arrived or left < self._best - 0.03 * dt else self._idle + dt
        self._best = min(left, self._best) if self._idle else left
        if self._idle > 0.3 and swing:
            self._find_way(target)
            self._by_joints, self._idle, self._best = True, 0.0, np.inf


def _slowing(distance: float, speed: float, acceleration: float, dt: float) -> float:
    """Speed at a distance from the target so that it is reached without overshoot."""
    return min(speed, float(np.sqrt(2 * acceleration * distance)), distance / (3 * dt))
