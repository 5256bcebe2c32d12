"""The object as physics sees it: mass and inertia of its glass wall, convex parts of its outside.

Fingers touch only the outside, so the parts are solid: the outline is cut into as few stacked
pieces as follow it within a millimetre, each of them convex; a handle is a chain of capsules. The
reliefs (facets, thread, spout) move no part: they are about as fine as that.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import trimesh

from hadr.camera import Array
from hadr.records.caches import kept
from hadr.synthesis.glass.objects import bodies
from hadr.synthesis.glass.shape import GlassObject, handle_sections, profile

GLASS_DENSITY = 2500.0
"""Kilograms per cubic metre of soda-lime glass."""
PLAUSIBLE_MASSES: tuple[float, float] = (0.05, 0.6)
"""A glass lighter or heavier than this, in kilograms, is taken to be at the bound."""
TOLERANCE = 0.001
"""Largest distance between the outline and its convex parts, metres."""
SIDES = 32
"""Corners of a part's cross-section."""


class MassProperties(NamedTuple):
    """Mass in kilograms, centre (3,) in metres, inertia (3, 3) in kg m2 about it; object frame."""

    mass: float
    center: Array
    inertia: Array


@kept(32)
def mass_properties(item: GlassObject) -> MassProperties:
    """Mass and inertia of the closed glass wall, hollow inside."""
    solids = [trimesh.Trimesh(b.vertices, b.faces, process=False) for b in bodies(item)]
    wall = trimesh.util.concatenate(solids)
    wall.density = GLASS_DENSITY
    mass = float(np.clip(wall.mass, *PLAUSIBLE_MASSES))
    inertia = np.asarray(wall.moment_inertia) * (mass / wall.mass)
    return MassProperties(mass, np.asarray(wall.center_mass), inertia)


def outside(item: GlassObject) -> Array:
    """The outline's outer half from foot to rim, heights never falling: (r, z), shape (n, 2)."""
    curve = profile(item)
    outer = curve[: int(np.argmax(curve[:, 1])) + 1]
    lowest = int(np.flatnonzero(outer[:, 1] <= outer[:, 1].min() + 1e-9)[-1])
    outer = outer[lowest:]
    z = np.unique(np.concatenate([outer[:, 1], np.linspace(0, outer[-1, 1], 200)]))
    return np.array([[item.outer_radius(float(h)), h] for h in z])


def distance_outside(item: GlassObject, point: Array) -> float:
    """How far a point (3,), object frame, is from body and handle, metres; 0 within their outline.

    The body's hollow counts as within it.
    """
    curve, r, z = outside(item), float(np.hypot(*point[:2])), float(point[2])
    foot = np.c_[np.linspace(0, curve[0, 0], 20), np.full(20, curve[0, 1])]
    away = float(np.linalg.norm(np.concatenate([foot, curve]) - [r, z], axis=1).min())
    if curve[0, 1] <= z <= curve[-1, 1] and r <= np.interp(z, curve[:, 1], curve[:, 0]):
        return 0.0
    line, thickness, _ = handle_sections(item)
    if len(line):
        away = min(away, float((np.linalg.norm(line - point, axis=1) - thickness).min()))
    return max(0.0, away)


def _upper_hull(points: Array) -> list[int]:
    """Indices of the corners of the smallest concave curve over points (z rising, r)."""
    hull: list[int] = []
    for index, (r, z) in enumerate(points):
        while len(hull) >= 2:
            (r1, z1), (r2, z2) = points[hull[-2]], points[hull[-1]]
            if (r2 - r1) * (z - z1) <= (r - r1) * (z2 - z1) + 1e-15:
                hull.pop()
            else:
                break
        hull.append(index)
    return hull


def _thinned(points: Array, tolerance: float) -> Array:
    """Leave out corners of a concave curve (r, z) as long as it stays within the tolerance."""
    kept = [0]
    while kept[-1] < len(points) - 1:
        start = kept[-1]
        end = start + 1
        while end + 1 < len(points):
            a, b = points[start], points[end + 1]
            between = points[start + 1 : end + 1]
            line = np.interp(between[:, 1], [a[1], b[1]], [a[0], b[0]])
            if np.abs(line - between[:, 0]).max() > tolerance:
                break
            end += 1
        kept.append(end)
    return points[kept]


@kept(32)
def stacked_rings(item: GlassObject) -> tuple[Array, ...]:
    """Cut the outside into concave curves (r, z), each (m, 2) in metres, from foot to rim."""
    curve = outside(item)
    pieces: list[Array] = []
    start = 0
    while start < len(curve) - 1:
        end = start + 1
        best = curve[start : end + 1]
        while end < len(curve) - 1:
            part = curve[start : end + 2]
            hull = part[_upper_hull(part)]
            over = np.interp(part[:, 1], hull[:, 1], hull[:, 0]) - part[:, 0]
            if over.max() > TOLERANCE / 2:
                break
            end, best = end + 1, hull
        pieces.append(_thinned(best, TOLERANCE / 2))
        start = end
    return tuple(pieces)


def convex_parts(item: GlassObject) -> tuple[Array, ...]:
    """Corners (n, 3) of each convex part of the body, metres, object frame; not the handle."""
    angle = 2 * np.pi * np.arange(SIDES) / SIDES
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    grown = 2 / (1 + np.cos(np.pi / SIDES))  # the polygon lies as much outside as inside
    parts = []
    for rings in stacked_rings(item):
        corners = [np.c_[circle * max(r, 1e-3) * grown, np.full(SIDES, z)] for r, z in rings]
        parts.append(np.concatenate(corners))
    return tuple(parts)


def handle_capsules(item: GlassObject) -> list[tuple[Array, Array, float]]:
    """The handle as nine capsules, none without one: start, end (3,), radius; metres, own frame."""
    line, thickness, _ = handle_sections(item)
    if not len(line):
        return []
    radius = float(np.median(thickness))
    knots = line[np.linspace(0, len(line) - 1, 10).round().astype(int)]
    return [(start, end, radius) for start, end in pairwise(knots)]
