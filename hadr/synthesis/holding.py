"""Holding poses: where a hand takes hold of an object, and how its fingers close on it.

A pose is built in the wrist frame of a right hand. The object is put where the kind of hold wants
it and pushed onto the palm; then each finger looks for the joint angles at which its flesh lies on
the glass without entering it. A left hand is the mirror image.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from hadr.hand import FINGERS, HandShape, Side, forward_kinematics
from hadr.synthesis.hand_mesh import FINGER_RADII
from hadr.synthesis.objects import (
    GlassObject,
    glass_object,
    handle_line,
    signed_distance,
)

Array = npt.NDArray[np.float64]

#: Which kinds of hold each object allows, in the order in which hold numbers go through them.
HOLD_KINDS: dict[str, tuple[str, ...]] = {
    "0000": ("side", "above", "cradle", "oblique"),
    "0001": ("stem", "side", "oblique"),
    "0004": ("stem", "side", "oblique"),
    "0005": ("side", "above", "oblique", "cradle"),
    "0006": ("side", "neck", "oblique", "above"),
    "0007": ("side", "above", "cradle", "oblique"),
    "0008": ("side", "cradle", "oblique", "above"),
    "0009": ("cradle", "rim", "oblique"),
}
_TOUCH = 0.0025
_CELL = 0.002


@dataclass(frozen=True)
class Hold:
    """A hand that holds an object.

    Args:
        hold_id: Names the pose, e.g. ``0004-stem-0007``; frames that share it are near-duplicates.
        object_id: The object.
        kind: One of the kinds in ``HOLD_KINDS``.
        shape: Sizes and side of the hand.
        angles: The twenty joint angles, radians, shape (20,).
        wrist_from_object: Pose of the object in the wrist frame, shape (4, 4).
        gaps: Smallest distance of each finger's flesh and of the palm to the glass, metres;
            negative where it is pressed in.
    """

    hold_id: str
    object_id: str
    kind: str
    shape: HandShape
    angles: Array
    wrist_from_object: Array
    gaps: dict[str, float]

    @property
    def touching(self) -> tuple[str, ...]:
        """Which of the fingers and the palm touch the glass (within 2.5 mm)."""
        return tuple(name for name, gap in self.gaps.items() if gap < _TOUCH)


@lru_cache(maxsize=16)
def _distance_grid(object_id: str) -> tuple[Array, float]:
    item = glass_object(object_id)
    r = np.arange(0.0, 0.16, _CELL)
    z = np.arange(-0.12, item.height + 0.12, _CELL)
    rr, zz = np.meshgrid(r, z, indexing="ij")
    points = np.stack([rr.ravel(), np.zeros(rr.size), zz.ravel()], axis=1)
    bare = GlassObject(item.object_id, item.name, item.outer, item.inner, item.grip)
    distance = [signed_distance(bare, part) for part in np.array_split(points, 16)]
    return np.concatenate(distance).reshape(rr.shape), -0.12


def _distance(item: GlassObject, points: Array) -> Array:
    """Signed distance from a table over (r, z), the handle added; points (..., 3), object frame."""
    grid, z0 = _distance_grid(item.object_id)
    r = np.hypot(points[..., 0], points[..., 1])
    index = np.stack([r / _CELL, (points[..., 2] - z0) / _CELL])
    size = np.array(grid.shape).reshape((2,) + (1,) * (index.ndim - 1)) - 1.0
    inner = np.clip(index, 0, size)
    beyond = np.linalg.norm(index - inner, axis=0) * _CELL
    distance = map_coordinates(grid, inner, order=1) + beyond
    line = handle_line(item)
    if len(line):
        offset = points[..., None, :] - line[::2]
        tube = np.sqrt((offset**2).sum(-1)).min(-1) - item.handle_radius
        distance = np.minimum(distance, np.maximum(tube, line[:, 0].min() - r))
    return np.asarray(distance)


def _finger_chain(finger: str, angles: Array, shape: HandShape) -> tuple[Array, Array, Array]:
    """Flesh samples of one finger for many angle sets.

    Returns:
        Sample centres (N, 12, 3) in a right hand's wrist frame, their radii (12,), and the
        directions in which the three bones' pads face, (N, 3, 3).
    """
    n = len(angles)
    rest = forward_kinematics(np.zeros(20), HandShape("right", shape.scale))
    first = 1 + FINGERS[finger][0]
    spread = Rotation.from_rotvec(-angles[:, :1] * np.array([0.0, 0.0, 1.0])).as_matrix()
    turn = rest.frames[first, :3, :3] @ spread
    start = np.broadcast_to(rest.joints[first], (n, 3))
    radii = np.asarray(FINGER_RADII[finger]) * shape.scale
    centers, sizes, pads = [], [], []
    for bone in range(3):
        turn = (
            turn
            @ Rotation.from_rotvec(angles[:, 1 + bone, None] * np.array([1.0, 0, 0])).as_matrix()
        )
        length = shape.lengths[finger][bone] * shape.scale
        usable = length - (0.45 * radii[3] if bone == 2 else 0.0)
        for share in (0.25, 0.5, 0.75, 1.0):
            r = radii[bone] + share * (radii[bone + 1] - radii[bone])
            centers.append(start + share * usable * turn[:, :, 1] + 0.1 * r * turn[:, :, 2])
            sizes.append(r)
        start = start + length * turn[:, :, 1]
        pads.append(turn[:, :, 2])
    return np.stack(centers, axis=1), np.asarray(sizes), np.stack(pads, axis=1)


def _palm_samples(scale: float) -> tuple[Array, Array]:
    joints = forward_kinematics(np.zeros(20)).joints
    points, radii = [], []
    for finger, x in (("index", 0.014), ("middle", 0.004), ("ring", -0.006), ("little", -0.016)):
        root = joints[1 + FINGERS[finger][0]]
        for share in np.linspace(0.1, 1.0, 7):
            points.append((1 - share) * np.array([x, 0.008, 0.0]) + share * root)
            radii.append(0.0150 + share * (0.0115 - 0.0150))
    ball = np.array([[0.016, 0.016, 0.008], [-0.021, 0.014, 0.007], [-0.031, 0.045, 0.006]])
    points += list(ball)
    radii += [0.0165, 0.0145, 0.012]
    return np.asarray(points) * scale, np.asarray(radii) * scale


def _to_object(wrist_from_object: Array, points: Array) -> Array:
    return np.asarray((points - wrist_from_object[:3, 3]) @ wrist_from_object[:3, :3])


def _pose_from_axis(axis: Array, point: Array, height: float, turn: float) -> Array:
    """Object pose whose axis has a direction and whose axis point at ``height`` is given."""
    z = axis / np.linalg.norm(axis)
    helper = np.array([0.0, 0.0, 1.0]) if abs(z[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
    x = np.cross(helper, z)
    x /= np.linalg.norm(x)
    basis = np.stack([x, np.cross(z, x), z], axis=1) @ Rotation.from_euler("z", turn).as_matrix()
    pose = np.eye(4)
    pose[:3, :3] = basis
    pose[:3, 3] = point - height * z
    return pose


def _push(item: GlassObject, pose: Array, direction: Array, points: Array, radii: Array) -> Array:
    """Slide the object along a direction until it touches the samples."""
    lo, hi = -0.15, 0.15
    moved = pose.copy()
    for _ in range(22):
        middle = (lo + hi) / 2
        moved[:3, 3] = pose[:3, 3] + middle * direction
        gap = (_distance(item, _to_object(moved, points)) - radii).min()
        lo, hi = (middle, hi) if gap > 0 else (lo, middle)
    moved[:3, 3] = pose[:3, 3] + lo * direction
    return moved


def _place(
    item: GlassObject, kind: str, shape: HandShape, rng: np.random.Generator
) -> tuple[Array, dict[str, str]]:
    """Object pose for a kind of hold, and what each finger does: wrap, tip or rest."""
    s, jitter = shape.scale, rng.uniform(-1, 1, 8)
    palm, palm_radii = _palm_samples(s)
    fingers = ("index", "middle", "ring", "little")
    toward_palm = np.array([0.0, 0.0, -1.0])
    turn = float(rng.uniform(-0.5, 0.5))
    if kind in ("side", "oblique", "neck"):
        lean = np.deg2rad(12 + 8 * jitter[0] + (24 if kind == "oblique" else 0))
        axis = np.array([np.cos(lean), -np.sin(lean), 0.10 * jitter[1]])
        low, high = (item.height - 0.05, item.height - 0.03) if kind == "neck" else item.grip
        # The hand is 8 cm wide: keep it within the grip where that is long enough.
        middle, room = (low + high) / 2, max((high - low) / 2 - 0.035, 0.004)
        height = middle + room * jitter[2]
        radius = item.outer_radius(height)
        y = 0.094 - 0.35 * min(radius, 0.04) + 0.004 * jitter[3]
        point = np.array([-0.006, y, 0.10]) * s
        # The mug's handle stands away from the palm's heel and from the fingers' tips.
        pose = _pose_from_axis(axis, point, height, turn + (np.pi if item.handle else 0.0))
        pose = _push(item, pose, toward_palm, palm, palm_radii)
        return pose, {"thumb": "tip", **dict.fromkeys(fingers, "wrap")}
    if kind == "stem":
        low, high = item.stem or item.grip
        height = high - 0.012 + 0.004 * jitter[0]
        axis = np.array([1.0, -0.25 + 0.15 * jitter[1], -0.15 + 0.1 * jitter[2]])
        point = np.array([0.034 + 0.003 * jitter[3], 0.104 + 0.004 * jitter[4], 0.060]) * s
        pose = _pose_from_axis(axis, point, height, turn)
        plan = {"thumb": "tip", "index": "tip", "middle": "tip", "ring": "rest", "little": "rest"}
        return pose, plan
    if kind == "above":
        bend = np.deg2rad(32 + 8 * jitter[0])
        along = np.array([0.06 * jitter[1], np.cos(bend), np.sin(bend)])
        pad = np.array([0.0, -np.sin(bend), np.cos(bend)])
        height = item.height - 0.016 + 0.004 * jitter[2]
        radius = item.outer_radius(height)
        reach = 0.066 + 0.005 * jitter[3]
        point = (np.array([0.006, 0.088, 0.0]) + reach * along) * s + (radius + 0.011 * s) * pad
        pose = _pose_from_axis(-along, point, height, turn)
        return pose, {"thumb": "tip", **dict.fromkeys(fingers, "tip")}
    if kind == "cradle":
        axis = np.array([0.10 * jitter[0], -0.12 + 0.10 * jitter[1], 1.0])
        point = np.array([-0.004, 0.078 + 0.006 * jitter[2], 0.08]) * s
        pose = _pose_from_axis(axis, point, 0.0, turn)
        pose = _push(item, pose, toward_palm, palm, palm_radii)
        return pose, {"thumb": "tip", **dict.fromkeys(fingers, "wrap")}
    # rim: the wall between the thumb on the inside and the fingers below the outside.
    slope = np.deg2rad(58 + 6 * jitter[0])
    axis = np.array([0.08 * jitter[1], -np.cos(slope), np.sin(slope)])
    out = np.array([0.0, np.sin(slope), np.cos(slope)])
    height = item.height
    rim = np.array([0.018, 0.104 + 0.004 * jitter[2], 0.036 + 0.003 * jitter[3]]) * s
    pose = _pose_from_axis(axis, rim + item.outer_radius(height - 0.003) * out, height, turn)
    return pose, {"thumb": "tip", **dict.fromkeys(fingers, "tip")}


_RANGES = {
    "finger": np.deg2rad([(-9, 9), (-15, 88), (3, 105), (0, 65)]),
    "thumb": np.deg2rad([(-25, 40), (-25, 48), (-8, 52), (-8, 65)]),
}
_REST = {
    "finger": np.deg2rad([0.0, 30, 38, 22]),
    "thumb": np.deg2rad([12.0, 8, 14, 14]),
}


def _close(
    item: GlassObject,
    finger: str,
    action: str,
    pose: Array,
    shape: HandShape,
    rng: np.random.Generator,
) -> tuple[Array, float]:
    """Angles of one finger that lay it on the glass, and its smallest gap."""
    group = "thumb" if finger == "thumb" else "finger"
    low, high = _RANGES[group].T
    rest = _REST[group]
    angles = rng.uniform(low, high, size=(700, 4))
    if group == "finger":
        angles[:, 0] *= 0.6
        angles[:, 3] = np.clip(angles[:, 2] * rng.uniform(0.3, 0.75, 700), low[3], high[3])
    best, best_cost, best_gap = rest, np.inf, 1.0
    width = (high - low) * 0.12
    for _ in range(3):
        centers, radii, pads = _finger_chain(finger, angles, shape)
        local = _to_object(pose, centers)
        gaps = _distance(item, local) - radii
        step = 0.0015
        ahead = _distance(item, local[:, -1] + step * (pads[:, 2] @ pose[:3, :3]))
        # 1 where the pad of the tip looks straight at the glass, -1 where it looks away.
        facing = (gaps[:, -1] + radii[-1] - ahead) / step
        inside = np.maximum(-(gaps + 0.0004), 0.0)
        bone = gaps.reshape(-1, 3, 4).min(-1)
        cost = 4e5 * (inside**2).sum(1) + 0.004 * np.square((angles - rest) / (high - low)).sum(1)
        if group == "finger":
            cost += 0.02 * np.square(angles[:, 3] - 0.6 * angles[:, 2])
        if action == "wrap":
            cost += np.abs(bone[:, 2]) * 22 + np.abs(bone[:, 1]) * 16 + np.abs(bone[:, 0]) * 8
            cost += 0.10 * np.maximum(0.3 - facing, 0)
        elif action == "tip":
            cost += np.abs(gaps[:, -2:].min(1)) * 60 + 0.16 * np.maximum(0.75 - facing, 0)
        winner = int(np.argmin(cost))
        if cost[winner] < best_cost:
            best, best_cost, best_gap = angles[winner], cost[winner], float(gaps[winner].min())
        angles = np.clip(best + rng.normal(size=(260, 4)) * width, low, high)
        width = width * 0.3
    return best, best_gap


def _make(
    item: GlassObject, kind: str, side: Side, name: str, rng: np.random.Generator
) -> tuple[Hold, float]:
    shape = HandShape(side, float(rng.uniform(0.93, 1.07)))
    pose, plan = _place(item, kind, shape, rng)
    angles, gaps = np.zeros(20), {}
    for i, finger in enumerate(FINGERS):
        angles[4 * i : 4 * i + 4], gaps[finger] = _close(
            item, finger, plan[finger], pose, shape, rng
        )
    palm, radii = _palm_samples(shape.scale)
    gaps["palm"] = float((_distance(item, _to_object(pose, palm)) - radii).min())
    if side == "left":
        pose = np.diag([-1.0, 1, 1, 1]) @ pose @ np.diag([1.0, -1, 1, 1])
    hold = Hold(name, item.object_id, kind, shape, angles, pose, gaps)
    pressed = sum(max(-gap - 0.001, 0.0) for gap in gaps.values())
    loose = sum(max(gaps[f] - _TOUCH, 0.0) for f, action in plan.items() if action != "rest")
    return hold, 8 * pressed + loose


def holds_well(hold: Hold) -> bool:
    """Two fingers and the thumb or the palm touch, and nothing is pressed in deeper than 3 mm."""
    touching = set(hold.touching)
    fingers = len(touching & {"index", "middle", "ring", "little"})
    opposed = bool(touching & {"thumb", "palm"})
    return fingers >= 2 and opposed and min(hold.gaps.values()) > -0.003


@lru_cache(maxsize=64)
def make_hold(object_id: str, number: int, seed: int = 0) -> Hold:
    """Make the holding pose number ``number`` of an object.

    Args:
        object_id: One of the eight ids.
        number: Which pose, from 0; kinds of hold and hands alternate.
        seed: Seed of the whole data set.

    Returns:
        The pose; the same for the same three arguments.

    Raises:
        ValueError: The object is unknown, or the number is negative.
    """
    item = glass_object(object_id)
    if number < 0:
        raise ValueError(f"number of a hold starts at 0, got {number}")
    kinds = HOLD_KINDS[object_id]
    kind = kinds[(number + int(object_id)) % len(kinds)]
    rng = np.random.default_rng([seed, int(object_id), number, 11])
    side: Side = "right" if rng.random() < 0.6 else "left"
    name = f"{object_id}-{kind}-{number:04d}"
    best, best_cost = None, np.inf
    for attempt in range(15):
        hold, cost = _make(item, kind, side, name, rng)
        cost += 0.0 if holds_well(hold) else 1.0
        if best is None or cost < best_cost:
            best, best_cost = hold, cost
        if best_cost < 0.012 or (attempt >= 5 and best_cost < 1.0):
            break
    assert best is not None
    return best
