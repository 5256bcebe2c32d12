"""What a glass has beyond a body of revolution: facets, a screw thread, a spout, marks.

A relief moves the surface along its radius, by an amount that depends on the height and on the
angle around the axis.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hadr.camera import Array

#: Radius over which the edges between facets are rounded, metres.
_ROUNDING = 0.0005
#: How far a mark stands out, and half of its width at the foot, metres.
_MARK_HEIGHT, _MARK_HALF_WIDTH = 0.0004, 0.0009


@dataclass(frozen=True)
class Relief:
    """A shift of the surface along the radius.

    Args:
        band: Where it is and how finely it must be sampled: lowest z, highest z, spacing, metres.
        shift: How far the surface moves outward, metres, from the angle around the axis (from +x,
            radians), the height above the table and the body's outer radius there (metres).
        through: Whether the inside moves with the outside, so that the wall keeps its thickness.
    """

    band: tuple[float, float, float]
    shift: Callable[[Array, Array, Array], Array]
    through: bool = False


def _bump(x: Array) -> Array:
    """1 at 0, falling smoothly to 0 at -1 and 1."""
    return np.asarray(np.where(np.abs(x) < 1, np.cos(np.clip(x, -1, 1) * np.pi / 2) ** 2, 0.0))


def _rise(x: Array) -> Array:
    """0 below 0, 1 above 1, smooth between."""
    t = np.clip(x, 0.0, 1.0)
    return np.asarray(t * t * (3 - 2 * t))


def facets(count: int, apothem: float, slope: float, top: float) -> Relief:
    """So many planes ground into the outside; lengths in metres.

    They stand ``apothem`` from the axis at the table and ``slope`` more per metre of height, and
    fade out over the last fifth of the way to ``top``.
    """

    def shift(angle: Array, z: Array, radius: Array) -> Array:
        step = 2 * np.pi / count
        within = np.mod(angle + step / 2, step) - step / 2
        plane = (apothem + slope * np.maximum(z, 0.0)) / np.cos(within)
        near = np.maximum(_ROUNDING - np.abs(plane - radius), 0.0)
        cut = np.minimum(plane - radius, 0.0) - near**2 / (4 * _ROUNDING)
        return np.asarray(cut * _rise(5.0 * (1.0 - z / top)))

    return Relief((0.0, top, 0.0012), shift)


def thread(start: float, pitch: float, laps: float, height: float, half_width: float) -> Relief:
    """A screw thread: a ridge from a height on that climbs by ``pitch`` per lap, metres.

    It stands out by ``height``; ``half_width`` is at its foot.
    """

    def shift(angle: Array, z: Array, radius: Array) -> Array:
        first = np.mod(angle, 2 * np.pi) / (2 * np.pi)
        total = np.zeros(np.broadcast(angle, z).shape)
        for lap in range(int(np.ceil(laps)) + 1):
            at = first + lap
            ends = _rise(at / 0.12) * _rise((laps - at) / 0.12)
            total = total + ends * _bump((z - start - pitch * at) / half_width)
        return np.asarray(height * total)

    end = start + pitch * laps
    return Relief((start - half_width, end + half_width, half_width / 3), shift)


def spout(reach: float, half_angle: float, low: float, high: float) -> Relief:
    """A lip drawn outward at angle 0, inside and outside together, by ``reach`` at the rim, metres.

    It takes twice the ``half_angle``, radians, and the heights from ``low`` to the rim's, ``high``.
    """

    def shift(angle: Array, z: Array, radius: Array) -> Array:
        beside = np.mod(angle + np.pi, 2 * np.pi) - np.pi
        rise = np.clip((z - low) / (high - low), 0.0, 1.2) ** 2
        return np.asarray(reach * rise * _bump(beside / half_angle))

    return Relief((low, high + 0.01, 0.0015), shift, through=True)


def marks(heights: tuple[float, ...], start: float, long: float) -> Relief:
    """Raised lines of a measuring glass at some heights, metres.

    Each begins at the angle ``start``; every second one takes the angle ``long``, radians, the
    others half of it.
    """

    def shift(angle: Array, z: Array, radius: Array) -> Array:
        along = np.mod(angle - start + np.pi, 2 * np.pi) - np.pi
        total = np.zeros(np.broadcast(angle, z).shape)
        for number, level in enumerate(heights):
            reach = long if number % 2 else long / 2
            line = _rise(along / 0.06) * _rise((reach - along) / 0.06)
            total = total + line * _bump((z - level) / _MARK_HALF_WIDTH)
        return np.asarray(_MARK_HEIGHT * total)

    low, high = min(heights) - _MARK_HALF_WIDTH, max(heights) + _MARK_HALF_WIDTH
    return Relief((low, high, _MARK_HALF_WIDTH / 2.5), shift)
