"""A UR5 of mass and motors, behind the same calls as every other robot.

`servo_to` only sets the command for the next moment; the world's steps carry it out. A command
that is not renewed in time makes the arm brake, as a real UR5 does when its client falls silent.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from hadr.camera import Array
from hadr.handover import ur5
from hadr.handover.grasping.gripper import LARGEST_OPENING
from hadr.handover.poses import check_pose, norm
from hadr.handover.robot import UnreachableError
from hadr.handover.simulated_ur5 import HOME_JOINTS, TOOL_SPEED, ArmConfig
from hadr.handover.stages import GENTLE_FORCE
from hadr.simulation.robot.arm_model import pose_of
from hadr.simulation.robot.arm_motion import LEAST_SINGULAR_VALUE, ArmMotion
from hadr.simulation.robot.motion_limits import MotionConfig

FORCE_RISE = 20.0
"""How fast the fingers' force may grow, newtons per second."""
PROTECTIVE_FORCE = 9.0
"""Force at the wrist, or on the links behind it, at which the arm freezes, newtons."""
SENSOR_NOISE = np.array([0.1, 0.1, 0.1, 0.005, 0.005, 0.005])
"""Standard deviation of the wrist's sensor, newtons and N m, and of the fingers' (the first): the
resolution that is published for a Robotiq FT 300-S is 0.1 N; the torque is our choice."""
EMERGENCY_DECELERATION = 20.0
"""Of the joints in a protective stop, rad/s2."""


@dataclass(frozen=True)
class _Stretch:
    """One piece of the commanded path: from one joint velocity to the next at even acceleration."""

    start: float
    length: float
    joints: Array
    velocities: tuple[Array, Array]

    @property
    def end(self) -> float:
        return self.start + self.length

    def at(self, time: float) -> tuple[Array, Array]:
        """Joint angles and velocities at a time within the stretch, each of shape (6,)."""
        since = min(max(time - self.start, 0.0), self.length)
        (first, last) = self.velocities
        velocity = first + (last - first) * since / self.length
        return self.joints + (first + velocity) / 2 * since, velocity


