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

from hadr.camera import Array
from hadr.hand import FINGERS
from hadr.synthesis.glass.shape import GlassObject

#: What a finger does: lie on the glass along its length, touch it with the pad of its tip, do so
#: from inside the mouth, go through the handle, or rest beside its neighbours.
Action = Literal["wrap", "tip", "inside", "hook", "free"]


@dataclass(frozen=True, eq=False)
class Placement:
    """An object in a right hand, before the fingers close.

    Args:
        wrist_from_object: Pose of the object, shape (4, 4).
        plan: What each finger does.
        palm_gap: Distance that the palm keeps from the glass, metres; at 0 the glass is pushed
            onto the palm.
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
    """``wrist_from_object`` (4, 4) whose axis has a direction and passes a point at a height.

    The axis points ``up``, and is at ``point`` at the ``height`` above the object's table; its x
    axis, and a handle, points ``toward``, but for a rotation by ``roll``. Wrist frame, metres,
    radians.
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


#: A number between two bounds.
_Draw = Callable[[float, float], float]


def _power(item: GlassObject, kind: str, s: float, draw: _Draw) -> Array:
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
    elif kind == "fist":
        low, high = item.stem or item.grip
    height = (low + high) / 2 + max((high - low) / 2 - 0.032, 0.004) * draw(-1, 1)
    radius = item.outer_radius(height)
    y = 0.088 - 0.40 * min(radius, 0.045) + draw(-0.006, 0.024)
    point = np.array([-0.004 + draw(-0.004, 0.004), y, 0.10]) * s
    # A handle stands away from the palm, toward the fingers' tips or the thumb's.
    return pose_from_axis(up, point, height, (0, 0.4 * draw(-1, 1), 1), draw(-0.2, 0.2))


def _tips(item: GlassObject, kind: str, s: float, draw: _Draw) -> Array:
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
    return pose_from_axis(up, point, height, (0, 0.3, 1), draw(-0.4, 0.4))


def _around(item: GlassObject, kind: str, s: float, draw: _Draw) -> Array:
    """Finger tips around the mouth from above, or around the base from below."""
    bend = np.deg2rad(draw(35, 75))
    away = _unit([draw(0.0, 0.35), np.cos(bend), np.sin(bend)])
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
    return pose_from_axis(up, point, height, (1, 0, 0.4), draw(-0.8, 0.8))


def _cradle(item: GlassObject, kind: str, s: float, draw: _Draw) -> Array:
    up = np.array([draw(-0.15, 0.15), draw(-0.30, 0.10), 1.0])
    point = np.array([draw(-0.008, 0.006), draw(0.062, 0.086), 0.08]) * s
    return pose_from_axis(up, point, 0.0, (draw(-1, 1), 1, 0))


#: Of a wall between thumb and fingers: ranges of the hand's slope (degrees), of the place where it
#: pinches (x, y, z, metres), of the sideward part of the way outward, of the depth below the rim.
_PINCHES = {
    # The hand above, its forearm over the mouth or beside it.
    "rim": ((0, 50), (0.010, 0.032), (0.090, 0.115), (0.040, 0.065), (-0.3, 0.1), (0.010, 0.024)),
    "nip": ((25, 80), (0.010, 0.032), (0.090, 0.115), (0.040, 0.065), (-0.3, 0.1), (0.010, 0.024)),
    # The hand above, the object beyond the thumb.
    "lip": ((-25, 35), (0.008, 0.030), (0.085, 0.115), (0.040, 0.068), (-0.1, 0.4), (0.010, 0.024)),
    # The hand beside the wall, the rim in the thumb's web, the palm up.
    "carry": (
        (50, 95), (0.010, 0.030), (0.088, 0.112), (0.022, 0.044), (-0.25, 0.1), (0.014, 0.032)
    ),
}  # fmt: skip


def _rim(item: GlassObject, kind: str, s: float, draw: _Draw) -> Array:
    """The wall between thumb and fingers, near the mouth; one of them is inside."""
    degrees, *place, aside, below = _PINCHES[kind]
    slope = np.deg2rad(draw(*degrees))
    pinch = np.array([draw(*bounds) for bounds in place]) * s
    side = -1.0 if kind == "lip" else 1.0
    out = np.array([draw(*aside), side * np.cos(slope), -side * np.sin(slope)])
    up = np.array([draw(-0.25, 0.25), -np.sin(slope), -np.cos(slope)])
    height = item.height - draw(*below)
    up = _unit(up)
    out = _unit(out - (out @ up) * up)
    radius = item.outer_radius(height) - 0.001
    return pose_from_axis(up, pinch - radius * out, height, -out, draw(-0.3, 0.3))


def _stem(item: GlassObject, kind: str, s: float, draw: _Draw) -> Array:
    low, high = item.stem or item.grip
    height = draw(low + 0.02, high)
    up = np.array([1.0, draw(-0.5, 0.3), draw(-0.4, 0.2)])
    point = np.array([draw(0.020, 0.038), draw(0.090, 0.115), draw(0.045, 0.070)]) * s
    return pose_from_axis(up, point, height, (0, 0, 1), draw(-3, 3))


