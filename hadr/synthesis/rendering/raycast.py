"""Ray casting: exact labels at the pixel centres.

The first surface that a pixel's ray meets gives its depth, its mask and its normal.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Self

import numpy as np
import numpy.typing as npt
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from hadr.camera import Array, Intrinsics, pixel_grid, ray_directions
from hadr.synthesis.glass.surfaces import Surface, crosses, dots
from hadr.synthesis.scene.contents import Contents

#: What a ray can meet first.
NOTHING, HAND, GLASS, SURROUNDINGS = 0, 1, 2, 3
#: A rotation of a ray by a millionth of a radian.
_HAIR = np.array([6.1e-7, -3.7e-7, 7.0e-7])


@dataclass(frozen=True)
class Labels:
    """Exact labels of one frame, all (H, W).

    Args:
        depth: z-depth of the first surface, metres, float32; 0 where there is none.
        background_depth: The same with the glass taken away.
        hand_mask: Where the first surface is the hand.
        object_mask: Where it is the glass.
        normals: Unit normals toward the camera, camera frame, (H, W, 3); 0 where nothing is met.
    """

    depth: npt.NDArray[np.float32]
    background_depth: npt.NDArray[np.float32]
    hand_mask: npt.NDArray[np.bool_]
    object_mask: npt.NDArray[np.bool_]
    normals: npt.NDArray[np.float32]


def search_tree(*surfaces: Surface) -> Any:
    """Embree's search tree over surfaces, each a mesh of its own."""
    tree = EmbreeScene(robust=True)  # hardly a ray slips through between two triangles
    for surface in surfaces:
        TriangleMesh(tree, surface.vertices.astype(np.float32), surface.faces.astype(np.int32))
    return tree


_kept_tree = lru_cache(maxsize=8)(search_tree)  # a probe and a picture ask the same ones


class Rows:
    """A dataclass whose fields have one row each for every ray."""

    def take(self, rows: Any) -> Self:
        """Some of the rows."""
        columns = vars(self).values()
        return type(self)(*(c.take(rows) if isinstance(c, Rows) else c[rows] for c in columns))


@dataclass(frozen=True)
class Hits(Rows):
    """First surfaces along N rays: distance (inf on a miss), mesh number, face, barycentrics."""

    distance: Array
    mesh: npt.NDArray[np.int64]
    face: npt.NDArray[np.int64]
    u: Array
    v: Array

    def mixed(self, values: Array, faces: npt.NDArray[np.int64]) -> Array:
        """Values of a mesh's vertices (V, C) where it is hit, between its vertices, (N, C)."""
        a, b, c = (values[faces[self.face, i]] for i in range(3))
        u, v = self.u[:, None], self.v[:, None]
        return np.asarray((1 - u - v) * a + u * b + v * c)


def unit(vectors: Array, least: float = 1e-12) -> Array:
    """Vectors (N, 3) scaled to length 1; those shorter than ``least`` stay short."""
    return np.asarray(vectors / np.maximum(np.sqrt(dots(vectors, vectors)), least)[:, None])


def _exact(
    hits: Hits, surfaces: list[Surface], origins: Array, directions: Array
) -> tuple[Hits, Array]:
    """The found triangles met in double precision, and how far each ray passes by, metres."""
    # Embree computes in single precision. A hit stays in its triangle: one that is seen edge-on
    # can't be met far beyond its corners. A miss passes by at an infinite distance.
    distance, u, v = hits.distance.copy(), hits.u.copy(), hits.v.copy()
    beside = np.full(len(distance), np.inf)
    for number, surface in enumerate(surfaces):
        rows = np.flatnonzero(hits.mesh == number)
        if not len(rows):
            continue
        corners = surface.vertices[surface.faces[hits.face[rows]]]
        a, e1, e2 = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        o, d = origins[rows] - a, directions[rows]
        p, q = crosses(d, e2), crosses(o, e1)
        det = dots(e1, p)
        flat = np.abs(det) < 1e-12 * np.linalg.norm(e1, axis=1) * np.linalg.norm(e2, axis=1)
        det = np.where(flat, 1.0, det)
        exact_u = np.where(flat, u[rows], np.clip(dots(o, p) / det, 0.0, 1.0))
        exact_v = np.where(flat, v[rows], dots(d, q) / det)
        exact_v = np.clip(exact_v, 0.0, 1.0 - exact_u)
        to_eye = o - exact_u[:, None] * e1 - exact_v[:, None] * e2
        along = -dots(to_eye, d)
        distance[rows], u[rows], v[rows] = along, exact_u, exact_v
        beside[rows] = np.linalg.norm(to_eye + along[:, None] * d, axis=1)
    return Hits(distance, hits.mesh, hits.face, u, v), beside


def _chosen(second: npt.NDArray[np.bool_], a: Hits, b: Hits) -> Hits:
    """Hits of b where ``second``, else those of a."""
    names = a.__dataclass_fields__
    return Hits(*(np.where(second, getattr(b, name), getattr(a, name)) for name in names))


def rays_through(
    uv: Array, camera: Intrinsics, world_from_camera: Array, beside: float = 0.0
) -> tuple[Array, Array]:
    """Rays of looking through pixels (..., 2), which may be broken: origins and unit directions.

    World frame, metres, each (N, 3); the eye is moved ``beside`` metres to the camera's right.
    """
    u, v = uv.reshape(-1, 2).T
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    local = np.stack([x, y, np.ones_like(x)], axis=1)
    local /= np.linalg.norm(local, axis=1, keepdims=True)
    rotation, eye = world_from_camera[:3, :3], world_from_camera[:3, 3]
    directions = local @ rotation.T
    return np.broadcast_to(eye + rotation[:, 0] * beside, directions.shape), directions


