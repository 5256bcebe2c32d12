"""What the human holds out: a hand and a glass before the robot, at rest, in the base frame.

Robot's base frame: x toward the human, z up, metres. The human stands beyond the object, so the
forearm comes from +x; the glass is upright but for a lean of some degrees, as people hold it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from hadr.camera import Array, transform_points
from hadr.hand import ANGLE_NAMES, FINGERS, Skeleton, forward_kinematics, keypoints_from_skeleton
from hadr.records.caches import read_only
from hadr.synthesis.glass.objects import bodies, glass_object
from hadr.synthesis.glass.shape import GlassObject
from hadr.synthesis.glass.surfaces import Surface
from hadr.synthesis.hand.mesh import SKIN_TONES, HandMesh, hand_mesh
from hadr.synthesis.holding.hold import Hold, make_hold

MIDDLE: Array = np.array([0.62, 0.0, 0.32])
"""Where the middle of the object is held out, metres; each scene differs by some centimetres."""
_STRETCHES = np.array(["stretch" in name for name in ANGLE_NAMES])
OPENING_STEPS = 10
"""A finger that opens is in one of so many places after that in which it holds."""


@dataclass(frozen=True)
class HeldScene:
    """A hand at a pose (4, 4), metres, that holds an object out to the robot.

    The skin's tone (3,) is its linear RGB reflectance.
    """

    hold: Hold
    base_from_wrist: Array
    tone: Array

    @property
    def item(self) -> GlassObject:
        """The object: its outline, tint and parts."""
        return glass_object(self.hold.object_id)

    @property
    def base_from_object(self) -> Array:
        """Pose of the object (its z is its axis, z = 0 its foot), shape (4, 4), metres."""
        pose: Array = self.base_from_wrist @ self.hold.wrist_from_object
        return pose

    @cached_property
    def skeleton(self) -> Skeleton:
        """The hand's joints in the wrist frame."""
        return read_only(forward_kinematics(self.hold.angles, self.hold.shape))

    @cached_property
    def keypoints(self) -> Array:
        """The hand in the base frame, shape (21, 3), metres."""
        in_wrist = keypoints_from_skeleton(self.skeleton.joints)
        points: Array = transform_points(self.base_from_wrist, in_wrist)
        return read_only(points)

    def opened(self, shares: Array) -> HeldScene:
        """The same with each finger stretched by a share, (5,) in tenths: 0 as held, 1 straight."""
        steps = np.rint(OPENING_STEPS * np.asarray(shares)).astype(int)
        return self._opened.setdefault(tuple(steps.tolist()), self._stretched(steps))

    @cached_property
    def _opened(self) -> dict[tuple[int, ...], HeldScene]:
        return {(0,) * len(FINGERS): self}

    def _stretched(self, steps: Array) -> HeldScene:
        held = self.hold.angles
        share = np.repeat(steps, len(held) // len(FINGERS)) / OPENING_STEPS
        angles = np.where(_STRETCHES, held - share * np.maximum(held, 0.0), held)
        return replace(self, hold=replace(self.hold, angles=angles))

    def hand(self, step: float = 0.005) -> HandMesh:
        """The hand with its forearm in the wrist frame, vertices at most a step apart, metres."""
        return hand_mesh(self.skeleton, self.hold.shape, tone=self.tone, step=step)

    def glass(self) -> tuple[Surface, ...]:
        """The object's closed bodies in its own frame."""
        return bodies(self.item)


def held_scene(object_id: str, hold_number: int, seed: int = 0) -> HeldScene:
    """Place one hold of an object before the robot; the same for the same three arguments.

    The object leans by up to 20 degrees. Of all turns about the vertical the one is taken in which
    the forearm points away from the robot, but for up to 35 degrees to either side. The seed
    chooses the place, the lean and the skin, not the holding pose. ValueError for an unknown object
    or a negative number.
    """
    hold = make_hold(object_id, hold_number)
    rng = np.random.default_rng([seed, int(object_id), hold_number, 61])
    lean = Rotation.from_euler("x", np.deg2rad(rng.uniform(0, 20)))
    spun = (lean * Rotation.from_euler("z", rng.uniform(0, 2 * np.pi))).as_matrix()
    # the forearm lies along the wrist frame's minus y
    forearm = spun @ np.linalg.inv(hold.wrist_from_object)[:3, :3] @ [0.0, -1.0, 0.0]
    bearing = np.arctan2(forearm[1], forearm[0])
    turn = Rotation.from_euler("z", np.deg2rad(rng.uniform(-35, 35)) - bearing).as_matrix()
    base_from_object = np.eye(4)
    base_from_object[:3, :3] = turn @ spun
    middle = MIDDLE + rng.uniform(-1, 1, 3) * [0.04, 0.10, 0.04]
    up = base_from_object[:3, :3] @ [0.0, 0.0, glass_object(object_id).height / 2]
    base_from_object[:3, 3] = middle - up
    tone = np.asarray(SKIN_TONES[int(rng.integers(len(SKIN_TONES)))])
    return HeldScene(hold, base_from_object @ np.linalg.inv(hold.wrist_from_object), tone)
