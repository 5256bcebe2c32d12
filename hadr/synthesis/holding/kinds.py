"""The kinds of hold: where the object stands in the hand, and what each finger does.

All is said in the wrist frame of a right hand (y toward the middle finger's knuckle, z out of the
palm, x to the thumb's side); a left hand is the mirror image.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from hadr.synthesis.glass.shape import GlassObject

Array = npt.NDArray[np.float64]
#: What a finger does: lie on the glass along its length, touch it with the pad of its tip, do so
#: from inside the mouth, go through the handle, or rest beside its neighbours.
Action = Literal["wrap", "tip", "inside", "hook", "free"]

#: Each kind of hold in a sentence.
KIND_MEANING: dict[str, str] = {
    "side": "power hold: the palm and all fingers around the body, the thumb toward the mouth",
    "low": "the same close to the base of a tall object",
    "high": "the same close to the mouth of a tall object",
    "oblique": "power hold with the object leaning across the palm",
    "reverse": "power hold with the thumb toward the base, as one turns a glass over",
    "tips": "precision hold: thumb and four finger tips on the wall, the palm away from it",
    "pinch": "precision hold with thumb, index and middle finger only",
    "above": "finger tips around the mouth, the palm above it",
    "below": "finger tips around the base, the palm below it",
    "cradle": "the base on the palm, fingers and thumb up along the wall",
    "rim": "the wall between the thumb inside the mouth and the fingers outside",
    "nip": "the same with thumb, index and middle finger only",
    "lip": "the wall between the fingers inside the mouth and the thumb outside",
    "carry": "the thumb over the rim into the mouth, the fingers under the wall",
    "stem": "the stem between thumb, index and middle finger",
    "fist": "all fingers around the stem",
    "foot": "the foot between the thumb on top and the fingers below",
    "handle": "two fingers through the handle, the thumb on top of it",
    "neck": "power hold around the neck",
}
#: The eight holds of each object; hold number ``n`` is of kind ``n % 8``.
HOLD_KINDS: dict[str, tuple[str, ...]] = {
    "0000": ("side", "above", "tips", "rim", "oblique", "cradle", "below", "reverse"),
    "0001": ("stem", "side", "above", "oblique", "foot", "tips", "reverse", "pinch"),
    "0004": ("side", "stem", "tips", "above", "oblique", "fist", "pinch", "reverse"),
    "0005": ("tips", "side", "cradle", "above", "reverse", "rim", "oblique", "below"),
    "0006": ("side", "neck", "oblique", "above", "low", "tips", "reverse", "below"),
    "0007": ("above", "side", "tips", "cradle", "oblique", "below", "rim", "reverse"),
    "0008": ("handle", "side", "above", "cradle", "rim", "oblique", "tips", "below"),
    "0009": ("cradle", "rim", "carry", "below", "nip", "above", "pinch", "lip"),
    "0010": ("neck", "side", "oblique", "above", "low", "tips", "reverse", "below"),
    "0011": ("neck", "side", "above", "tips", "oblique", "reverse", "cradle", "below"),
    "0012": ("stem", "fist", "above", "foot", "nip", "lip", "pinch", "reverse"),
}
#: Fingers that a kind of hold puts into the mouth.
FINGERS_INSIDE: dict[str, tuple[str, ...]] = {
    "rim": ("thumb",),
    "nip": ("thumb",),
    "carry": ("thumb",),
    "lip": ("index", "middle", "ring", "little"),
}
_FINGERS = ("index", "middle", "ring", "little")


@dataclass(frozen=True, eq=False)
class Placement:
    """An object in a right hand, before the fingers close.

    Args:
        wrist_from_object: Pose of the object, shape (4, 4).
        plan: What each finger does.
        palm_gap: Distance that the palm keeps from the glass, metres; 0 lets it touch.
    """

    wrist_from_object: Array
    plan: dict[str, Action]
    palm_gap: float = 0.0


def _unit(vector: npt.ArrayLike) -> Array:
    v = np.asarray(vector, dtype=float)
    return np.asarray(v / np.linalg.norm(v))


def pose_from_axis(
    up: npt.ArrayLike, point: npt.ArrayLike, height: float, toward: npt.ArrayLike, roll: float = 0.0
) -> Array:
    """Object pose whose axis has a direction and passes a point at a height of the object.

    Args:
        up: Direction of the object's axis, wrist frame, shape (3,).
        point: Where the axis is at ``height``, wrist frame, metres.
        height: Metres above the table in the object's frame.
        toward: Direction in which the object's x axis (and a handle) points, made upright to the
            axis; its component along ``up`` does not matter.
        roll: Further rotation about the axis, radians.

    Returns:
        ``wrist_from_object``, shape (4, 4).
    """
    z = _unit(up)
    helper = np.asarray(toward, dtype=float)
    x = _unit(helper - (helper @ z) * z)
    y = np.cross(z, x)
    pose = np.eye(4)
    pose[:3, :3] = np.stack(
        [np.cos(roll) * x + np.sin(roll) * y, np.cos(roll) * y - np.sin(roll) * x, z], axis=1
    )
    pose[:3, 3] = np.asarray(point, dtype=float) - height * z
    return pose


def finger_plan(kind: str) -> dict[str, Action]:
    """What each finger does in a kind of hold."""
    two: tuple[Action, ...] = ("tip", "tip", "free", "free")
    thumb: Action = "inside" if kind in ("rim", "nip", "carry") else "tip"
    others: tuple[Action, ...]
    if kind in ("pinch", "stem", "foot", "nip"):
        others = two
    elif kind == "handle":
        others = ("hook", "hook", "free", "free")
    elif kind == "lip":
        others = ("inside",) * 4
    elif kind in ("tips", "above", "below", "rim", "carry"):
        others = ("tip",) * 4
    else:
        others = ("wrap",) * 4
    return {"thumb": thumb, **dict(zip(_FINGERS, others, strict=True))}


_Draw = Callable[[float, float], float]


def _power(item: GlassObject, kind: str, s: float, draw: _Draw) -> tuple[Placement, Array]:
    """The body across the palm; the pose is then pushed onto it."""
    lean = np.deg2rad(draw(26, 42) if kind == "oblique" else draw(2, 18))
    up = np.array([np.cos(lean), np.sin(lean), draw(-0.10, 0.10)])
    if kind == "reverse":
        up = -up
    low, high = item.grip
    if kind == "neck":
        low, high = item.height - 0.055, item.height - 0.035
    elif kind == "low":
        high = (low + high) / 2 - 0.01
        low = low + 0.012
    elif kind == "high":
        low = (low + high) / 2 + 0.01
    elif kind == "fist":
        low, high = item.stem or item.grip
    middle, room = (low + high) / 2, max((high - low) / 2 - 0.032, 0.004)
    height = middle + room * draw(-1, 1)
    radius = item.outer_radius(height)
    y = 0.088 - 0.40 * min(radius, 0.045) + draw(-0.006, 0.024)
    point = np.array([-0.004 + draw(-0.004, 0.004), y, 0.10]) * s
    # A handle stands away from the palm, toward the fingers' tips or the thumb's.
    pose = pose_from_axis(up, point, height, (0, 0.4 * draw(-1, 1), 1), draw(-0.2, 0.2))
    return Placement(pose, finger_plan(kind)), np.array([0.0, 0.0, -1.0])


def _tips(item: GlassObject, kind: str, s: float, draw: _Draw) -> Placement:
    lean = np.deg2rad(draw(-5, 30))
    up = np.array([np.cos(lean), np.sin(lean), draw(-0.25, 0.15)])
    low, high = item.grip
    wide = 0.018 if kind == "pinch" else 0.030
    height = (low + high) / 2 + max((high - low) / 2 - wide, 0.003) * draw(-1, 1)
    if kind == "pinch":
        height = high - draw(0.0, 0.02)
    radius = item.outer_radius(height)
    x = draw(0.012, 0.030) if kind == "pinch" else draw(-0.004, 0.014)
    point = np.array([x, draw(0.070, 0.100), 0.0]) * s
    point[2] = radius + draw(0.026, 0.046) * s
    pose = pose_from_axis(up, point, height, (0, 0.3, 1), draw(-0.4, 0.4))
    return Placement(pose, finger_plan(kind), 0.012)


def _around(item: GlassObject, kind: str, s: float, draw: _Draw) -> Placement:
    """Finger tips around the mouth from above, or around the base from below."""
    bend = np.deg2rad(draw(35, 75))
    away = _unit([draw(0.0, 0.35), np.cos(bend), np.sin(bend)])
    radius = item.outer_radius(item.height - 0.012 if kind == "above" else 0.02)
    if kind == "above":
        height = item.height - draw(0.008, 0.022)
        up = -away
    else:
        height = draw(0.012, 0.032) + (0.012 if item.object_id == "0009" else 0.0)
        up = away
    radius = item.outer_radius(height)
    base = np.array([0.012, 0.070, 0.012]) * s
    side = _unit(np.cross(away, [1.0, 0, 0]))  # in the hand's plane, toward the palm's normal
    point = base + draw(0.050, 0.085) * s * away + side * draw(-0.012, 0.012) * s
    point = point + np.array([0.0, 0.0, 0.3 * (radius - 0.03)])
    pose = pose_from_axis(up, point, height, (1, 0, 0.4), draw(-0.8, 0.8))
    return Placement(pose, finger_plan(kind), 0.008)


def _cradle(item: GlassObject, s: float, draw: _Draw) -> tuple[Placement, Array]:
    up = np.array([draw(-0.15, 0.15), draw(-0.30, 0.10), 1.0])
    point = np.array([draw(-0.008, 0.006), draw(0.062, 0.086), 0.08]) * s
    pose = pose_from_axis(up, point, 0.0, (draw(-1, 1), 1, 0))
    return Placement(pose, finger_plan("cradle")), np.array([0.0, 0.0, -1.0])


def _rim(item: GlassObject, kind: str, s: float, draw: _Draw) -> Placement:
    """The wall between thumb and fingers, near the mouth; one of them is inside."""
    if kind in ("rim", "nip"):  # the hand above, its forearm over the mouth or beside it
        slope = np.deg2rad(draw(0, 50) if kind == "rim" else draw(25, 80))
        pinch = np.array([draw(0.010, 0.032), draw(0.090, 0.115), draw(0.040, 0.065)]) * s
        out = np.array([draw(-0.3, 0.1), np.cos(slope), -np.sin(slope)])
        up = np.array([draw(-0.25, 0.25), -np.sin(slope), -np.cos(slope)])
        depth = draw(0.010, 0.024)
    elif kind == "lip":  # the hand above, the object beyond the thumb
        slope = np.deg2rad(draw(-25, 35))
        pinch = np.array([draw(0.008, 0.030), draw(0.085, 0.115), draw(0.040, 0.068)]) * s
        out = np.array([draw(-0.1, 0.4), -np.cos(slope), np.sin(slope)])
        up = np.array([draw(-0.25, 0.25), -np.sin(slope), -np.cos(slope)])
        depth = draw(0.010, 0.024)
    else:  # the hand beside the wall, the rim in the thumb's web, the palm up
        slope = np.deg2rad(draw(50, 95))
        pinch = np.array([draw(0.010, 0.030), draw(0.088, 0.112), draw(0.022, 0.044)]) * s
        out = np.array([draw(-0.25, 0.1), np.cos(slope), -np.sin(slope)])
        up = np.array([draw(-0.25, 0.25), -np.sin(slope), -np.cos(slope)])
        depth = draw(0.014, 0.032)
    up = _unit(up)
    out = _unit(out - (out @ up) * up)
    height = item.height - depth
    radius = item.outer_radius(height) - 0.001
    pose = pose_from_axis(up, pinch - radius * out, height, -out, draw(-0.3, 0.3))
    return Placement(pose, finger_plan(kind), 0.006)


def _stem(item: GlassObject, s: float, draw: _Draw) -> Placement:
    low, high = item.stem or item.grip
    height = draw(low + 0.02, high)
    up = np.array([1.0, draw(-0.5, 0.3), draw(-0.4, 0.2)])
    point = np.array([draw(0.020, 0.038), draw(0.090, 0.115), draw(0.045, 0.070)]) * s
    pose = pose_from_axis(up, point, height, (0, 0, 1), draw(-3, 3))
    return Placement(pose, finger_plan("stem"), 0.010)


def _foot(item: GlassObject, s: float, draw: _Draw) -> Placement:
    tilt = np.deg2rad(draw(45, 80))
    up = _unit([draw(-0.1, 0.5), -np.cos(tilt), np.sin(tilt)])
    pinch = np.array([draw(0.018, 0.034), draw(0.092, 0.112), draw(0.042, 0.062)]) * s
    out = np.array([draw(-0.3, 0.3), np.sin(tilt), np.cos(tilt)])  # from the pinch to the axis
    out = _unit(out - (out @ up) * up)
    foot = item.outer_radius(0.0015)
    height = 0.0015
    point = pinch + out * (foot - draw(0.008, 0.014))
    pose = pose_from_axis(up, point, height, out, draw(-3, 3))
    return Placement(pose, finger_plan("foot"), 0.010)


def _handle(item: GlassObject, s: float, draw: _Draw) -> Placement:
    line = np.asarray(item.handle)
    reach, middle = float(line[:, 0].max()), float(line[:, 1].mean())
    up = _unit([1.0, draw(-0.25, 0.25), draw(-0.25, 0.15)])
    angle = np.deg2rad(draw(10, 75))
    body = np.array([draw(-0.2, 0.2), np.cos(angle), np.sin(angle)])
    body = _unit(body - (body @ up) * up)
    bar = np.array([draw(0.002, 0.016), draw(0.086, 0.112), draw(0.020, 0.048)]) * s
    height = middle + draw(-0.004, 0.006)
    pose = pose_from_axis(up, bar + reach * body, height, -body, draw(-0.15, 0.15))
    return Placement(pose, finger_plan("handle"), 0.002)


def draw_placement(
    item: GlassObject, kind: str, scale: float, rng: np.random.Generator
) -> tuple[Placement, Array | None]:
    """Put the object into a hand of a size as a kind of hold wants it, with some freedom.

    Returns:
        The placement; and the direction (wrist frame) in which the object still has to be pushed
        until it meets the palm, None where it stays where it is.

    Raises:
        ValueError: The kind is unknown.
    """

    def draw(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    if kind in ("side", "low", "high", "oblique", "reverse", "neck", "fist"):
        return _power(item, kind, scale, draw)
    if kind == "cradle":
        return _cradle(item, scale, draw)
    if kind in ("tips", "pinch"):
        return _tips(item, kind, scale, draw), None
    if kind in ("above", "below"):
        return _around(item, kind, scale, draw), None
    if kind in ("rim", "nip", "carry", "lip"):
        return _rim(item, kind, scale, draw), None
    if kind == "stem":
        return _stem(item, scale, draw), None
    if kind == "foot":
        return _foot(item, scale, draw), None
    if kind == "handle":
        return _handle(item, scale, draw), None
    raise ValueError(f"no kind of hold {kind!r}; there are {', '.join(KIND_MEANING)}")