class PhysicalUR5:
    """The arm and gripper of a `hadr.simulation.world.physics.World`; `rng` draws sensors' noise.

    It writes the controls into the world's state, and the gripper's motor limits into its model.
    `protective_stop` says why the arm has frozen.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        arm: ArmConfig,
        motion: MotionConfig,
        rng: np.random.Generator,
    ) -> None:
        self.arm, self._rng = arm, rng
        self.protective_stop = ""
        self._model, self._data = model, data
        self._motion = ArmMotion(arm, motion)
        self._site = model.site("tool").id
        self._position = np.array([model.actuator(f"position_{i}").id for i in range(1, 7)])
        self._speed = np.array([model.actuator(f"speed_{i}").id for i in range(1, 7)])
        self._grip = model.actuator("fingers").id
        self._joints = np.array([model.joint(f"joint_{i}").qposadr[0] for i in range(1, 7)])
        sides = ("left", "right")
        self._fingers = np.array([model.joint(f"{s}_finger").qposadr[0] for s in sides])
        self._stopped = False
        self._touch, self._press, self._links = np.zeros(6), 0.0, 0.0
        self._opening = self._target_opening = LARGEST_OPENING
        data.qpos[self._joints], data.qpos[self._fingers] = HOME_JOINTS, self._opening / 2
        self._stretch = _Stretch(data.time - 0.02, 0.02, HOME_JOINTS, (np.zeros(6), np.zeros(6)))
        self._force = self._wanted_force = GENTLE_FORCE
        self.drive()

    def tool_pose(self) -> Array:
        """Return base_from_tool now as the physics has it, shape (4, 4), metres."""
        return pose_of(self._data.site(self._site))

    def joint_positions(self) -> Array:
        """Return the six joint angles now, radians."""
        joints: Array = self._data.qpos[self._joints].copy()
        return joints

    def joints_at(self, base_from_tool: Array) -> Array:
        """Return the nearest joint angles (6,) for a tool pose; `UnreachableError`."""
        return next(self._motion.joint_goals(base_from_tool))

    def reachable(self, base_from_tool: Array) -> bool:
        """Say whether the tool could stand at this pose, shape (4, 4), within all limits.

        A pose at which the arm is nearly singular counts as one that it can't reach.
        """
        try:
            joints = self.joints_at(base_from_tool)
        except UnreachableError:
            return False
        return ur5.singularity(joints) >= LEAST_SINGULAR_VALUE

    def servo_to(
        self, base_from_tool: Array, dt: float, *, speed: float = TOOL_SPEED, swing: bool = True
    ) -> None:
        """Set the command for the next dt seconds, at most 0.1: move toward a tool pose (4, 4).

        The tool point is at most so fast, m/s, on whichever way; only an arm that may swing leaves
        the straight one. Without a new command the arm brakes after it; and where this one raises:
        UnreachableError for a target that breaks a limit, ValueError for no rigid transform or dt
        out of range.
        """
        if not 0 < dt <= 0.1:
            raise ValueError(f"dt must be more than 0 and at most 0.1 seconds, got {dt}")
        target = check_pose(base_from_tool, "base_from_tool")
        if self._stopped or self.protective_stop:
            return
        joints, velocity = self._stretch.at(self._data.time)
        self._motion.put(joints, velocity)
        self._motion.advance(target, dt, speed=speed, swing=swing)
        speeds = (velocity, self._motion.velocity)
        self._stretch = _Stretch(self._data.time, dt, joints, speeds)

    def stop(self) -> None:
        """Brake and stand still; later commands do nothing until `release`."""
        self._stopped = True

    def straight_way(self, base_from_tool: Array) -> bool:
        """Say whether the tool can go to a pose, shape (4, 4), on a straight line from here.

        Where it cannot, `servo_to` turns the joints evenly instead, and the tool swings out.
        """
        try:
            return self._motion.straight_way(base_from_tool) is not None
        except UnreachableError:
            return False

    def release(self) -> None:
        """Let the arm move again after `stop`; see `unlock` for a protective stop."""
        self._stopped = False
        self._motion.forget()

    def unlock(self) -> None:
        """Release a protective stop, as only a person does: at the arm, after having looked."""
        self.protective_stop = ""
        self._motion.forget()

    def set_gripper(self, width: float, force: float) -> None:
        """Open or close the fingers to a width in metres, unless in a protective stop.

        They press by at most a force, newtons, which grows by `FORCE_RISE` at most. ValueError for
        a width that is not finite or lies outside 0 to the largest opening.
        """
        if not 0 <= width <= LARGEST_OPENING:
            raise ValueError(
                f"gripper width must lie between 0 and {LARGEST_OPENING} m, got {width}"
            )
        if not self.protective_stop:
            self._target_opening, self._wanted_force = width, force

    def gripper_width(self) -> float:
        """Return the distance between the fingers now, metres."""
        width = float(self._data.qpos[self._fingers].sum())
        return min(max(width, 0.0), LARGEST_OPENING)

    def tool_wrench(self) -> Array:
        """Return force and torque about the tool point of what the gripper touches on it, (6,)."""
        wrench: Array = self._touch + self._rng.normal(0.0, SENSOR_NOISE)
        return wrench

    def finger_force(self) -> float:
        """Return the force of the finger that presses less, newtons."""
        return max(0.0, self._press + float(self._rng.normal(0.0, SENSOR_NOISE[0])))

    def touched(self, wrench: Array, press: float, links: float, dt: float) -> None:
        """Tell the sensors what touched the arm in dt seconds; they smooth over 20 ms.

        The wrist feels the wrench (6,) on the gripper about the tool point, the joints' motors the
        force on the links, newtons; the press, newtons, is that of the weaker finger.
        """
        share = min(1.0, dt / 0.02)
        self._touch += (wrench - self._touch) * share
        self._press += (press - self._press) * share
        self._links += (links - self._links) * share
        force = max(norm(self._touch[:3]), self._links)
        if force > PROTECTIVE_FORCE and not self.protective_stop:
            self.protective_stop = f"{force:.1f} N on the arm, more than {PROTECTIVE_FORCE:.1f} N"

    def drive(self) -> None:
        """Write the motors' commands for this moment; the world calls it before each step."""
        now, step = self._data.time, self._model.opt.timestep
        halt = self._stopped or bool(self.protective_stop)
        if now >= self._stretch.end - 1e-9 or (halt and self._stretch.start < now):
            joints, velocity = self._stretch.at(now)
            self._motion.put(joints, velocity)
            urgent = bool(self.protective_stop)
            rate = EMERGENCY_DECELERATION if urgent else self._motion.rows.acceleration
            self._motion.brake(step, rate)
            self._stretch = _Stretch(now, step, joints, (velocity, self._motion.velocity))
        joints, velocity = self._stretch.at(now + step)
        self._data.ctrl[self._position] = joints
        self._data.ctrl[self._speed] = velocity
        most = self.arm.finger_speed * step
        self._opening += min(max(self._target_opening - self._opening, -most), most)
        self._data.ctrl[self._grip] = self._opening / 2
        self._force = min(self._force + FORCE_RISE * step, self._wanted_force)
        # half of the motor's force acts on each finger
        self._model.actuator_forcerange[self._grip] = [-2 * self._force, 2 * self._force]
