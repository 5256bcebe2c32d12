"""The shape of a transparent object: an outline of lines and arcs revolved, its relief, its handle.

An object stands in its own frame: metres, the axis of revolution is z, the table z = 0, the
mouth up. Its outline is one closed curve in the half plane (r, z): from the axis up along the
outside, over the rounded rim, down along the inside and back to the axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hadr.camera import Array
from hadr.records.caches import kept
from hadr.synthesis.glass.relief import Relief
from hadr.synthesis.glass.surfaces import lengths_along, smooth_curve

#: Corner points (r, z) or (r, z, radius), metres; without a radius a corner is as round as fits.
Corners = tuple[tuple[float, ...], ...]
#: Largest change of direction between two samples on an arc, radians.
_TURN = np.deg2rad(11.0)
#: Largest distance of the outline's samples, metres.
SPACING = 0.003


@dataclass(frozen=True)
class GlassObject:
    """One transparent object.

    Args:
        object_id: Its four digits, as the data set's folders are named.
        name: What it is.
        holds: Its eight kinds of hold, see `hadr.synthesis.holding.kinds`; hold number ``n`` is of
            kind ``n % 8``.
        outer: Corners (r, z) or (r, z, rounding) of the outside from the axis to the rim, metres;
            without a rounding a corner is as round as fits.
        inner: The same of the inside, from the rim to the axis.
        grip: Heights (z) between which fingers may close on it, metres.
        stem: Heights of the stem, metres, for a thing that has one.
        handle: Control points (r, z) of the handle's centre line; empty without a handle.
        handle_radius: Half of the handle's thickness, metres, in the plane of its line.
        transmittance: Of a centimetre of the material for red, green and blue light.
        handle_width: Half of the handle's breadth, metres, across that plane.
        reliefs: Facets, thread, spout or marks.
    """

    object_id: str
    name: str
    holds: tuple[str, ...]
    outer: Corners
    inner: Corners
    grip: tuple[float, float]
    stem: tuple[float, float] | None = None
    handle: Corners = ()
    handle_radius: float = 0.0
    transmittance: tuple[float, float, float] = (0.95, 0.975, 0.965)
    handle_width: float = 0.0
    reliefs: tuple[Relief, ...] = ()

    @property
    def height(self) -> float:
        """Metres from the table to the rim."""
        return float(profile(self)[:, 1].max())

    def outer_radius(self, z: float) -> float:
        """Largest radius of the outline at the height z, metres; 0 above and below it."""
        return float(_largest_radius(profile(self), np.array([z]))[0])


def _corner(before: Array, at: Array, after: Array, radius: float | None) -> Array:
    """Samples of the arc that rounds one corner, shape (N, 2)."""
    a, b = before - at, after - at
    reach_a, reach_b = float(np.linalg.norm(a)), float(np.linalg.norm(b))
    a, b = a / reach_a, b / reach_b
    half = np.arccos(np.clip(-(a @ b), -1.0, 1.0)) / 2  # half of the change of direction
    if half < 1e-4 or radius == 0.0:
        return at[None]
    tangent = 0.499 * min(reach_a, reach_b)
    if radius is not None:
        tangent = min(tangent, radius * float(np.tan(half)))
    radius = tangent / float(np.tan(half))
    center = at + (a + b) / np.linalg.norm(a + b) * np.hypot(radius, tangent)
    start, end = at + tangent * a - center, at + tangent * b - center
    side = np.sign(start[0] * end[1] - start[1] * end[0])
    count = max(int(np.ceil(2 * half / _TURN)), 2)
    angle = side * np.linspace(0.0, 2 * half, count + 1)
    cos, sin = np.cos(angle), np.sin(angle)
    rotation = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], axis=1)
    return np.asarray(center + rotation @ start)


def rounded_path(corners: Corners, spacing: float) -> Array:
    """Lines between corner points, each inner corner rounded by an arc; samples, shape (N, 2).

    A radius that does not fit is made smaller: an arc takes at most half of the shorter
    neighbouring line. Samples lie at most ``spacing`` metres apart, on arcs every 11 degrees.

    Raises:
        ValueError: There are fewer than two corners, or two neighbours coincide.
    """
    if len(corners) < 2:
        raise ValueError(f"a path needs two corners at least, got {corners!r}")
    points = np.array([corner[:2] for corner in corners], dtype=float)
    gaps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if (gaps < 1e-9).any():
        raise ValueError(f"corner {int(np.argmin(gaps)) + 1} repeats the one before: {corners!r}")
    radii = (corner[2] if len(corner) > 2 else None for corner in corners[1:-1])
    arcs = map(_corner, points[:-2], points[1:-1], points[2:], radii)
    return subdivided(np.concatenate([points[:1], *arcs, points[-1:]]), spacing)


def subdivided(
    path: Array, spacing: float, fine: Sequence[tuple[float, float, float]] = ()
) -> Array:
    """Split the pieces of a path (N, 2) that are longer than ``spacing`` metres.

    ``fine`` names bands (low, high, spacing) of the second coordinate with shorter pieces.
    """
    length = np.linalg.norm(np.diff(path, axis=0), axis=1)
    low, high = np.minimum(path[:-1, 1], path[1:, 1]), np.maximum(path[:-1, 1], path[1:, 1])
    step = np.full(len(length), spacing)
    for bottom, top, fine_step in fine:
        step = np.where((high > bottom) & (low < top), np.minimum(step, fine_step), step)
    pieces = [
        a + (b - a) * np.linspace(0, 1, int(n), endpoint=False)[:, None]
        for a, b, n in zip(path[:-1], path[1:], np.ceil(length / step - 1e-9), strict=True)
    ]
    return np.concatenate([*pieces, path[-1:]])


@kept(64)
def profile(item: GlassObject) -> Array:
    """The closed outline in the half plane, without relief, from the axis below to that inside.

    Points (r, z) in metres, shape (N, 2); the first and the last lie on the axis.
    """
    outer, inner = rounded_path(item.outer, SPACING), rounded_path(item.inner, SPACING)
    middle = (outer[-1] + inner[0]) / 2
    half = float(np.linalg.norm(outer[-1] - inner[0])) / 2
    across = (outer[-1] - middle) / half
    up = np.array([-across[1], across[0]])
    angle = np.linspace(0, np.pi, 13)[1:-1, None]
    rim = middle + half * (np.cos(angle) * across + np.sin(angle) * up)
    bands = [relief.band for relief in item.reliefs]
    sides = [relief.band for relief in item.reliefs if relief.through]
    outer = subdivided(np.concatenate([outer, rim[:1]]), SPACING, bands)[:-1]
    inner = subdivided(np.concatenate([rim[-1:], inner]), SPACING, sides)[1:]
    return np.concatenate([outer, rim, inner])


def handle_sections(item: GlassObject) -> tuple[Array, Array, Array]:
    """The handle: its centre line (N, 3), half thickness (N,) and half width (N,), metres.

    Toward its ends, which lie in the wall, it grows thicker. Without a handle N = 0.
    """
    if not item.handle:
        return np.zeros((0, 3)), np.zeros(0), np.zeros(0)
    rz = smooth_curve(item.handle, 0.002)
    line = np.stack([rz[:, 0], np.zeros(len(rz)), rz[:, 1]], axis=1)
    along = lengths_along(line)
    flare = 0.55 * np.exp(-((np.minimum(along, along[-1] - along) / 0.0042) ** 2))
    thickness = item.handle_radius * (1 + flare)
    return line, thickness, (item.handle_width or item.handle_radius) * (1 + 0.5 * flare)


def _largest_radius(curve: Array, z: Array) -> Array:
    """Largest radius of a part of an outline at each of N heights; 0 where it does not reach."""
    a, b, level = curve[:-1], curve[1:], z[:, None]
    low, high = np.minimum(a[:, 1], b[:, 1]), np.maximum(a[:, 1], b[:, 1])
    rise = np.where(high - low < 1e-12, 1.0, b[:, 1] - a[:, 1])
    at = a[:, 0] + np.clip((level - a[:, 1]) / rise, 0, 1) * (b[:, 0] - a[:, 0])
    return np.asarray(np.where((low <= level) & (high >= level), at, 0.0).max(1))


@kept(32)
def _walls(item: GlassObject) -> tuple[Array, Array, Array]:
    """Heights every 0.5 mm, and the outer and the inner radius there; 0 inside of solid glass."""
    curve = profile(item)
    rim = int(np.argmax(curve[:, 1]))
    z = np.arange(0.0, curve[rim, 1] + 5e-4, 5e-4)
    level = np.minimum(z, curve[rim, 1])
    return z, _largest_radius(curve[: rim + 1], level), _largest_radius(curve[rim:], level)


def relieved(item: GlassObject, angle: Array, rz: Array, *, back: bool = False) -> Array:
    """Move points of the body of revolution to where the reliefs put them, or back: the new radius.

    Points are angles around the axis, radians, shape (...,), and radius with height, metres, shape
    (..., 2). Between the inner and the outer wall the shift fades out: the inside stays round.
    """
    r, z = rz[..., 0], rz[..., 1]
    heights, outside, inside = _walls(item)
    wide, narrow = np.interp(z, heights, outside), np.interp(z, heights, inside)
    sign = -1.0 if back else 1.0
    r = r + sign * sum(f.shift(angle, z, wide) for f in item.reliefs if f.through)
    wall = np.maximum(wide - narrow, 2e-4)
    shift = np.zeros(r.shape) + sum(f.shift(angle, z, wide) for f in item.reliefs if not f.through)
    if back:
        within = (r + shift * narrow / wall) / np.maximum(1.0 + shift / wall, 0.2)
        return np.asarray(np.where(within >= wide, r - shift, np.where(r <= narrow, r, within)))
    return np.asarray(r + shift * np.clip((r - narrow) / wall, 0.0, 1.0))
