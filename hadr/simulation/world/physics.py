"""The physical world of one handover: arm, hand and object under gravity, step by step.

The hand follows its path like a hand on a spring, so that a push moves it instead of crushing it.
It holds the object until both fingers have pressed on it, from two sides, for a tenth of a second,
or until the hold is torn; then it opens and draws back (`hadr.simulation.world.letting_go`) and
pushes what it meets.
"""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np

from hadr.camera import Array, transform_points
from hadr.handover.poses import norm
from hadr.handover.robot import UNLOCK_AFTER
from hadr.handover.simulated_ur5 import ArmConfig
from hadr.simulation.robot.arm_model import GRIPPER_GEOMS, HAND, OBJECT, ROBOT, pose_of
from hadr.simulation.robot.motion_limits import MotionConfig
from hadr.simulation.robot.physical_arm import PhysicalUR5
from hadr.simulation.world.letting_go import (
    WITHDRAW_DISTANCE,
    pose_hand,
    touch_object,
    way_off,
)
from hadr.simulation.world.model import HAND_INERTIA, HAND_MASS, world_model
from hadr.simulation.world.scenes import HeldScene
from hadr.simulation.world.state import Holder, WorldState

_NEAR_PARTS = (*GRIPPER_GEOMS, "wrist_3", "wrist_2", "wrist_1", "forearm", "forearm_1")
_KNOT = 0.01
"""Seconds between two looks at the hand's path; between them the hand wants to move evenly."""


HAND_STIFFNESS, HAND_TURN_STIFFNESS = 250.0, 5.0
"""Force and torque that a displaced or twisted hand holds against, N/m and N m/rad."""
_DAMPING = 2 * np.sqrt(HAND_STIFFNESS * HAND_MASS)
_TURN_DAMPING = 2 * np.sqrt(HAND_TURN_STIFFNESS * HAND_INERTIA)
HAND_STRENGTH, HAND_TORQUE = 12.0, 1.5
"""A hand that is pushed or twisted harder gives way, newtons and N m."""
RELEASE_AFTER, RELEASE_FORCE = 0.1, 0.5
"""The hand lets go once both fingers have pressed for so long, seconds, by so much, newtons, each
against the other: a person keeps what they only push at from one side."""
OPENS_IN = 0.3
"""So long, seconds, the fingers take to stretch after the hand has let go."""
WITHDRAW_SPEED = 0.05
"""How fast the hand draws back after it has opened, m/s."""
HOLD_FORCE, HOLD_TORQUE = 10.0, 0.7
"""A hold that has to bear more, newtons and N m about the middle of the fingertips, is torn; the
glass's own weight (1 to 4 N) is part of it. Assumed: about a kilogram at a hand's width."""


class _Course:
    """The hand's motion between two wrist poses (4, 4): constant speed (3,) and spin (3,)."""

    def __init__(self, start: float, first: Array, end: Array) -> None:
        self.start, self.first, self.end = start, first, end
        quaternions = np.zeros((2, 4))
        for pose, quaternion in zip((first, end), quaternions, strict=True):
            mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(pose[:3, :3]).ravel())
        self.turn, self.quaternion = np.zeros(3), np.array(quaternions[0])
        mujoco.mju_subQuat(self.turn, quaternions[1], quaternions[0])
        self.turn /= _KNOT
        self.speed, self.spin = (end[:3, 3] - first[:3, 3]) / _KNOT, first[:3, :3] @ self.turn

    def origin(self, elapsed: float) -> Array:
        """Where the wrist should be, shape (3,)."""
        place: Array = self.first[:3, 3] + elapsed * self.speed
        return place

    def quaternion_at(self, elapsed: float) -> Array:
        """How the wrist should be turned, shape (4,)."""
        quaternion = self.quaternion.copy()
        mujoco.mju_quatIntegrate(quaternion, self.turn, elapsed)
        return quaternion


