"""Where the arm goes next: differential inverse kinematics as a quadratic program.

Every limit is a row of the program, so that the answer needs no clipping afterwards. A row bounds
how fast a distance may shrink by distance / braking time. As no joint takes longer than that to
stand still, slowing all joints down in step keeps every row: the program always has an answer.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product

import mink
import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from hadr.handover import ur5
from hadr.handover.arm_model import GRIPPER_GEOMS, kinematic_model
from hadr.handover.robot import ArmConfig
from hadr.handover.ur5 import Array, UnreachableError


@dataclass(frozen=True)
class MotionConfig:
    """How the arm may move.

    Attributes:
        joint_acceleration: Largest acceleration of a joint, rad/s2.
        tool_speed: Largest speed of the tool point, m/s.
        tool_acceleration: How hard the tool slows down before its target, m/s2.
        turn_speed: Largest speed of the tool's rotation on a straight way, rad/s.
        turn_acceleration: How hard the rotation slows down, rad/s2.
        clearance: Free space that links and gripper keep to each other and to the table, metres.
        margin: The commanded tool point stays this far inside the workspace box, metres.
        posture_weight: Pull of the chosen joint angles beside that of the straight way.
    """

    joint_acceleration: float = 5.0
    tool_speed: float = 0.35
    tool_acceleration: float = 0.8
    turn_speed: float = 1.5
    turn_acceleration: float = 4.0
    clearance: float = 0.008
    margin: float = 0.004
    posture_weight: float = 0.02

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be a positive number, got {value}")


def _directions() -> Array:
    """Thirteen axes whose 26 half spaces hold a ball: the tool's speed is bounded along each."""
    rows = [np.array(d, dtype=np.float64) for d in product((-1, 0, 1), repeat=3) if d > (0, 0, 0)]
    return np.array([row / np.linalg.norm(row) for row in rows])


_DIRECTIONS = _directions()
_ROUNDNESS = 0.89
"""The 26 half spaces at this distance lie in the ball of radius 1."""
_LOW_PARTS = ("forearm", "forearm_1", "wrist_1", "wrist_2", "wrist_3", *GRIPPER_GEOMS)


class MotionRows(mink.Limit):  # type: ignore[misc]
    """All limits as rows G dq <= h; see the module's text for why they never contradict."""

    def __init__(self, model: mujoco.MjModel, arm: ArmConfig, motion: MotionConfig) -> None:
        self.arm, self.motion = arm, motion
        self.speed = ur5.JOINT_SPEED * arm.speed_fraction
        self.braking_time = max(0.2, 1.1 * self.speed / motion.joint_acceleration)
        self.velocity: Array = np.zeros(6)
        self._tool = model.site("tool").id
        names = [model.site(i).name for i in range(model.nsite)]
        self._points = [i for i, name in enumerate(names) if "_point_" in name]
        self._flange = model.site("wrist_3_point_0").id
        self._shoulder = np.array([0.0, 0.0, ur5.DH_D[0]])
        wrist = ("wrist_1", "wrist_2", "wrist_3", *GRIPPER_GEOMS)
        self._apart = mink.CollisionAvoidanceLimit(
            model,
            [
                (("base", "shoulder", "shoulder_1"), ("forearm", *wrist)),
                (("upper_arm",), wrist),
                (("forearm", "forearm_1"), ("wrist_3", *GRIPPER_GEOMS)),
                (("table",), _LOW_PARTS),
            ],
            minimum_distance_from_collisions=motion.clearance,
            collision_detection_distance=0.2,
        )

    def broken(self, configuration: mink.Configuration) -> str:
        """Name the limit that a configuration breaks, or return an empty string."""
        data, space = configuration.data, self.arm.workspace
        joints = data.qpos
        if np.any(joints < ur5.JOINT_LOWER) or np.any(joints > ur5.JOINT_UPPER):
            return f"joint angles {np.round(joints, 3)} rad lie outside the joint limits"
        tool = data.site_xpos[self._tool]
        m = self.motion.margin
        if not (np.all(tool >= np.add(space.lower, m)) and np.all(tool <= np.add(space.upper, -m))):
            return f"tool point {np.round(tool, 3)} m lies outside the workspace box"
        reach = float(np.linalg.norm(data.site_xpos[self._flange] - self._shoulder))
        if reach > ur5.REACH:
            return f"flange {reach:.3f} m from the shoulder, reach is {ur5.REACH} m"
        lowest = float(data.site_xpos[self._points, 2].min())
        if lowest < space.table:
            return f"a link would be at height {lowest:.3f} m, the table at {space.table} m"
        model = configuration.model
        for first, second in self._apart.geom_id_pairs:
            gap = mujoco.mj_geomDistance(model, data, first, second, 0.02, None)
            if gap < self.motion.clearance:
                names = f"{model.geom(first).name} and {model.geom(second).name}"
                return f"{names} would be {1000 * gap:.0f} mm apart"
        return ""

    def compute_qp_inequalities(
        self, configuration: mink.Configuration, dt: float
    ) -> mink.Constraint:
        """Rows for one step of dt seconds from a configuration."""
        model, data, space = configuration.model, configuration.data, self.arm.workspace
        share = dt / self.braking_time
        step = self.motion.joint_acceleration * dt
        up = np.minimum(self.speed, self.velocity + step) * dt
        up = np.minimum(up, (ur5.JOINT_UPPER - data.qpos) * share)
        down = np.minimum(self.speed, step - self.velocity) * dt
        down = np.minimum(down, (data.qpos - ur5.JOINT_LOWER) * share)
        tool = self._jacobian(model, data, self._tool)
        place, m = data.site_xpos[self._tool], self.motion.margin
        along = _DIRECTIONS @ tool
        fast = np.full(len(along), self.motion.tool_speed * _ROUNDNESS * dt)
        heights = np.stack([self._jacobian(model, data, i)[2] for i in self._points])
        above = (data.site_xpos[self._points, 2] - space.table) * share
        away = data.site_xpos[self._flange] - self._shoulder
        reach = float(np.linalg.norm(away))
        out = (away / reach) @ self._jacobian(model, data, self._flange)
        self._apart.gain = share
        apart = self._apart.compute_qp_inequalities(configuration, dt)
        near = np.isfinite(apart.h)
        rows = [np.eye(6), -np.eye(6), tool, -tool, along, -along, -heights, out[None]]
        bounds = [up, down]
        bounds += [(np.asarray(space.upper) - m - place) * share]
        bounds += [(place - np.asarray(space.lower) - m) * share]
        bounds += [fast, fast, above, np.array([(ur5.REACH - reach) * share])]
        G = np.concatenate([*rows, apart.G[near]])
        h = np.concatenate([*bounds, apart.h[near]])
        # curvature may make braking miss a row by micrometres: braking is always allowed
        braking = self.velocity * (1.0 - share) * dt
        return mink.Constraint(G, np.maximum(h, G @ braking + 1e-12))

    def _jacobian(self, model: mujoco.MjModel, data: mujoco.MjData, site: int) -> Array:
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jacSite(model, data, jacobian, None, site)
        return jacobian


