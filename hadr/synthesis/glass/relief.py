"""What a glass has beyond a body of revolution: facets, a screw thread, a spout, marks.

A relief moves the surface along its radius, by an amount that depends on the height and on the
angle around the axis.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class Relief(Protocol):
    """A shift of the surface along the radius."""

    through: ClassVar[bool]
    """Whether the inside moves with the outside, so that the wall keeps its thickness."""

    @property
    def band(self) -> tuple[float, float, float]:
        """Where it is and how finely it must be sampled: lowest z, highest z, spacing, metres."""

    def shift(self, angle: Array, z: Array, radius: Array) -> Array:
        """How far the surface moves outward, metres.

        Args:
            angle: Around the axis from +x, radians.
            z: Height above the table, metres.
            radius: Outer radius of the body of revolution at this height, metres.
        """


def _bump(x: Array) -> Array:
    """1 at 0, falling smoothly to 0 at -1 and 1."""
    return np.asarray(np.where(np.abs(x) < 1, np.cos(np.clip(x, -1, 1) * np.pi / 2) ** 2, 0.0))


def _rise(x: Array) -> Array:
    """0 below 0, 1 above 1, smooth between."""
    t = np.clip(x, 0.0, 1.0)
    return np.asarray(t * t * (3 - 2 * t))


@dataclass(frozen=True)
class Facets:
    """Planes ground into the outside.

    Args:
        count: Number of planes around the axis.
        apothem: Distance of the planes from the axis at the table, metres.
        slope: Growth of that distance per metre of height.
        top: Height where the planes end, metres; they fade out over the last fifth.
        rounding: Width over which edges are rounded, metres.
    """

    count: int
    apothem: float
    slope: float
    top: float
    rounding: float = 0.0005

    through: ClassVar = False

    @property
    def band(self) -> tuple[float, float, float]:
        """See `Relief.band`."""
        return (0.0, self.top, 0.0012)

    def shift(self, angle: Array, z: Array, radius: Array) -> Array:
        """See `Relief.shift`."""
        step = 2 * np.pi / self.count
        within = np.mod(angle + step / 2, step) - step / 2
        plane = (self.apothem + self.slope * np.maximum(z, 0.0)) / np.cos(within)
        near = np.maximum(self.rounding - np.abs(plane - radius), 0.0)
        cut = np.minimum(plane - radius, 0.0) - near**2 / (4 * self.rounding)
        return np.asarray(cut * _rise(5.0 * (1.0 - z / self.top)))


@dataclass(frozen=True)
class Thread:
    """A screw thread: a ridge that climbs around the neck.

    Args:
        start: Height where it begins, metres.
        pitch: Climb per lap, metres.
        laps: Around the neck.
        height: How far the ridge stands out, metres.
        half_width: Half of the ridge's width at its foot, metres.
    """

    start: float
    pitch: float
    laps: float
    height: float
    half_width: float

    through: ClassVar = False

    @property
    def band(self) -> tuple[float, float, float]:
        """See `Relief.band`."""
        end = self.start + self.pitch * self.laps
        return (self.start - self.half_width, end + self.half_width, self.half_width / 3)

    def shift(self, angle: Array, z: Array, radius: Array) -> Array:
        """See `Relief.shift`."""
        first = np.mod(angle, 2 * np.pi) / (2 * np.pi)
        total = np.zeros(np.broadcast(angle, z).shape)
        for lap in range(int(np.ceil(self.laps)) + 1):
            at = first + lap
            ends = _rise(at / 0.12) * _rise((self.laps - at) / 0.12)
            total = total + ends * _bump((z - self.start - self.pitch * at) / self.half_width)
        return np.asarray(self.height * total)


@dataclass(frozen=True)
class Spout:
    """A lip drawn outward at angle 0, inside and outside together.

    Args:
        reach: How far the rim is drawn out, metres.
        half_angle: Half of the angle that it takes, radians.
        low: Height where it begins, metres.
        high: Height of the rim, metres.
    """

    reach: float
    half_angle: float
    low: float
    high: float

    through: ClassVar = True

    @property
    def band(self) -> tuple[float, float, float]:
        """See `Relief.band`."""
        return (self.low, self.high + 0.01, 0.0015)

    def shift(self, angle: Array, z: Array, radius: Array) -> Array:
        """See `Relief.shift`."""
        beside = np.mod(angle + np.pi, 2 * np.pi) - np.pi
        rise = np.clip((z - self.low) / (self.high - self.low), 0.0, 1.2) ** 2
        return np.asarray(self.reach * rise * _bump(beside / self.half_angle))


@dataclass(frozen=True)
class Marks:
    """Raised lines of a measuring glass.

    Args:
        heights: Of the lines, metres; every second one is long.
        angle: Where their left end is, radians.
        long: Angle that a long line takes, radians; a short one takes half of it.
        height: How far they stand out, metres.
        half_width: Half of a line's width at its foot, metres.
    """

    heights: tuple[float, ...]
    angle: float
    long: float
    height: float = 0.0004
    half_width: float = 0.0009

    through: ClassVar = False

    @property
    def band(self) -> tuple[float, float, float]:
        """See `Relief.band`."""
        edge = self.half_width
        return (min(self.heights) - edge, max(self.heights) + edge, self.half_width / 2.5)

    def shift(self, angle: Array, z: Array, radius: Array) -> Array:
        """See `Relief.shift`."""
        along = np.mod(angle - self.angle + np.pi, 2 * np.pi) - np.pi
        total = np.zeros(np.broadcast(angle, z).shape)
        for number, height in enumerate(self.heights):
            reach = self.long if number % 2 else self.long / 2
            line = _rise(along / 0.06) * _rise((reach - along) / 0.06)
            total = total + line * _bump((z - height) / self.half_width)
        return np.asarray(self.height * total)
