"""The limits of the arm's motion as rows of a quadratic program, none of which needs clipping.

A row bounds how fast a distance may shrink by distance / braking time. As no joint takes longer
than that to stand still, slowing all joints down in step keeps every row: the program always has
an answer.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import mink
import mujoco
import numpy as np

from hadr.camera import Array
from hadr.handover import ur5
from hadr.handover.simulated_ur5 import TABLE, TOOL_SPEED, WORKSPACE, ArmConfig, broken_limit
from hadr.simulation.robot.arm_model import GRIPPER_GEOMS


@dataclass(frozen=True)
class MotionConfig:
    """How hard the arm may move.

    Attributes:
        joint_acceleration: Largest acceleration of a joint, rad/s2, as its motor carries it out.
        turn_speed: Largest speed of the tool's rotation on a straight way, rad/s.
        turn_acceleration: How hard the rotation slows down, rad/s2.
    """

    joint_acceleration: float = 5.0
    turn_speed: float = 1.5
    turn_acceleration: float = 4.0


OVERSHOOT = (1.02, 1.25)
"""What the motors make of a commanded speed and of a commanded acceleration at most: measured 1.015
and 1.24 in twelve motions at the attempts' limits. Commands stay so far below the limits."""
CLEARANCE = 0.008
"""Free space that links and gripper keep to each other and to the table, metres."""
MARGIN = 0.004
"""The commanded tool point stays this far inside the workspace box, metres."""


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
        self.speed = ur5.JOINT_SPEED * arm.speed_fraction / OVERSHOOT[0]
        self.acceleration = motion.joint_acceleration / OVERSHOOT[1]
        self.braking_time = max(0.2, 1.1 * self.speed / self.acceleration)
        self.velocity: Array = np.zeros(6)
        self.tool_speed = TOOL_SPEED
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
            minimum_distance_from_collisions=CLEARANCE,
            collision_detection_distance=0.2,
        )

    def broken(self, configuration: mink.Configuration) -> str:
        """Name the limit that a configuration breaks, or return an empty string."""
        data = configuration.data
        tool, reach = data.site_xpos[self._tool], data.site_xpos[self._flange] - self._shoulder
        lowest = data.site_xpos[self._points, 2].min()
        problem = broken_limit(data.qpos, tool, reach, lowest, MARGIN)
        if problem:
            return problem
        model = configuration.model
        for first, second in self._apart.geom_id_pairs:
            gap = mujoco.mj_geomDistance(model, data, first, second, 0.02, None)
            if gap < CLEARANCE:
                names = f"{model.geom(first).name} and {model.geom(second).name}"
                return f"{names} would be {1000 * gap:.0f} mm apart"
        return ""

    def compute_qp_inequalities(
        self, configuration: mink.Configuration, dt: float
    ) -> mink.Constraint:
        """Rows for one step of dt seconds from a configuration."""
        model, data = configuration.model, configuration.data
        share = dt / self.braking_time
        step = self.acceleration * dt
        up = np.minimum(self.speed, self.velocity + step) * dt
        up = np.minimum(up, (ur5.JOINT_UPPER - data.qpos) * share)
        down = np.minimum(self.speed, step - self.velocity) * dt
        down = np.minimum(down, (data.qpos - ur5.JOINT_LOWER) * share)
        tool = self._jacobian(model, data, self._tool)
        place = data.site_xpos[self._tool]
        along = _DIRECTIONS @ tool
        # 12 % more between the axes, but nowhere more than the arm's own limit
        fastest = min(self.tool_speed, TOOL_SPEED * _ROUNDNESS / OVERSHOOT[0])
        fast = np.full(len(along), fastest * dt)
        heights = np.stack([self._jacobian(model, data, i)[2] for i in self._points])
        above = (data.site_xpos[self._points, 2] - TABLE) * share
        away = data.site_xpos[self._flange] - self._shoulder
        reach = float(np.linalg.norm(away))
        out = (away / reach) @ self._jacobian(model, data, self._flange)
        self._apart.gain = share
        apart = self._apart.compute_qp_inequalities(configuration, dt)
        near = np.isfinite(apart.h)
        rows = [np.eye(6), -np.eye(6), tool, -tool, along, -along, -heights, out[None]]
        bounds = [up, down]
        bounds += [(np.asarray(WORKSPACE[1]) - MARGIN - place) * share]
        bounds += [(place - np.asarray(WORKSPACE[0]) - MARGIN) * share]
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
