"""Paths of light through a scene with glass: split by Fresnel's equations, bent by Snell's law.

`hadr.synthesis.rendering.raycast` finds the first surface along a ray; here a ray goes on through
glass, and both what passes and what is mirrored is followed to where it ends on something opaque.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from hadr.synthesis.rendering.optics import GLASS_INDEX, reflect, refract
from hadr.synthesis.rendering.raycast import GLASS, SURROUNDINGS, Hits, RayCaster

Array = npt.NDArray[np.float64]
Index = npt.NDArray[np.int64]

_NUDGE = 2e-6
#: Parts of a ray that carry less of its light than this are not followed.
FAINTEST = 0.015
#: How far away the end of a ray is that meets nothing, metres.
_FAR = 1e3


@dataclass(frozen=True)
class Ends:
    """Where rays end on opaque surfaces; a ray that glass splits has several ends.

    Args:
        row: Number of the ray, shape (M,).
        weight: Share of its light, shape (M,).
        point: World frame, metres, shape (M, 3).
        mesh: Which mesh, shape (M,); -1 where nothing was met.
        face: Which triangle, shape (M,).
        u: First barycentric coordinate, shape (M,).
        v: Second one, shape (M,).
        toward: Direction of travel, shape (M, 3).
        length: Length of the path, metres, shape (M,).
        glass: Number of glass surfaces met on the way, shape (M,).
    """

    row: Index
    weight: Array
    point: Array
    mesh: Index
    face: Index
    u: Array
    v: Array
    toward: Array
    length: Array
    glass: Index

    def take(self, rows: Any) -> Ends:
        """Some of the ends."""
        return Ends(*(getattr(self, part.name)[rows] for part in fields(self)))


@dataclass(frozen=True)
class Mirrors:
    """Where rays meet their first glass surface.

    Args:
        row: Number of the ray, shape (M,).
        share: Share of its light that is mirrored, shape (M,).
        point: World frame, metres, shape (M, 3).
        toward: Direction after the mirror, shape (M, 3).
    """

    row: Index
    share: Array
    point: Array
    toward: Array


class GlassPaths:
    """A scene's surfaces, ready to be met by light.

    Args:
        rays: The surfaces; glass bodies must not overlap.
    """

    def __init__(self, rays: RayCaster) -> None:
        self.meshes = list(rays.meshes)
        self._kinds = np.array([kind for kind, _ in self.meshes] + [-1])
        self._tree = EmbreeScene()
        for _, surface in self.meshes:
            TriangleMesh(
                self._tree, surface.vertices.astype(np.float32), surface.faces.astype(np.int32)
            )

    @property
    def has_glass(self) -> bool:
        """Whether there is any glass."""
        return bool((self._kinds == GLASS).any())

    def kind(self, mesh: Index) -> Index:
        """What a mesh number stands for: HAND, GLASS or SURROUNDINGS; -1 for nothing."""
        return np.asarray(self._kinds[mesh])

    def first(self, origins: Array, directions: Array) -> Hits:
        """The first surface along each ray.

        Args:
            origins: World frame, metres, shape (N, 3).
            directions: Unit directions, shape (N, 3).
        """
        n = len(origins)
        if n == 0 or not self.meshes:
            none = np.full(n, -1, dtype=np.int64)
            return Hits(np.full(n, np.inf), none, none.copy(), np.zeros(n), np.zeros(n))
        found = self._tree.run(
            np.ascontiguousarray(origins, dtype=np.float32),
            np.ascontiguousarray(directions, dtype=np.float32),
            query="INTERSECT",
            output=True,
        )
        met = found["primID"] >= 0
        return Hits(
            np.where(met, found["tfar"], np.inf),
            np.where(met, found["geomID"], -1).astype(np.int64),
            found["primID"].astype(np.int64),
            found["u"].astype(float),
            found["v"].astype(float),
        )

    def normal(self, mesh: Index, face: Index, u: Array, v: Array) -> tuple[Array, Array]:
        """Smooth and flat unit normals, outward, each (N, 3); surroundings have flat ones only."""
        smooth, flat = np.zeros((len(mesh), 3)), np.zeros((len(mesh), 3))
        for number, (kind, surface) in enumerate(self.meshes):
            rows = np.flatnonzero(mesh == number)
            if not len(rows):
                continue
            corners = surface.faces[face[rows]]
            a, b, c = (surface.vertices[corners[:, i]] for i in range(3))
            cross = np.cross(b - a, c - a)
            flat[rows] = cross / np.maximum(np.linalg.norm(cross, axis=1, keepdims=True), 1e-20)
            if kind == SURROUNDINGS:
                smooth[rows] = flat[rows]
                continue
            n, s, t = surface.normals, u[rows, None], v[rows, None]
            mixed = (1 - s - t) * n[corners[:, 0]] + s * n[corners[:, 1]] + t * n[corners[:, 2]]
            length = np.linalg.norm(mixed, axis=1, keepdims=True)
            smooth[rows] = mixed / np.maximum(length, 1e-12)
        return smooth, flat

    def follow(
        self, origins: Array, directions: Array, *, surfaces: int = 9
    ) -> tuple[Ends, Mirrors]:
        """Follow rays through glass to where they end.

        Args:
            origins: World frame, metres, shape (N, 3).
            directions: Unit directions of travel, shape (N, 3).
            surfaces: Most glass surfaces on a path.

        Returns:
            The ends, in no order of the rays, and the first mirrors on the way.
        """
        n = len(origins)
        o, d = np.asarray(origins, dtype=float), np.asarray(directions, dtype=float)
        weight, row, length = np.ones(n), np.arange(n), np.zeros(n)
        ends: list[Ends] = []
        mirrors = Mirrors(np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
        for step in range(surfaces + 1):
            hits = self.first(o, d)
            point = o + np.minimum(hits.distance, _FAR)[:, None] * d
            length = length + np.minimum(hits.distance, _FAR)
            clear = self.kind(hits.mesh) == GLASS
            k = np.flatnonzero(~clear)
            place = (hits.mesh[k], hits.face[k], hits.u[k], hits.v[k])
            glass = np.full(len(k), step)
            ends.append(Ends(row[k], weight[k], point[k], *place, d[k], length[k], glass))
            k = np.flatnonzero(clear)
            if step == surfaces or not len(k):
                break
            o, d, weight, row, length = point[k], d[k], weight[k], row[k], length[k]
            smooth, flat = self.normal(hits.mesh[k], hits.face[k], hits.u[k], hits.v[k])
            entering = (flat * d).sum(1) < 0
            sign = np.where(entering, 1.0, -1.0)[:, None]
            against, flat = smooth * sign, flat * sign
            # Where a smooth normal turns away from the ray, only the flat one makes sense.
            wrong = (against * d).sum(1) > -1e-3
            against = np.where(wrong[:, None], flat, against)
            ratio = np.where(entering, 1.0 / GLASS_INDEX, GLASS_INDEX)
            bent, share = refract(d, against, ratio)
            mirrored = reflect(d, against)
            if step == 0:
                mirrors = Mirrors(row, share, o, mirrored)
            passed, bounced = weight * (1.0 - share), weight * share
            go, back = np.flatnonzero(passed > FAINTEST), np.flatnonzero(bounced > FAINTEST)
            o = np.concatenate([o[go] - _NUDGE * flat[go], o[back] + _NUDGE * flat[back]])
            d = np.concatenate([bent[go], mirrored[back]])
            weight = np.concatenate([passed[go], bounced[back]])
            row = np.concatenate([row[go], row[back]])
            length = np.concatenate([length[go], length[back]])
        joined = (np.concatenate([getattr(e, part.name) for e in ends]) for part in fields(Ends))
        return Ends(*joined), mirrors
