"""Closed triangle surfaces: revolved around an axis, a tube around a line, and their union."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import manifold3d
import numpy as np
import numpy.typing as npt
from scipy.interpolate import PchipInterpolator

from hadr.camera import Array

SEGMENTS = 128
HANDLE_SEGMENTS = 32


def dots(first: Array, second: Array) -> Array:
    """Scalar products of the rows of two (N, 3), shape (N,): sums over threes are slow in numpy."""
    products = first * second
    return np.asarray(products[:, 0] + products[:, 1] + products[:, 2])


def crosses(first: Array, second: Array) -> Array:
    """Cross products of the rows of two (N, 3), in half of `np.cross`'s time, shape (N, 3)."""
    (a, b, c), (x, y, z) = first.T, second.T
    return np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=1)


@dataclass(frozen=True, eq=False)
class Surface:
    """A closed triangle surface with a normal per vertex.

    Args:
        vertices: Metres, shape (V, 3).
        faces: Vertex indices, counter-clockwise from outside, shape (F, 3).
        normals: Unit outward normals, shape (V, 3).
    """

    vertices: Array
    faces: npt.NDArray[np.int64]
    normals: Array

    def moved(self, transform: Array) -> Surface:
        """The surface after a rigid transform, shape (4, 4)."""
        rotation = transform[:3, :3]
        return Surface(
            self.vertices @ rotation.T + transform[:3, 3], self.faces, self.normals @ rotation.T
        )


def vertex_normals(vertices: Array, faces: npt.NDArray[np.int64]) -> Array:
    """Unit outward normals per vertex, the faces' normals weighted by area, shape (V, 3)."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    flat = crosses(b - a, c - a)
    corners, count = faces.ravel(), len(vertices)
    sums = [np.bincount(corners, np.repeat(column, 3), minlength=count) for column in flat.T]
    normals = np.stack(sums, axis=1)
    length = np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    return np.asarray(normals / length, dtype=float)


def lengths_along(line: Array) -> Array:
    """How far each of a line's points (N, K) lies from its first, along the line, shape (N,)."""
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def smooth_curve(points: Sequence[Sequence[float]], spacing: float) -> Array:
    """A monotone curve through control points, sampled every ``spacing`` metres."""
    p = np.asarray(points, dtype=float)
    length = lengths_along(p)
    steps = np.maximum(np.ceil(np.diff(length) / spacing), 3).astype(int)
    pieces = zip(length, length[1:], steps, strict=False)
    at = [np.linspace(a, b, n, endpoint=False) for a, b, n in pieces]
    return np.asarray(PchipInterpolator(length, p)(np.append(np.concatenate(at), length[-1])))


def revolve(
    curve: Array,
    relief: Callable[[Array, Array], Array] | None = None,
    segments: int = SEGMENTS,
) -> Surface:
    """Turn an outline (r, z), shape (N, 2), that starts and ends on the axis, into a surface.

    The inside of the solid is on the outline's left. A relief gives the radius on each of S
    meridians, shape (N - 2, S), from angles of that shape and outline points (N - 2, S, 2).
    """
    rings = len(curve) - 2
    angle = np.broadcast_to(np.arange(segments) * 2 * np.pi / segments, (rings, segments))
    rz = np.broadcast_to(curve[1:-1, None], (rings, segments, 2))
    radius = rz[..., 0] if relief is None else relief(angle, rz)
    grid = np.stack([radius * np.cos(angle), radius * np.sin(angle), rz[..., 1]], axis=-1)
    ends = np.array([[0.0, 0.0, curve[0, 1]], [0.0, 0.0, curve[-1, 1]]])
    # Normals from the derivatives along both parameters, exact for lines and arcs of the outline.
    first, last = (np.broadcast_to(end, (1, segments, 3)) for end in ends)
    padded = np.concatenate([first, grid, last])
    along = np.gradient(padded, lengths_along(curve), axis=0)[1:-1]
    around = np.roll(grid, -1, axis=1) - np.roll(grid, 1, axis=1)
    normal = np.cross(around, along)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-18)
    vertices = np.concatenate([grid.reshape(-1, 3), ends])
    normals = np.concatenate([normal.reshape(-1, 3), [[0, 0, -1.0], [0, 0, 1.0]]])
    return Surface(vertices, _tube_faces(rings, segments), normals)


def _tube_faces(rings: int, segments: int) -> npt.NDArray[np.int64]:
    """Faces of rings of vertices one after the other, closed by the two vertices behind them."""
    i = np.arange(segments)
    j = (i + 1) % segments
    faces = []
    for ring in range(rings - 1):
        a, b = ring * segments, (ring + 1) * segments
        faces += [np.stack([a + i, a + j, b + j], 1), np.stack([a + i, b + j, b + i], 1)]
    bottom, top, last = rings * segments, rings * segments + 1, (rings - 1) * segments
    faces.append(np.stack([np.full(segments, bottom), j, i], 1))
    faces.append(np.stack([last + i, last + j, np.full(segments, top)], 1))
    return np.concatenate(faces)


def tube_around(line: Array, thickness: Array, width: Array) -> Surface:
    """A closed tube around a line (N, 3) in the plane y = 0, half axes (N,)."""
    tangent = np.gradient(line, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.array([0.0, 1.0, 0.0])
    up = np.cross(tangent, side)[:, None]
    angle = np.arange(HANDLE_SEGMENTS)[:, None] * 2 * np.pi / HANDLE_SEGMENTS
    cos, sin = np.cos(angle), np.sin(angle)
    a, b = width[:, None, None], thickness[:, None, None]
    grid = line[:, None] + a * cos * side + b * sin * up
    around = -a * sin * side + b * cos * up
    normal = np.cross(around, np.gradient(grid, axis=0))
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    vertices = np.concatenate([grid.reshape(-1, 3), line[:1], line[-1:]])
    normals = np.concatenate([normal.reshape(-1, 3), -tangent[:1], tangent[-1:]])
    return Surface(vertices, _tube_faces(len(line), HANDLE_SEGMENTS), normals)


def united(surfaces: tuple[Surface, ...]) -> Surface:
    """The union of closed surfaces: one without walls inside; on a cut normals are averaged."""
    total = manifold3d.Manifold()
    for surface in surfaces:
        both = np.concatenate([surface.vertices, surface.normals], axis=1)
        total += manifold3d.Manifold(
            manifold3d.Mesh64(np.ascontiguousarray(both), surface.faces.astype(np.uint64))
        )
    mesh = total.to_mesh64()
    both = np.asarray(mesh.vert_properties)
    # A vertex on a cut has one set of normals per side; they share their place.
    target = np.arange(len(both))
    target[np.asarray(mesh.merge_from_vert, dtype=np.int64)] = mesh.merge_to_vert
    kept, number = np.unique(target, return_inverse=True)
    normals = np.zeros((len(kept), 3))
    np.add.at(normals, number, both[:, 3:6])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    faces = number[np.asarray(mesh.tri_verts, dtype=np.int64)]
    return Surface(both[kept, :3].copy(), faces, normals)


def merged(surfaces: Sequence[Surface]) -> Surface:
    """Join surfaces into one list of vertices and faces, without welding them."""
    starts = np.cumsum([0, *(len(surface.vertices) for surface in surfaces)])
    return Surface(
        np.concatenate([s.vertices for s in surfaces]),
        np.concatenate([s.faces + k for s, k in zip(surfaces, starts, strict=False)]),
        np.concatenate([s.normals for s in surfaces]),
    )
