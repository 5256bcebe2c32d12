"""Rays that cross glass: bent and split at each interface, dimmed inside."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from hadr.synthesis.rendering.optics import GLASS_INDEX, reflect, refract
from hadr.synthesis.rendering.raycast import GLASS, Hits, RayCaster

Array = npt.NDArray[np.float64]

_NUDGE = 2e-6


@dataclass(frozen=True)
class Beams:
    """Rays on their way.

    Args:
        origin: World frame, metres, shape (N, 3).
        direction: Unit directions of travel, shape (N, 3).
        weight: Of red, green and blue, what is left, shape (N, 3).
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
    def start(cls, origins: Array, directions: Array) -> Beams:
        """Rays outside of all glass."""
        n = len(origins)
        nowhere = np.zeros(n, dtype=np.int64)
        o, d = np.array(origins, dtype=float), np.array(directions, dtype=float)
        return cls(o, d, np.ones((n, 3)), np.zeros(n), nowhere, np.arange(n))

    def take(self, rows: Any) -> Beams:
        """Some of them."""
        return Beams(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


def cross(caster: RayCaster, beams: Beams, hits: Hits) -> tuple[Beams, Beams]:
    """Carry rays that meet glass over the interface.

    Args:
        caster: The surfaces; overlapping glass bodies count as one.
        beams: The rays.
        hits: Where each meets the glass.

    Returns:
        The rays behind the interface, or before it where all light is reflected; and those that
        are mirrored otherwise, of weight 0 where all light is.
    """
    d = beams.direction
    smooth, flat = caster.normals(hits)
    entering = (flat * d).sum(1) < 0
    sign = np.where(entering, 1.0, -1.0)[:, None]
    against, flat = smooth * sign, flat * sign
    # Where a smooth normal points away from the eye, only the flat one makes sense.
    wrong = (against * d).sum(1) > -1e-3
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
    share = np.where(border & ~total, mirrored, 0.0)[:, None]
    travelled = beams.travelled + length
    off = _NUDGE * flat
    passed = np.where(total, inside, np.maximum(after, 0))
    start = np.where(total[:, None], point + off, point - off)
    return (
        Beams(start, out, weight * (1.0 - share), travelled, passed, beams.row),
        Beams(point + off, bounced, weight * share, travelled, inside, beams.row),
    )


def ray_path(caster: RayCaster, origin: Array, direction: Array, *, bounces: int = 10) -> Array:
    """Follow one ray through the glass, always along its stronger part.

    Args:
        caster: The surfaces.
        origin: World frame, metres, shape (3,).
        direction: Unit direction, shape (3,).
        bounces: Most interfaces to follow.

    Returns:
        The points at which it starts, crosses interfaces and ends, shape (K, 3). A ray that
        leaves the scene ends 0.1 m behind its last interface.
    """
    beam = Beams.start(np.asarray(origin)[None], np.asarray(direction)[None])
    points = [beam.origin[0]]
    for _ in range(bounces):
        hits = caster.first(beam.origin, beam.direction)
        end = hits.distance[0] if np.isfinite(hits.distance[0]) else 0.1
        points.append(beam.origin[0] + end * beam.direction[0])
        if caster.kind(hits.mesh)[0] != GLASS:
            break
        beam, _ = cross(caster, beam, hits)
    return np.stack(points)