def _foot(item: GlassObject, kind: str, s: float, draw: _Draw) -> Array:
    tilt = np.deg2rad(draw(45, 80))
    up = _unit([draw(-0.1, 0.5), -np.cos(tilt), np.sin(tilt)])
    pinch = np.array([draw(0.018, 0.034), draw(0.092, 0.112), draw(0.042, 0.062)]) * s
    out = np.array([draw(-0.3, 0.3), np.sin(tilt), np.cos(tilt)])  # from the pinch to the axis
    out = _unit(out - (out @ up) * up)
    height = 0.0015
    point = pinch + out * (item.outer_radius(height) - draw(0.008, 0.014))
    return pose_from_axis(up, point, height, out, draw(-3, 3))


def _handle(item: GlassObject, kind: str, s: float, draw: _Draw) -> Array:
    line = np.asarray(item.handle)
    reach, middle = float(line[:, 0].max()), float(line[:, 1].mean())
    up = _unit([1.0, draw(-0.25, 0.25), draw(-0.25, 0.15)])
    angle = np.deg2rad(draw(10, 75))
    body = np.array([draw(-0.2, 0.2), np.cos(angle), np.sin(angle)])
    body = _unit(body - (body @ up) * up)
    bar = np.array([draw(0.002, 0.016), draw(0.086, 0.112), draw(0.020, 0.048)]) * s
    height = middle + draw(-0.004, 0.006)
    return pose_from_axis(up, bar + reach * body, height, -body, draw(-0.15, 0.15))


@dataclass(frozen=True)
class Kind:
    """A kind of hold: what each finger does, thumb to little, and how far the palm stays away.

    An object's pose is drawn for the object, this kind's name and a hand's scale.
    """

    actions: tuple[Action, ...]
    draw_pose: Callable[[GlassObject, str, float, _Draw], Array]
    palm_gap: float = 0.0


_WRAP: tuple[Action, ...] = ("tip", "wrap", "wrap", "wrap", "wrap")
_TIPS: tuple[Action, ...] = ("tip",) * 5
_TWO_TIPS: tuple[Action, ...] = ("tip", "tip", "tip", "free", "free")

#: The kinds of hold by their names.
KINDS: dict[str, Kind] = {
    # Power hold: the palm and all fingers around the body, the thumb toward the mouth.
    "side": Kind(_WRAP, _power),
    "low": Kind(_WRAP, _power),  # the same close to the base of a tall object
    "oblique": Kind(_WRAP, _power),  # with the object leaning across the palm
    "reverse": Kind(_WRAP, _power),  # with the thumb toward the base, as a glass is put upside down
    "neck": Kind(_WRAP, _power),  # around the neck
    "fist": Kind(_WRAP, _power),  # all fingers around the stem
    "cradle": Kind(_WRAP, _cradle),  # the base on the palm, fingers and thumb up along the wall
    # Precision hold: thumb and four finger tips on the wall, the palm away from it.
    "tips": Kind(_TIPS, _tips, 0.012),
    "pinch": Kind(_TWO_TIPS, _tips, 0.012),  # with thumb, index and middle finger only
    "above": Kind(_TIPS, _around, 0.008),  # around the mouth, the palm above it
    "below": Kind(_TIPS, _around, 0.008),  # around the base, the palm below it
    # The wall between the thumb inside the mouth and the fingers outside, all or two of them.
    "rim": Kind(("inside", "tip", "tip", "tip", "tip"), _rim, 0.006),
    "nip": Kind(("inside", "tip", "tip", "free", "free"), _rim, 0.006),
    # The wall between the fingers inside the mouth and the thumb outside.
    "lip": Kind(("tip", "inside", "inside", "inside", "inside"), _rim, 0.006),
    # The thumb over the rim into the mouth, the fingers under the wall.
    "carry": Kind(("inside", "tip", "tip", "tip", "tip"), _rim, 0.006),
    "stem": Kind(_TWO_TIPS, _stem, 0.010),  # the stem between thumb, index and middle finger
    "foot": Kind(_TWO_TIPS, _foot, 0.010),  # the foot between the thumb on top and fingers below
    # Two fingers through the handle, the thumb on top of it.
    "handle": Kind(("tip", "hook", "hook", "free", "free"), _handle, 0.002),
}


def finger_plan(kind: str) -> dict[str, Action]:
    """What each finger does in a kind of hold."""
    return dict(zip(FINGERS, KINDS[kind].actions, strict=True))


def fingers_inside(kind: str) -> tuple[str, ...]:
    """Fingers that a kind of hold puts into the mouth; none where the kind is not ours."""
    plan = finger_plan(kind) if kind in KINDS else {}
    return tuple(finger for finger, action in plan.items() if action == "inside")


def draw_placement(
    item: GlassObject, kind: str, scale: float, rng: np.random.Generator
) -> Placement:
    """Put the object into a hand of a size as a kind of hold wants it, with some freedom."""
    if kind not in KINDS:
        raise ValueError(f"no kind of hold {kind!r}; there are {', '.join(KINDS)}")
    known = KINDS[kind]
    pose = known.draw_pose(item, kind, scale, lambda low, high: float(rng.uniform(low, high)))
    return Placement(pose, finger_plan(kind), known.palm_gap)