@dataclass
class ArmMotion:
    """The commanded motion: joint angles and velocities now, and the way to a target.

    Attributes:
        arm: Settings of the arm.
        motion: How it may move.
        joints: Commanded joint angles, shape (6,), radians.
        velocity: Commanded joint velocities, shape (6,), rad/s.
    """

    arm: ArmConfig
    motion: MotionConfig = field(default_factory=MotionConfig)
    joints: Array = field(init=False)
    velocity: Array = field(init=False)

    def __post_init__(self) -> None:
        model = kinematic_model(self.arm)
        self.joints, self.velocity = self.arm.home.copy(), np.zeros(6)
        self._configuration = mink.Configuration(model, self.joints)
        self._trial = mink.Configuration(model, self.joints)
        self.rows = MotionRows(model, self.arm, self.motion)
        self._site = model.site("tool").id
        self._frame = mink.FrameTask("tool", "site", position_cost=1.0, orientation_cost=0.3)
        self._posture = mink.PostureTask(model, cost=self.motion.posture_weight)
        self._goal: Array | None = None
        self._goal_pose = np.zeros((4, 4))
        self._idle, self._by_joints = 0.0, False
        problem = self.rows.broken(self._configuration)
        if problem:
            raise UnreachableError(f"the home pose is not allowed: {problem}")

    def tool_pose_at(self, joints: Array) -> Array:
        """Return base_from_tool (4, 4) in metres for joint angles (6,) in radians."""
        self._trial.update(joints)
        return self._pose(self._trial)

    def joint_goal(self, base_from_tool: Array) -> Array:
        """Joint angles (6,) that reach a pose within every limit, the shortest way first.

        Args:
            base_from_tool: Target, shape (4, 4), metres.

        Raises:
            UnreachableError: None keeps every limit; the message names one of them.
            ValueError: The target is no rigid transform.
        """
        target = ur5.check_pose(base_from_tool, "base_from_tool")
        flange = ur5.BASE_LINK_FROM_DH_BASE @ target @ np.linalg.inv(self.arm.flange_from_tool)
        found = ur5.inverse_kinematics(flange, free_angle=float(self.joints[5]))
        found = ur5.nearest_turns(found, self.joints)
        problems = []
        for row in np.abs(found - self.joints).max(axis=1).argsort(kind="stable"):
            self._trial.update(found[row])
            problems.append(self.rows.broken(self._trial))
            if not problems[-1]:
                goal: Array = found[row]
                return goal
        raise UnreachableError(f"no joint angles keep every limit: {problems[0]}")

    def advance(self, base_from_tool: Array, dt: float) -> None:
        """Move the command toward a tool pose for one step of dt seconds.

        Raises:
            UnreachableError: The target breaks a limit; the command has not changed.
            ValueError: The target is no rigid transform.
        """
        target = ur5.check_pose(base_from_tool, "base_from_tool")
        moved = _difference(self._goal_pose, target) if self._goal is not None else (1.0, 1.0)
        if moved[0] > 0.005 or moved[1] > 0.03:
            self._goal, self._goal_pose = self.joint_goal(target), target.copy()
        goal = self._goal
        assert goal is not None  # found above, or earlier for nearly this target
        now = self._pose(self._configuration)
        c = self.motion
        distance, angle = _difference(now, target)
        self._choose_way(distance, angle, float(np.abs(goal - self.joints).max()), dt)
        shift = _slowing(distance, c.tool_speed, c.tool_acceleration, dt) * dt / max(distance, 1e-9)
        turn = _slowing(angle, c.turn_speed, c.turn_acceleration, dt) * dt / max(angle, 1e-9)
        reference = _between(now, target, shift, turn)
        self._frame.set_target(mink.SE3.from_matrix(reference))
        way = goal - self.joints
        longest = float(np.abs(way).max())
        fast = _slowing(longest, self.rows.speed, 0.5 * c.joint_acceleration, dt)
        self._posture.set_target(self.joints + way * fast * dt / max(longest, 1e-9))
        tasks = [self._posture] if self._by_joints else [self._frame, self._posture]
        self.rows.velocity = self.velocity
        try:
            velocity = mink.solve_ik(
                self._configuration, tasks, dt, "daqp", damping=1e-7, limits=[self.rows]
            )
        except mink.NoSolutionFound:
            velocity = self.velocity * (1.0 - dt / self.rows.braking_time)
        self.put(self.joints + velocity * dt, velocity)

    def brake(self, dt: float, acceleration: float) -> None:
        """Slow all joints down in step for dt seconds, at most at an acceleration in rad/s2."""
        fastest = float(np.abs(self.velocity).max())
        velocity = self.velocity * max(0.0, 1.0 - acceleration * dt / max(fastest, 1e-12))
        self.put(self.joints + velocity * dt, velocity)

    def put(self, joints: Array, velocity: Array) -> None:
        """Say where the command stands: joint angles (6,) and velocities (6,)."""
        self.joints, self.velocity = joints, velocity
        self._configuration.update(joints)

    def _choose_way(self, distance: float, angle: float, longest: float, dt: float) -> None:
        """A straight way that is blocked gives way to one in joint space, until that has ended."""
        if self._by_joints:
            self._by_joints = longest > 0.02
            return
        still = float(np.abs(self.velocity).max()) < 0.05
        self._idle = self._idle + dt if still and (distance > 0.002 or angle > 0.02) else 0.0
        if self._idle > 0.2:
            self._by_joints, self._idle = True, 0.0

    def _pose(self, configuration: mink.Configuration) -> Array:
        pose = np.eye(4)
        pose[:3, :3] = configuration.data.site_xmat[self._site].reshape(3, 3)
        pose[:3, 3] = configuration.data.site_xpos[self._site]
        return pose


def _slowing(distance: float, speed: float, acceleration: float, dt: float) -> float:
    """Speed at a distance from the target so that it is reached without overshoot."""
    return min(speed, float(np.sqrt(2 * acceleration * distance)), distance / (3 * dt))


def _difference(first: Array, second: Array) -> tuple[float, float]:
    """Distance in metres and angle in radians between two poses (4, 4)."""
    turn = Rotation.from_matrix(first[:3, :3].T @ second[:3, :3]).magnitude()
    return float(np.linalg.norm(first[:3, 3] - second[:3, 3])), float(turn)


def _between(first: Array, second: Array, shift: float, turn: float) -> Array:
    """A pose at the shares shift and turn of the way from the first pose to the second."""
    pose = np.eye(4)
    way = Rotation.from_matrix(first[:3, :3].T @ second[:3, :3]).as_rotvec()
    pose[:3, :3] = first[:3, :3] @ Rotation.from_rotvec(turn * way).as_matrix()
    pose[:3, 3] = first[:3, 3] + shift * (second[:3, 3] - first[:3, 3])
    return pose
