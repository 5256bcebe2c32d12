"""Rays that cross glass: bent and split at each interface, dimmed inside."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from hadr.synthesis.glass.surfaces import Surface
from hadr.synthesis.hand.mesh import HandMesh
from hadr.synthesis.rendering.optics import GLASS_INDEX, reflect, refract
from hadr.synthesis.rendering.raycast import GLASS, Hits, RayCaster, Surroundings

Array = npt.NDArray[np.float64]

_NUDGE = 2e-6


@dataclass(frozen=True)
class Beams:
    """Rays on their way.

    Args:
        origin: World frame, metres, shape (N, 3).
        direction: Unit directions of travel, shape (N, 3).
        weight: Share of red, green, blue that is left, shape (N, 3).
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


@dataclass(frozen=True)
class Mirrored:
    """What an interface mirrors of rays that go on through it.

    Args:
        origin: Just off the interface, shape (N, 3).
        direction: Unit directions of travel, shape (N, 3).
        share: Share of the light, 0 where all of it is reflected, shape (N,).
        weight: Share of red, green, blue that was left before, shape (N, 3).
        travelled: Length of the way so far, metres, shape (N,).
    """

    origin: Array
    direction: Array
    share: Array
    weight: Array
    travelled: Array


class GlassRays(RayCaster):
    """Surfaces whose glass bends rays.

    Args:
        hand: The skinned hand, world frame, or None.
        glass: The closed glass bodies, world frame; overlapping ones count as one.
        tint: Share of red, green, blue that a centimetre of glass lets through.
        surroundings: Everything else, or None.
    """

    def __init__(
        self,
        hand: HandMesh | None,
        glass: tuple[Surface, ...],
        tint: tuple[float, float, float] = (0.95, 0.975, 0.965),
        surroundings: Surroundings | None = None,
    ) -> None:
        super().__init__(hand, glass, surroundings)
        self.tint = np.log(np.asarray(tint)) * 100.0  # per metre

    def cross(self, beams: Beams, hits: Hits) -> tuple[Beams, Mirrored]:
        """Carry rays that meet glass over the interface.

        Args:
            beams: The rays.
            hits: Where each meets the glass.

        Returns:
            The rays behind the interface, or before it where all light is reflected, and what
            is mirrored otherwise.
        """
        d = beams.direction
        smooth, flat = np.zeros_like(d), np.zeros_like(d)
        for number in range(len(self._opaque), len(self.meshes)):
            rows = np.flatnonzero(hits.mesh == number)
            if len(rows):
                smooth[rows], flat[rows] = self._normal(self.meshes[number][1], hits, rows)
        entering = (flat * d).sum(1) < 0
        sign = np.where(entering, 1.0, -1.0)[:, None]
        against, flat_against = smooth * sign, flat * sign
        wrong = (against * d).sum(1) > -1e-3
        against = np.where(wrong[:, None], flat_against, against)
        length, weight, inside = hits.distance, beams.weight, beams.inside
        dimmed = weight * np.exp(self.tint * length[:, None])
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
        share = np.where(border & ~total, mirrored, 0.0)
        travelled = beams.travelled + length
        back = Mirrored(point + _NUDGE * flat_against, bounced, share, weight, travelled)
        onward = np.where(total[:, None], flat_against, -flat_against)
        ahead = Beams(
            point + _NUDGE * onward,
            out,
            weight * (1.0 - share)[:, None],
            travelled,
            np.where(total, inside, np.maximum(after, 0)),
            beams.row,
        )
        return ahead, back

    def path(self, origin: Array, direction: Array, *, bounces: int = 10) -> Array:
        """Follow one ray through the glass, always along its stronger part.

        Args:
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
            hits = self._trace(self._all, beam.origin, beam.direction)
            end = hits.distance[0] if np.isfinite(hits.distance[0]) else 0.1
            points.append(beam.origin[0] + end * beam.direction[0])
            if self._kinds[hits.mesh[0]] != GLASS:
                break
            beam, _ = self.cross(beam, hits)
        return np.stack(points)
