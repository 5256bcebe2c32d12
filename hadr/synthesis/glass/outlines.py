"""Outlines of lines and arcs: a path with corners, each corner rounded by a circle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

#: Corner points (r, z) or (r, z, radius), metres; without a radius a corner is as round as fits.
Corners = tuple[tuple[float, ...], ...]
#: Largest change of direction between two samples on an arc, radians.
_TURN = np.deg2rad(11.0)


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
