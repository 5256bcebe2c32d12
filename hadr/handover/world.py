"""The physical world of one handover: arm, hand and object under gravity, step by step.

The hand follows its path like a hand on a spring, so that a push moves it instead of crushing it.
It holds the object until both fingers have pressed on it for a tenth of a second; then it lets go
and draws back along its forearm.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from hadr.camera import transform_points
from hadr.handover.arm_model import GRIPPER_GEOMS, HAND, OBJECT, ROBOT
from hadr.handover.physical_arm import PhysicalArmConfig, PhysicalUR5
from hadr.handover.scenes import HeldScene
from hadr.handover.ur5 import Array
from hadr.handover.world_model import HAND_INERTIA, HAND_MASS, world_model
from hadr.handover.world_state import HandPath, Holder, WorldState

_NEAR_PARTS = (*GRIPPER_GEOMS, "wrist_3", "wrist_2", "wrist_1", "forearm", "forearm_1")


@dataclass(frozen=True)
class WorldConfig:
    """How the human behaves, and the arm's settings; metres, newtons, seconds.

    Attributes:
        arm: Settings of the physical arm.
        hand_stiffness: Force that a displaced hand holds against, N/m.
        hand_turn_stiffness: Torque that a twisted hand holds against, N m/rad.
        release_after: The hand lets go once both fingers have pressed for this long.
        release_force: What counts as pressing.
        withdraw_speed: How fast the hand draws back after it has let go, m/s.
        withdraw_distance: How far.
    """

    arm: PhysicalArmConfig = field(default_factory=PhysicalArmConfig)
    hand_stiffness: float = 250.0
    hand_turn_stiffness: float = 5.0
    release_after: float = 0.1
    release_force: float = 0.5
    withdraw_speed: float = 0.05
    withdraw_distance: float = 0.15

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name != "arm" and not (np.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be a positive number, got {value}")


class World:
    """One handover's physics.

    Args:
        scene: Hand and object at rest.
        path: How the hand moves; None keeps it where it is.
        config: Settings; the standard ones where left out.

    Attributes:
        robot: The arm; its last command runs while the world is stepped.
        scene: As given.
    """

    def __init__(
        self,
        scene: HeldScene,
        path: HandPath | None = None,
        config: WorldConfig | None = None,
    ) -> None:
        self.scene, self._path = scene, path
        self.config = config or WorldConfig()
        self._model = world_model(scene, self.config.arm.arm)
        self._data = mujoco.MjData(self._model)
        self.robot = PhysicalUR5(self._model, self._data, self.config.arm)
        model, data = self._model, self._data
        self._hand, self._object = model.body("hand").id, model.body("object").id
        self._hand_speed = slice(*(model.joint("hand").dofadr[0] + np.array([0, 6])))
        self._grip = model.equality("grip").id
        self._kinds = model.geom_contype.copy()
        self._finger = np.full(model.ngeom, -1)
        for index, name in enumerate(GRIPPER_GEOMS[:2]):
            self._finger[model.geom(name).id] = index
        self._near = np.array([model.geom(name).id for name in _NEAR_PARTS])
        self._skin = np.flatnonzero(model.geom_bodyid == self._hand)
        self._hand_center = model.body_ipos[self._hand].copy()
        self._rest = scene.base_from_wrist
        self._pressed = np.full(2, -np.inf)
        self._pressing_since: float | None = None
        self._released_at: float | None = None
        self._forearm = np.zeros(3)
        self._largest_force = 0.0
        self._knot = (-1.0, self._hand_target(0.0), self._hand_target(0.0))
        mujoco.mj_forward(model, data)

    @property
    def time(self) -> float:
        """Seconds since the start."""
        return float(self._data.time)

    def step(self, dt: float) -> None:
        """Let dt seconds pass.

        Raises:
            ValueError: dt is no positive multiple of the physics' step.
        """
        steps = dt / self._model.opt.timestep
        if not (np.isfinite(steps) and round(steps) >= 1 and abs(steps - round(steps)) < 1e-6):
            raise ValueError(
                f"dt must be a multiple of {self._model.opt.timestep} seconds, got {dt}"
            )
        for _ in range(round(steps)):
            self.robot.drive()
            self._move_hand()
            mujoco.mj_step(self._model, self._data)
            self._look_at_contacts()
        mujoco.mj_kinematics(self._model, self._data)

    def state(self) -> WorldState:
        """What is true now; the largest force on the hand counts from the call before."""
        force, self._largest_force = self._largest_force, 0.0
        return WorldState(
            time=self.time,
            joints=self.robot.joint_positions(),
            gripper_width=self.robot.gripper_width(),
            base_from_wrist=self._pose(self._hand),
            base_from_object=self._pose(self._object),
            holder=self.holder(),
            hand_force=force,
            hand_distance=self._hand_distance(),
        )

    def keypoints(self) -> Array:
        """The hand where it truly is, shape (21, 3), metres, base frame."""
        moved = self._pose(self._hand) @ np.linalg.inv(self._rest)
        points: Array = transform_points(moved, self.scene.keypoints)
        return points

    def holder(self) -> Holder:
        """Who holds the object; a finger counts until it has not pressed for 0.05 s."""
        gripped = bool((self.time - self._pressed < 0.05).all())
        if self._released_at is None:
            return "both" if gripped else "hand"
        return "gripper" if gripped else "nobody"

    def _pose(self, body: int) -> Array:
        pose = np.eye(4)
        pose[:3, :3] = self._data.xmat[body].reshape(3, 3)
        pose[:3, 3] = self._data.xpos[body]
        return pose

    def _hand_target(self, time: float) -> Array:
        """Where the hand wants its wrist, base frame, shape (4, 4)."""
        moved = np.eye(4) if self._path is None else self._path.moved(time)
        target: Array = moved @ self._rest
        if self._released_at is not None:
            c = self.config
            back = min(c.withdraw_distance, c.withdraw_speed * (time - self._released_at))
            target[:3, 3] += back * self._forearm
        return target

    def _move_hand(self) -> None:
        """Pull the hand toward its path by a damped spring, and let it carry the object."""
        knot, span, now = self._knot, 0.01, self.time
        if now >= knot[0] + span - 1e-9:
            knot = self._knot = (now, knot[2], self._hand_target(now + span))
        start, first, second = knot
        share = (now - start) / span
        turn = Rotation.from_matrix(second[:3, :3] @ first[:3, :3].T).as_rotvec()
        wanted = Rotation.from_rotvec(share * turn).as_matrix() @ first[:3, :3]
        c, body = self.config, self._hand
        velocity = np.zeros(6)  # of the centre, then of rotation
        mujoco.mj_objectVelocity(
            self._model, self._data, mujoco.mjtObj.mjOBJ_BODY, body, velocity, 0
        )
        spin, speed = velocity[:3], velocity[3:]
        centers = [pose[:3, :3] @ self._hand_center + pose[:3, 3] for pose in (first, second)]
        goal = (1 - share) * centers[0] + share * centers[1]
        goal_speed = (centers[1] - centers[0]) / span
        away = goal - self._data.xipos[body]
        twist = Rotation.from_matrix(wanted @ self._data.xmat[body].reshape(3, 3).T).as_rotvec()
        damping = 2 * np.sqrt(c.hand_stiffness * HAND_MASS)
        turn_damping = 2 * np.sqrt(c.hand_turn_stiffness * HAND_INERTIA)
        force = c.hand_stiffness * away + damping * (goal_speed - speed)
        torque = c.hand_turn_stiffness * twist + turn_damping * (turn / span - spin)
        if self._released_at is None:
            weight = -self._model.body_mass[self._object] * self._model.opt.gravity
            lever = self._data.xipos[self._object] - self._data.xipos[body]
            force, torque = force + weight, torque + np.cross(lever, weight)
        self._data.xfrc_applied[body] = [*force, *torque]

    def _look_at_contacts(self) -> None:
        """Sum up the forces on the hand, note who presses on the object, and let go in time."""
        on_hand, on_object = 0.0, np.zeros(2)
        wrench = np.zeros(6)
        for index, (first, second) in enumerate(self._data.contact.geom):
            kinds = self._kinds[first] | self._kinds[second]
            if kinds == ROBOT | HAND:
                mujoco.mj_contactForce(self._model, self._data, index, wrench)
                on_hand += float(np.linalg.norm(wrench[:3]))
            elif kinds == ROBOT | OBJECT:
                finger = max(self._finger[first], self._finger[second])
                if finger >= 0:
                    mujoco.mj_contactForce(self._model, self._data, index, wrench)
                    on_object[finger] += float(np.linalg.norm(wrench[:3]))
        self._largest_force = max(self._largest_force, on_hand)
        pressing = on_object > self.config.release_force
        self._pressed[pressing] = self.time
        self.robot.feel(on_hand, open_fingers=self._released_at is None)
        if self._released_at is not None:
            return
        if not pressing.all():
            self._pressing_since = None
        elif self._pressing_since is None:
            self._pressing_since = self.time
        elif self.time - self._pressing_since >= self.config.release_after - 1e-9:
            self._let_go()

    def _let_go(self) -> None:
        self._released_at = self.time
        self._data.eq_active[self._grip] = 0
        self._forearm = -self._data.xmat[self._hand].reshape(3, 3)[:, 1]
        self.robot.set_firm_grip(True)

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
