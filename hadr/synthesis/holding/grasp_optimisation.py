"""Grasp optimisation: the fingers close on an object until their skin meets the glass.

A finger tries a library of natural postures, takes the best and improves it. What is best: the pad
of the tip (or the whole inner side) on the glass, nothing in it, the end joint bent with the middle
one, neighbours alike, no finger in another. Lengths in the costs are millimetres.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from hadr.camera import Array
from hadr.hand import FINGERS, HandShape, forward_kinematics
from hadr.synthesis.glass.objects import glass_object
from hadr.synthesis.glass.shape import GlassObject
from hadr.synthesis.hand.finger_skin import FingerSkin, finger_skin
from hadr.synthesis.hand.skinning import skin_vertices
from hadr.synthesis.holding.clearance import ClearanceTable, clearance_table
from hadr.synthesis.holding.kinds import Action, Placement

Floats = npt.NDArray[np.float32]

#: Ranges of the search, radians: a little inside of ``hadr.hand.ANGLE_LIMITS``.
_FINGER_RANGE = np.deg2rad([(-12, 12), (-8, 88), (4, 106), (2, 72)])
_THUMB_RANGE = np.deg2rad([(-28, 38), (-23, 48), (-8, 56), (-10, 72)])
_THUMB_REST = np.deg2rad([10.0, 8, 14, 18])
_LIBRARY, _NEAR = 420, 150
_LEVEL = ("index", "middle")
_ORDER = ("middle", "index", "ring", "little", "thumb")
#: Whose posture a finger's own is like.
_NEIGHBOURS = {"index": "middle", "ring": "middle", "little": "ring"}
#: How the end joint follows the middle one.
DIP_FOLLOWS_PIP = 0.62
#: Skin may be pressed in so far before it costs, millimetres.
_SLACK = 0.25


def posture_library(finger: str) -> Array:
    """Natural postures of a finger, shape (N, 4), always the same ones."""
    rng = np.random.default_rng([list(FINGERS).index(finger), 5])
    if finger == "thumb":
        low, high = _THUMB_RANGE.T
        return np.asarray(rng.uniform(low, high, (2 * _LIBRARY, 4)))
    low, high = _FINGER_RANGE.T
    angles = rng.uniform(low, high, (_LIBRARY, 4))
    angles[:, 0] *= 0.7
    angles[:, 3] = np.clip(angles[:, 2] * rng.uniform(0.45, 0.8, _LIBRARY), low[3], high[3])
    return angles


@dataclass(eq=False)
class HandSkins:
    """The five fingers of a right hand, with their libraries and few chosen points."""

    shape: HandShape
    skins: dict[str, FingerSkin]
    few: dict[str, npt.NDArray[np.int64]]
    library: dict[str, Array]
    palm: Floats


def hand_skins(shape: HandShape) -> HandSkins:
    """Prepare a right hand for grasp optimisation."""
    skins = {finger: finger_skin(finger, shape) for finger in FINGERS}
    few = {}
    for finger, skin in skins.items():
        stride = 12 if finger == "thumb" else 7
        kept = np.zeros(len(skin.rows), bool)
        kept[::stride] = True
        kept[np.flatnonzero(skin.pad)[::3]] = True
        kept[np.flatnonzero(skin.tip_pad)[::2]] = True
        few[finger] = np.flatnonzero(kept)
    vertices, part = skin_vertices(forward_kinematics(_open_hand(), shape), shape)
    palm = vertices[(part == 5) | ((part == 6) & (vertices[:, 1] > -0.20))]
    library = {finger: posture_library(finger) for finger in FINGERS}
    return HandSkins(shape, skins, few, library, palm.astype(np.float32))


def _open_hand() -> Array:
    angles = np.zeros(20)
    angles[:4] = np.deg2rad([-15, -10, 5, 5])
    angles[5::4], angles[6::4], angles[7::4] = np.deg2rad(35), np.deg2rad(30), np.deg2rad(18)
    return angles


def object_from_wrist(wrist_from_object: Array) -> Array:
    """Inverse of a rigid pose."""
    inverse = np.eye(4)
    inverse[:3, :3] = wrist_from_object[:3, :3].T
    inverse[:3, 3] = -wrist_from_object[:3, :3].T @ wrist_from_object[:3, 3]
    return inverse


def palm_clearance(hand: HandSkins, table: ClearanceTable, pose: Array) -> float:
    """Smallest distance of palm and forearm to the filled object, metres."""
    inverse = object_from_wrist(pose).astype(np.float32)
    return float(table.around(hand.palm @ inverse[:3, :3].T + inverse[:3, 3]).min())


def push_onto_palm(hand: HandSkins, table: ClearanceTable, placement: Placement) -> Placement:
    """Slide the object toward the palm, against the wrist's z axis, until it meets it."""
    pose = placement.wrist_from_object.copy()
    start = pose[2, 3]
    low, high = -0.10, 0.14
    for _ in range(13):
        middle = (low + high) / 2
        pose[2, 3] = start - middle
        free = palm_clearance(hand, table, pose) > -0.0003
        low, high = (middle, high) if free else (low, middle)
    pose[2, 3] = start - low
    return replace(placement, wrist_from_object=pose)