def _cross(first: Array, second: Array) -> Array:
    """Cross product of two vectors (3,); numpy's takes ten times as long."""
    product = np.zeros(3)
    mujoco.mju_cross(product, first, second)
    return product


def _at_most(vector: Array, largest: float) -> Array:
    """The vector (3,), shortened to a length where it is longer."""
    length = norm(vector)
    shortened: Array = vector if length <= largest else vector * (largest / length)
    return shortened


class World:
    """One handover's physics.

    Args:
        scene: Hand and object, as they were at time 0.
        path: How the hand has moved at a time in seconds, base_now_from_base_start, shape (4, 4);
            None keeps it where it is.
        arm: Settings of the arm, `robot`, whose last command runs while the world is stepped.
        motion: How hard it may move.
        seed: Of the noise of the arm's sensors, which differs from hold to hold.

    `torn` says whether the object was torn out of the hand.
    """

    def __init__(
        self,
        scene: HeldScene,
        path: Callable[[float], Array] | None = None,
        arm: ArmConfig | None = None,
        motion: MotionConfig | None = None,
        seed: int = 0,
    ) -> None:
        self.scene, self._path = scene, path
        self._model = world_model(scene)
        self._data = mujoco.MjData(self._model)
        self.robot = PhysicalUR5(
            self._model,
            self._data,
            arm or ArmConfig(speed_fraction=0.35),
            motion or MotionConfig(),
            np.random.default_rng([seed, 71, *scene.hold.hold_id.encode()]),
        )
        model, data = self._model, self._data
        self._hand, self._object = model.body("hand").id, model.body("object").id
        self._grip = model.equality("grip").id
        self.torn, self._opened, self._opens_to = False, np.zeros(5), np.zeros(5)
        self._kinds: list[int] = model.geom_contype.tolist()
        self._tool = model.site("tool").id
        gripper = [model.geom(name).id for name in GRIPPER_GEOMS]
        self._gripper, self._fingers = set(gripper), {gripper[0]: 0, gripper[1]: 1}
        self._weight = -model.body_mass[self._object] * model.opt.gravity
        self._near = np.array([model.geom(name).id for name in _NEAR_PARTS])
        self._skin = np.flatnonzero(model.geom_bodyid == self._hand)
        self._hand_center = model.body_ipos[self._hand].copy()
        self._rest = scene.base_from_wrist
        self._pressed = np.full(2, -np.inf)
        self._pressing_since: float | None = None
        self._released_at: float | None = None
        self._way_off = np.zeros(3)
        self._largest_force = self._largest_through = self._halted_at = 0.0
        self._velocity = np.zeros(6)
        self._course = _Course(0.0, self._hand_target(0.0), self._hand_target(_KNOT))
        mujoco.mj_forward(model, data)
        of_grip = (data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY) & (
            data.efc_id == self._grip
        )
        self._grip_rows = np.flatnonzero(of_grip)  # equalities come first and never change

    @property
    def time(self) -> float:
        """Seconds since the start."""
        return float(self._data.time)

    def step(self, dt: float) -> None:
        """Let dt seconds pass; ValueError where they are no positive multiple of a step's."""
        steps = dt / self._model.opt.timestep
        if not (np.isfinite(steps) and round(steps) >= 1 and abs(steps - round(steps)) < 1e-6):
            raise ValueError(
                f"dt must be a multiple of {self._model.opt.timestep} seconds, got {dt}"
            )
        self._largest_force = self._largest_through = 0.0
        for _ in range(round(steps)):
            self.robot.drive()
            self._move_hand()
            mujoco.mj_step(self._model, self._data)
            self._look_at_contacts()
            self._release_protective_stop()
        mujoco.mj_kinematics(self._model, self._data)

    @property
    def physics(self) -> tuple[mujoco.MjModel, mujoco.MjData]:
        """MuJoCo's model and data, for its viewer; changing them changes the world."""
        return self._model, self._data

    def state(self) -> WorldState:
        """What is true now; the forces on the hand are the largest of the last `step`."""
        return WorldState(
            time=self.time,
            joints=self.robot.joint_positions(),
            gripper_width=self.robot.gripper_width(),
            base_from_wrist=pose_of(self._data.body(self._hand)),
            base_from_object=pose_of(self._data.body(self._object)),
            holder=self.holder(),
            hand_force=self._largest_force,
            through_force=self._largest_through,
            hand_distance=self._hand_distance(),
            opened=self._opened,
        )

    def keypoints(self) -> Array:
        """The hand where it truly is, shape (21, 3), metres, base frame."""
        moved = pose_of(self._data.body(self._hand)) @ np.linalg.inv(self._rest)
        points: Array = transform_points(moved, self.scene.opened(self._opened).keypoints)
        return points

    def holder(self) -> Holder:
        """Who holds the object; a finger counts until it has not pressed for 0.05 s."""
        gripped = bool((self.time - self._pressed < 0.05).all())
        if self._released_at is None:
            return "both" if gripped else "hand"
        return "gripper" if gripped else "nobody"

    def _hand_target(self, time: float) -> Array:
        """Where the hand wants its wrist, base frame, shape (4, 4)."""
        moved = np.eye(4) if self._path is None else self._path(time)
        target: Array = moved @ self._rest
        if self._released_at is not None:
            since = max(0.0, time - self._released_at - OPENS_IN)
            back = min(WITHDRAW_DISTANCE, WITHDRAW_SPEED * since)
            target[:3, 3] += back * self._way_off
        return target

    def _move_hand(self) -> None:
        """Pull the hand toward its path by a damped spring, and let it carry the object."""
        now, body, data = self.time, self._hand, self._data
        if now >= self._course.start + _KNOT - 1e-9:
            self._course = _Course(now, self._course.end, self._hand_target(now + _KNOT))
            self._open()
        course, rotation = self._course, data.xmat[body].reshape(3, 3)
        elapsed = now - course.start
        mujoco.mj_objectVelocity(
            self._model, data, mujoco.mjtObj.mjOBJ_BODY, body, self._velocity, 0
        )
        spin, speed = self._velocity[:3], self._velocity[3:]  # of the hand's centre
        goal_turn, rotated, turn = course.quaternion_at(elapsed), np.zeros(3), np.zeros(3)
        mujoco.mju_rotVecQuat(rotated, self._hand_center, goal_turn)
        origin = course.origin(elapsed)
        goal = origin + rotated
        goal_speed = course.speed + _cross(course.spin, goal - origin)
        away = goal - data.xipos[body]
        mujoco.mju_subQuat(turn, goal_turn, data.xquat[body])
        twist = rotation @ turn
        # the spring is the weaker part, so that a hand that comes free does not shoot back
        pull = _at_most(HAND_STIFFNESS * away, 0.6 * HAND_STRENGTH)
        force = _at_most(pull + _DAMPING * (goal_speed - speed), HAND_STRENGTH)
        twisting = _at_most(HAND_TURN_STIFFNESS * twist, 0.6 * HAND_TORQUE)
        torque = _at_most(twisting + _TURN_DAMPING * (course.spin - spin), HAND_TORQUE)
        if self._released_at is None:
            arm = data.xipos[self._object] - data.xipos[body]
            force, torque = force + self._weight, torque + _cross(arm, self._weight)
        data.xfrc_applied[body, :3] = force
        data.xfrc_applied[body, 3:] = torque

    def _open(self) -> None:
        """Stretch the fingers of a hand that has let go."""
        if self._released_at is None or (self._opened >= self._opens_to).all():
            return
        part = min(1.0, (self.time - self._released_at) / OPENS_IN)
        self._opened = np.round(part * self._opens_to, 1)
        pose_hand(self._model, self.scene.opened(self._opened))

    def _let_go(self) -> None:
        self._released_at = self.time
        self._data.eq_active[self._grip] = 0
        touch_object(self._model, self._data)
        found = way_off(self._model, self._data, self.scene, self._near)
        self._opens_to, self._way_off = found

    def _release_protective_stop(self) -> None:
        """Play the person who looks at a stopped arm and releases it as soon as that is allowed."""
        if not self.robot.protective_stop:
            self._halted_at = self.time
        elif self.time - self._halted_at >= UNLOCK_AFTER:
            self.robot.unlock()

    def _look_at_contacts(self) -> None:
        """Sum up the forces on the hand, note who presses on the object, and let go in time."""
        on_hand, on_links, on_object, on_gripper = 0.0, 0.0, [0.0, 0.0], np.zeros(6)
        wrench, pads, through, of_object = np.zeros(6), [0.0, 0.0], np.zeros(3), np.zeros(3)
        normal = np.zeros((2, 3))  # of each finger's force on the object, without friction
        contacts, tool = self._data.contact, self._data.site_xpos[self._tool]
        frames, places = contacts.frame, contacts.pos
        for index, (first, second) in enumerate(contacts.geom.tolist()):
            kinds = self._kinds[first] | self._kinds[second]
            if kinds not in (ROBOT | HAND, ROBOT | OBJECT, HAND | OBJECT):
                continue
            mujoco.mj_contactForce(self._model, self._data, index, wrench)
            pushed = frames[index].reshape(3, 3).T @ wrench[:3]  # the second shape
            if kinds == HAND | OBJECT:
                of_object += pushed if self._kinds[second] == HAND else -pushed
                continue
            force, of_hand = norm(wrench[:3]), kinds == ROBOT | HAND
            if first in self._gripper or second in self._gripper:
                felt = pushed if second in self._gripper else -pushed
                on_gripper[:3] += felt
                on_gripper[3:] += _cross(places[index] - tool, felt)
                if not of_hand:
                    through += felt
            else:
                on_links += force
            finger = self._fingers.get(first, self._fingers.get(second))
            if finger is not None:
                pads[finger] += force
                if not of_hand:
                    on_object[finger] += force
                    sign = 1 if first in self._fingers else -1
                    normal[finger] += sign * wrench[0] * frames[index].ravel()[:3]
            if of_hand:
                on_hand += force
        self._largest_force = max(self._largest_force, on_hand)
        self.robot.touched(on_gripper, min(pads), on_links, self._model.opt.timestep)
        pressing = [force > RELEASE_FORCE for force in on_object]
        self._pressed[pressing] = self.time
        held = self._released_at is None
        through_hand = norm(through if held else of_object)
        self._largest_through = max(self._largest_through, through_hand)
        if not held:
            return
        pull, twist = self._hold_bears()
        self.torn = pull > HOLD_FORCE or twist > HOLD_TORQUE
        if self.torn:
            self._let_go()
        elif not (all(pressing) and normal[0] @ normal[1] < 0):
            self._pressing_since = None
        elif self._pressing_since is None:
            self._pressing_since = self.time
        elif self.time - self._pressing_since >= RELEASE_AFTER - 1e-9:
            self._let_go()

    def _hold_bears(self) -> tuple[float, float]:
        """Force and torque that the hold bears, newtons and N m about the fingertips' middle."""
        rows = self._data.efc_force[self._grip_rows]
        # a weld's last rows are of half the angle
        return norm(rows[:3]), norm(rows[3:]) / 2

    def _hand_distance(self) -> float:
        """Smallest distance of gripper, wrist and forearm to the hand, metres; 0 in contact."""
        centers, radii = self._data.geom_xpos, self._model.geom_rbound
        apart = np.linalg.norm(centers[self._near][:, None] - centers[self._skin][None], axis=2)
        bound = apart - radii[self._near][:, None] - radii[self._skin][None]
        best = 2.0
        for flat in bound.ravel().argsort(kind="stable"):
            row, column = divmod(int(flat), len(self._skin))
            if bound[row, column] >= best:
                break
            pair = int(self._near[row]), int(self._skin[column])
            best = min(best, mujoco.mj_geomDistance(self._model, self._data, *pair, best, None))
        return max(0.0, float(best))