class RayCaster:
    """Surfaces of a scene, ready to be met by rays."""

    def __init__(self, contents: Contents) -> None:
        self.contents = contents
        self._opaque: list[tuple[int, Surface]] = []
        if contents.surroundings is not None:
            self._opaque.append((SURROUNDINGS, contents.surroundings.surface))
        if contents.hand is not None:
            self._opaque.append((HAND, contents.hand.surface))
        glass = contents.glass
        self.meshes = [*self._opaque, *((GLASS, body) for body in glass)]
        self._kinds = np.array([kind for kind, _ in self.meshes] + [NOTHING])
        # One tree per kind of thing: (number of its first mesh, tree). A ray asks several.
        self._solid = [(i, _kept_tree(surface)) for i, (_, surface) in enumerate(self._opaque)]
        self._clear = [(len(self._opaque), _kept_tree(*glass))] if glass else []
        self._all = [*self._solid, *self._clear]

    @staticmethod
    def _trace(trees: list[tuple[int, Any]], origins: Array, directions: Array) -> Hits:
        n = len(origins)
        none = np.full(n, -1, dtype=np.int64)
        hits = Hits(np.full(n, np.inf), none, none.copy(), np.zeros(n), np.zeros(n))
        if n == 0:
            return hits
        start = np.ascontiguousarray(origins, dtype=np.float32)
        heading = np.ascontiguousarray(directions, dtype=np.float32)
        for first, tree in trees:
            found = tree.run(start, heading, query="INTERSECT", output=True)
            nearer = np.flatnonzero((found["primID"] >= 0) & (found["tfar"] < hits.distance))
            hits.distance[nearer] = found["tfar"][nearer]
            hits.mesh[nearer] = found["geomID"][nearer] + first
            hits.face[nearer] = found["primID"][nearer]
            hits.u[nearer], hits.v[nearer] = found["u"][nearer], found["v"][nearer]
        return hits

    def _first_hits(self, origins: Array, directions: Array) -> tuple[Hits, Hits]:
        """Exact first hits with all surfaces, and with the opaque ones alone."""
        surfaces = [surface for _, surface in self.meshes]
        found = []
        for trees in (self._solid, self._clear):
            hits, _ = _exact(self._trace(trees, origins, directions), surfaces, origins, directions)
            # Embree may lose a ray that meets a common corner of triangles; one a hair beside it
            # finds them, and whether the ray itself meets what was found is then decided exactly.
            near = self._trace(trees, origins, directions + _HAIR)
            again, beside = _exact(near, surfaces, origins, directions)
            found.append(_chosen((again.distance < hits.distance) & (beside < 1e-7), hits, again))
        behind, glass = found
        return _chosen(glass.distance < behind.distance, behind, glass), behind

    def first(self, origins: Array, directions: Array) -> Hits:
        """The first surface along each ray, in single precision."""
        return self._trace(self._all, origins, directions)

    def kind(self, mesh: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        """What mesh numbers stand for: HAND, GLASS or SURROUNDINGS; NOTHING for -1."""
        return np.asarray(self._kinds[mesh])

    def glass_alone(self, origins: Array, directions: Array) -> npt.NDArray[np.bool_]:
        """Which rays would meet the glass if nothing hid it, shape (N,)."""
        return np.asarray(self._trace(self._clear, origins, directions).face >= 0)

    def normals(self, hits: Hits) -> tuple[Array, Array]:
        """Smooth and flat unit normals, outward, each (N, 3); 0 where nothing is met."""
        smooth, flat = np.zeros((2, len(hits.mesh), 3))
        for number, (_, surface) in enumerate(self.meshes):
            rows = np.flatnonzero(hits.mesh == number)
            if not len(rows):
                continue
            some = hits.take(rows)
            smooth[rows] = unit(some.mixed(surface.normals, surface.faces))
            a, b, c = (surface.vertices[surface.faces[some.face, i]] for i in range(3))
            flat[rows] = unit(crosses(b - a, c - a), 1e-20)
        return smooth, flat

    def labels(self, camera: Intrinsics, world_from_camera: Array) -> Labels:
        """Depth, masks and normals, from one ray through every pixel's centre."""
        origins, directions = rays_through(pixel_grid(camera), camera, world_from_camera)
        hits, behind = self._first_hits(origins, directions)
        kind = self._kinds[hits.mesh]
        smooth, _ = self.normals(hits)
        toward = -np.sign(dots(smooth, directions))[:, None]
        normals = (smooth * toward) @ world_from_camera[:3, :3]
        ahead = ray_directions(camera)[..., 2].ravel()
        shape = camera.shape

        def depth(found: Hits) -> npt.NDArray[np.float32]:
            z = np.where(np.isfinite(found.distance), found.distance * ahead, 0.0)
            return z.astype(np.float32).reshape(shape)

        hand, glass = ((kind == thing).reshape(shape) for thing in (HAND, GLASS))
        facing = normals.astype(np.float32).reshape(*shape, 3)
        return Labels(depth(hits), depth(behind), hand, glass, facing)
