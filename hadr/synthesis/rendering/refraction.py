"""Rays that cross glass: bent by Snell's law, split by Fresnel's equations, dimmed inside.

`hadr.synthesis.rendering.raycast` finds the first surface along a ray; here a ray goes on through
glass, and what passes and what is mirrored is followed to where it ends on something opaque.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from hadr.camera import Array
from hadr.synthesis.glass.surfaces import dots
from hadr.synthesis.rendering.raycast import GLASS, Hits, RayCaster, Rows, unit

Table = TypeVar("Table", bound=Rows)

#: Refractive index of the glass.
GLASS_INDEX = 1.50
_NUDGE = 2e-6
#: Most interfaces that a ray of a picture crosses.
BOUNCES = 10
#: Rays that carry less of their light than this are not followed to all of their ends.
FAINTEST = 0.015


def refract(direction: Array, normal: Array, ratio: Array) -> tuple[Array, Array]:
    """Bend unit directions at an interface by Snell's law.

    Args:
        direction: Unit directions of travel, shape (N, 3).
        normal: Unit normals against the direction of travel, shape (N, 3).
        ratio: Refractive index before the interface over that behind it, shape (N,).

    Returns:
        Bent unit directions (N, 3), not meaningful where all light is reflected, and the
        reflectance (N,): unpolarised Fresnel, 1 at total internal reflection.
    """
    cos_in = np.clip(-dots(direction, normal), 0.0, 1.0)
    sin2_out = ratio**2 * (1.0 - cos_in**2)
    total = sin2_out >= 1.0
    cos_out = np.sqrt(np.maximum(1.0 - sin2_out, 0.0))
    bent = ratio[:, None] * direction + (ratio * cos_in - cos_out)[:, None] * normal
    bent = unit(bent)
    across = (ratio * cos_in - cos_out) / np.maximum(ratio * cos_in + cos_out, 1e-12)
    along = (cos_in - ratio * cos_out) / np.maximum(cos_in + ratio * cos_out, 1e-12)
    return bent, np.where(total, 1.0, 0.5 * (across**2 + along**2))


def reflect(direction: Array, normal: Array) -> Array:
    """Mirror unit directions (N, 3) at unit normals (N, 3)."""
    return np.asarray(direction - 2.0 * dots(direction, normal)[:, None] * normal)


@dataclass(frozen=True)
class Beams(Rows):
    """Rays on their way.

    Args:
        origin: World frame, metres, shape (N, 3).
        direction: Unit directions of travel, shape (N, 3).
        weight: What is left of each colour, shape (N, 3), or of a single one, (N, 1).
        travelled: Length of the way so far, metres, shape (N,).
        inside: How many glass bodies the origin is in, shape (N,).
        row: Which ray of the first ones it is, shape (N,).
    """

    origin: Array
    direction: Array
    weight: Array
    travelled: Array
    inside: npt.NDArray[np.int64]
    row: npt.NDArray[np.int64]

    @classmethod
    def start(cls, origins: Array, directions: Array, colors: int = 3) -> Beams:
        """Rays outside of all glass."""
        n = len(origins)
        nowhere = np.zeros(n, dtype=np.int64)
        o, d = np.array(origins, dtype=float), np.array(directions, dtype=float)
        return cls(o, d, np.ones((n, colors)), np.zeros(n), nowhere, np.arange(n))


def cross(caster: RayCaster, beams: Beams, hits: Hits) -> tuple[Beams, Beams]:
    """Carry rays over the interface where they hit glass; overlapping bodies count as one.

    Returns:
        The rays behind the interface, or before it where all light is reflected; and those that
        are mirrored otherwise, of weight 0 where all light is.
    """
    d = beams.direction
    smooth, flat = caster.normals(hits)
    entering = dots(flat, d) < 0
    sign = np.where(entering, 1.0, -1.0)[:, None]
    against, flat = smooth * sign, flat * sign
    # Where a smooth normal points away from the eye, only the flat one makes sense.
    wrong = dots(against, d) > -1e-3
    against = np.where(wrong[:, None], flat, against)
    length, weight, inside = hits.distance, beams.weight, beams.inside
    absorbed = np.log(np.asarray(caster.contents.transmittance)) * 100.0  # per metre
    dimmed = weight * np.exp(absorbed * length[:, None])
    weight = np.where((inside > 0)[:, None], dimmed, weight)
    point = beams.origin + length[:, None] * d
    after = inside + np.where(entering, 1, -1)
    # Between two overlapping bodies there is glass on both sides: nothing happens.
    border = np.minimum(np.maximum(inside, 0), np.maximum(after, 0)) == 0
    ratio = np.where(entering, 1.0 / GLASS_INDEX, GLASS_INDEX)
    bent, mirrored = refract(d, against, ratio)
    total = border & (mirrored >= 1.0)
    bounced = reflect(d, against)
    out = np.where(border[:, None], bent, d)
    out = np.where(total[:, None], bounced, out)
    reflectance = np.where(border & ~total, mirrored, 0.0)[:, None]
    travelled = beams.travelled + length
    off = _NUDGE * flat
    passed = np.where(total, inside, np.maximum(after, 0))
    start = np.where(total[:, None], point + off, point - off)
    return (
        Beams(start, out, weight * (1.0 - reflectance), travelled, passed, beams.row),
        Beams(point + off, bounced, weight * reflectance, travelled, inside, beams.row),
    )


def ray_path(caster: RayCaster, origin: Array, direction: Array) -> Array:
    """Follow one ray, world frame, metres, through the glass, always along its stronger part.

    The points at which it starts, crosses interfaces and ends, shape (K, 3). A ray that leaves the
    scene ends 0.1 m behind its last interface.
    """
    beam = Beams.start(np.asarray(origin)[None], np.asarray(direction)[None])
    points = [beam.origin[0]]
    for _ in range(BOUNCES):
        hits = caster.first(beam.origin, beam.direction)
        end = hits.distance[0] if np.isfinite(hits.distance[0]) else 0.1
        points.append(beam.origin[0] + end * beam.direction[0])
        if caster.kind(hits.mesh)[0] != GLASS:
            break
        beam, _ = cross(caster, beam, hits)
    return np.stack(points)


@dataclass(frozen=True)
class Ends(Rows):
    """Where rays end, on opaque surfaces or nowhere; a ray that glass splits has several ends.

    Beams on their last piece, M of them, what that hits, and how many glass surfaces were crossed.
    """

    beams: Beams
    hits: Hits
    crossed: npt.NDArray[np.int64]

    @property
    def point(self) -> Array:
        """World frame, metres, shape (M, 3); a kilometre away where nothing is met."""
        length = np.minimum(self.hits.distance, 1e3)
        return np.asarray(self.beams.origin + length[:, None] * self.beams.direction)


def follow(
    caster: RayCaster, origins: Array, directions: Array, *, surfaces: int = 9
) -> tuple[Ends, Beams]:
    """Follow rays through glass, so many surfaces of it at most, to all of their ends.

    Rays start at ``origins`` in unit ``directions``, world frame, metres, each (N, 3).

    Returns:
        The ends, in no order of the rays, and what the first glass surfaces on the way mirror.
    """
    beams = Beams.start(origins, directions, len(caster.contents.transmittance))
    ends: list[Ends] = []
    mirrored = beams.take(slice(0))
    for crossed in range(surfaces + 1):
        hits = caster.first(beams.origin, beams.direction)
        clear = caster.kind(hits.mesh) == GLASS
        k = np.flatnonzero(~clear)
        ends.append(Ends(beams, hits, np.full(len(clear), crossed)).take(k))
        k = np.flatnonzero(clear)
        if crossed == surfaces or not len(k):
            break
        both = cross(caster, beams.take(k), hits.take(k))
        if crossed == 0:
            mirrored = both[1]
        beams = _joined([b.take(np.flatnonzero(b.weight.max(1) > FAINTEST)) for b in both])
    return _joined(ends), mirrored


def _joined(tables: Sequence[Table]) -> Table:
    """The rows of several tables, one below the other."""
    columns = zip(*(vars(table).values() for table in tables), strict=True)
    kind = type(tables[0])
    return kind(*(_joined(c) if isinstance(c[0], Rows) else np.concatenate(c) for c in columns))