def _through_handle(item: GlassObject, joints: Array) -> npt.NDArray[np.bool_]:
    """Whether bones between joints (N, 4, 3), object frame, go through the handle's opening."""
    inside, low = np.add(np.min(item.handle, 0), [0, item.handle_radius])
    outside, high = np.max(item.handle, 0) - item.handle_radius
    a, b = joints[:, :-1], joints[:, 1:]
    crosses = a[..., 1] * b[..., 1] < 0
    fraction = a[..., 1] / np.where(crosses, a[..., 1] - b[..., 1], 1.0)
    x, _, z = np.moveaxis(a + fraction[..., None] * (b - a), -1, 0)
    found = crosses & (x > inside) & (x < outside) & (z > low) & (z < high)
    return np.asarray(found.any(1))


def bone_spheres(joints: Array, girth: Array) -> tuple[Array, Array]:
    """Spheres along a finger beyond its web: centres (N, 7, 3) and radii (7,)."""
    bone = np.array([0, 0, 1, 1, 2, 2, 2])
    fraction = np.array([0.55, 0.8, 0.05, 0.5, 0.0, 0.4, 0.8])[:, None]
    return joints[:, bone] * (1 - fraction) + joints[:, bone + 1] * fraction, girth[bone]


class GraspOptimisation:
    """One attempt to close a hand on a placed object."""

    def __init__(self, object_id: str, hand: HandSkins, placement: Placement) -> None:
        self.item, self.table = glass_object(object_id), clearance_table(object_id)
        self.hand, self.placement = hand, placement
        self.inverse = object_from_wrist(placement.wrist_from_object)
        #: Of each finger that is closed.
        self.angles, self.joints = dict[str, Array](), dict[str, Array]()
        self.costs = dict[str, float]()

    def _clearance(
        self, action: Action, points: Floats, bone: npt.NDArray[np.int64]
    ) -> tuple[Floats, Floats]:
        """How free each point is (negative: where it must not be) and how near the glass."""
        around = self.table.around(points)
        if action != "inside":
            return around, self.table.glass_near(points, around)
        within = self.table.within(points)
        either = np.maximum(around, within)
        free = np.where((bone == 2)[:, None], within, either)
        return np.asarray(free), self.table.glass_near(points, free)

    def _habit(self, finger: str, angles: Array, neighbour: Array | None) -> Array:
        """How unnatural postures are, whatever they touch."""
        if finger == "thumb":
            return np.asarray(0.35 * np.square((angles - _THUMB_REST) / np.deg2rad(25)).sum(1))
        degrees = np.rad2deg(angles)
        cost = 1.2 * np.square((degrees[:, 3] - DIP_FOLLOWS_PIP * degrees[:, 2]) / 12)
        cost += 0.35 * np.square(degrees[:, 0] / 7)
        cost += 0.5 * np.square(np.maximum(-degrees[:, 1], 0) / 6)
        cost += 0.15 * np.square((degrees[:, 1] - 38) / 30)
        if neighbour is not None:
            beside = np.rad2deg(neighbour)
            cost += 0.45 * np.square((degrees[:, 1] - beside[1]) / 14)
            cost += 0.35 * np.square((degrees[:, 2] - beside[2]) / 18)
        return np.asarray(cost)

    def _contact(
        self,
        skin: FingerSkin,
        action: Action,
        clearance: Floats,
        near: Floats,
        chosen: npt.NDArray[np.int64],
        joints: Array,
    ) -> Array:
        bone, pad, tip_pad = skin.bone[chosen], skin.pad[chosen], skin.tip_pad[chosen]
        gap, touch_gap = clearance * np.float32(1000), near * np.float32(1000)
        pressed = np.maximum(-gap - _SLACK, 0)
        deepest = pressed.max(0)
        cost = 4 * deepest + 2 * deepest**2 + 0.15 * pressed.sum(0)
        if action == "free":
            return np.asarray(cost + 0.6 * np.maximum(2.0 - gap.min(0), 0))
        if action in ("tip", "inside"):
            on_pad = np.abs(touch_gap[tip_pad]).min(0)
            beside = np.maximum(touch_gap[tip_pad].min(0) - touch_gap[bone == 2].min(0), 0)
            cost = cost + 1.6 * np.minimum(on_pad, 25) + 1.5 * beside
        elif action == "wrap":
            for number, weight in ((2, 1.0), (1, 0.7), (0, 0.25)):
                touch = np.abs(touch_gap[pad & (bone == number)]).min(0)
                cost = cost + weight * np.minimum(touch, 20)
        else:
            first, middle, last = (np.abs(gap[pad & (bone == b)]).min(0) for b in range(3))
            local = joints @ self.inverse[:3, :3].T + self.inverse[:3, 3]
            outside = ~_through_handle(self.item, local)
            cost = cost + 1.2 * np.minimum(np.minimum(middle, first), 20)
            cost = cost + 0.25 * last.clip(0, 20) + 40.0 * outside
        return np.asarray(cost)

    def _overlap(self, finger: str, joints: Array, closed: dict[str, Array]) -> Array:
        """Cost of a finger in others that are closed already, and in the palm."""
        centers, radii = bone_spheres(joints, self.hand.skins[finger].girth)
        total = np.zeros(len(joints))
        for other, fixed in closed.items():
            at, size = bone_spheres(fixed[None], self.hand.skins[other].girth)
            away = np.linalg.norm(centers[:, :, None] - at[0], axis=-1) - radii[:, None] - size
            deep = np.maximum(-away.min((1, 2)) * 1000 - 0.8, 0)
            total += 1.5 * deep + 0.8 * deep**2
        s = self.hand.shape.scale
        over = (centers[:, :, 1] < 0.092 * s) & (np.abs(centers[:, :, 0] + 0.006 * s) < 0.045 * s)
        if finger != "thumb":
            deep = np.where(over, radii + 0.0125 * s - centers[:, :, 2], 0).max(1) * 1000 - 0.5
            deep = np.maximum(deep, 0)
            total += 1.5 * deep + 0.8 * deep**2
        return np.asarray(total)

    def _opposition(self, joints: Array, closed: dict[str, Array]) -> Array:
        """Cost of a thumb that does not face the fingers across the object."""
        acting = [f for f in closed if self.placement.plan[f] != "free"]
        if self.placement.plan["thumb"] != "tip" or {"hook", "inside"} & set(
            self.placement.plan.values()
        ):
            return np.zeros(len(joints))
        inverse = self.inverse
        tips = np.stack([closed[f][3] for f in acting]) @ inverse[:3, :3].T + inverse[:3, 3]
        thumb = joints[:, 3] @ inverse[:3, :3].T + inverse[:3, 3]
        facing = tips[:, :2] / np.linalg.norm(tips[:, :2], axis=1, keepdims=True)
        mean = facing.mean(0)
        mean = mean / max(float(np.linalg.norm(mean)), 1e-9)
        own = thumb[:, :2] / np.maximum(np.linalg.norm(thumb[:, :2], axis=1, keepdims=True), 1e-9)
        beside = np.maximum(own @ mean + 0.5, 0)
        # At the height of index and middle finger, where these hold from the side.
        level = np.stack(
            [closed[f][3] @ inverse[2, :3] + inverse[2, 3] for f in acting if f in _LEVEL]
        ).mean()
        off = np.maximum(np.abs(thumb[:, 2] - level) * 1000 - 6, 0) / 12
        return np.asarray(4.0 * beside + 1.2 * np.minimum(off, 4) ** 2)

    def _best(
        self,
        finger: str,
        angles: Array,
        chosen: npt.NDArray[np.int64],
        bias: tuple[Floats, Floats] | None = None,
        *,
        alone: bool = False,
    ) -> None:
        """Close a finger by the best of some angle sets, ``alone`` without regard to others."""
        skin, action = self.hand.skins[finger], self.placement.plan[finger]
        closed = {} if alone else {f: j for f, j in self.joints.items() if f != finger}
        points, joints = skin.pose(angles, self.inverse, chosen)
        clearance, near = self._clearance(action, points, skin.bone[chosen])
        if bias is not None:
            clearance, near = clearance + bias[0][:, None], near + bias[1][:, None]
        cost = self._contact(skin, action, clearance, near, chosen, joints)
        neighbour = None if alone else self.angles.get(_NEIGHBOURS.get(finger, ""))
        cost += self._habit(finger, angles, neighbour)
        if closed:
            cost += self._overlap(finger, joints, closed)
        if finger == "thumb" and closed:
            cost += self._opposition(joints, closed)
        best = int(np.argmin(cost))
        self.angles[finger], self.joints[finger] = angles[best], joints[best]
        self.costs[finger] = float(cost[best])

    def screen(self) -> float:
        """Cost of the best posture in each finger's library: how promising the placement is."""
        for finger in _ORDER:
            some = self.hand.library[finger][::2]
            self._best(finger, some, self.hand.few[finger], alone=finger != "thumb")
        return sum(self.costs.values())

    def run(self, rng: np.random.Generator) -> tuple[Array, float]:
        """Close the open fingers: the twenty angles of a right hand, radians, and their cost."""
        for finger in _ORDER:
            few = self.hand.few[finger]
            self._best(finger, self.hand.library[finger], few)
            self._improve(finger, 0.22, rng, few)
        return self.settle(self._all_angles(), rng, (0.10, 0.05, 0.03))

    def _all_angles(self) -> Array:
        return np.concatenate([self.angles[f] for f in FINGERS])

    def settle(
        self, start: Array, rng: np.random.Generator, widths: tuple[float, ...]
    ) -> tuple[Array, float]:
        """Improve a right hand's twenty angles (radians) that are near already, on the skin itself.

        Variations go as far as ``widths`` in each round, in fractions of a joint's range. The
        improved angles and their cost.
        """
        self.joints = {}  # costs are summed in the order of fingers, whatever was closed before
        for i, (finger, skin) in enumerate(self.hand.skins.items()):
            self.angles[finger] = angles = start[4 * i : 4 * i + 4]
            self.joints[finger] = skin.bones(angles[None])[1][0] * skin.scale
        for width in widths:
            truth = self._true_skin().astype(np.float32)
            for finger in _ORDER:
                skin, action = self.hand.skins[finger], self.placement.plan[finger]
                points, _ = skin.pose(self.angles[finger][None], self.inverse)
                blended = self._clearance(action, points, skin.bone)
                exact = self._clearance(action, truth[skin.rows][:, None], skin.bone)
                bias = (exact[0] - blended[0])[:, 0], (exact[1] - blended[1])[:, 0]
                self._improve(finger, width, rng, np.arange(len(skin.rows)), bias)
        return self._all_angles(), sum(self.costs[f] for f in FINGERS)

    def _true_skin(self) -> Array:
        """The whole skin of the pose in the object's frame."""
        shape = self.hand.shape
        vertices, _ = skin_vertices(forward_kinematics(self._all_angles(), shape), shape)
        return vertices @ self.inverse[:3, :3].T + self.inverse[:3, 3]

    def _improve(
        self,
        finger: str,
        width: float,
        rng: np.random.Generator,
        chosen: npt.NDArray[np.int64],
        bias: tuple[Floats, Floats] | None = None,
    ) -> None:
        low, high = (_THUMB_RANGE if finger == "thumb" else _FINGER_RANGE).T
        angles = self.angles[finger]
        near = np.clip(angles + rng.normal(size=(_NEAR, 4)) * width * (high - low) * 0.5, low, high)
        near[0] = angles
        self._best(finger, near, chosen, bias)
