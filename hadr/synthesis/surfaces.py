"""Closed triangle surfaces: turned around an axis, or a tube around a line."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import PchipInterpolator

Array = npt.NDArray[np.float64]

SEGMENTS = 96
HANDLE_SEGMENTS = 20


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
        turn = transform[:3, :3]
        return Surface(self.vertices @ turn.T + transform[:3, 3], self.faces, self.normals @ turn.T)


def smooth_curve(points: tuple[tuple[float, float], ...], spacing: float) -> Array:
    """A monotone curve through control points, sampled every ``spacing`` metres."""
    p = np.asarray(points, dtype=float)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    steps = np.maximum(np.ceil(np.diff(length) / spacing), 3).astype(int)
    at = np.concatenate(
        [
            np.linspace(a, b, n, endpoint=False)
            for a, b, n in zip(length, length[1:], steps, strict=False)
        ]
        + [length[-1:]]
    )
    return np.asarray(PchipInterpolator(length, p)(at), dtype=float)


def revolve(curve: Array) -> Surface:
    """Turn an outline that starts and ends on the axis into a closed surface."""
    tangent = np.gradient(curve, axis=0)
    # The mean of both neighbouring segments' normals, weighted by their lengths.
    normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    normal[0], normal[-1] = (0.0, -1.0), (0.0, 1.0)
    angle = np.arange(SEGMENTS) * 2 * np.pi / SEGMENTS
    cos, sin = np.cos(angle), np.sin(angle)

    def turn(rz: Array) -> Array:
        ring = np.stack(
            [
                rz[:, :1] * cos,
                rz[:, :1] * sin,
                np.broadcast_to(rz[:, 1:], (len(rz), SEGMENTS)),
            ],
            axis=-1,
        )
        return ring.reshape(-1, 3)

    rings = len(curve) - 2
    vertices = np.concatenate([turn(curve[1:-1]), [[0, 0, curve[0, 1]], [0, 0, curve[-1, 1]]]])
    normals = np.concatenate([turn(normal[1:-1]), [[0, 0, -1.0], [0, 0, 1.0]]])
    i = np.arange(SEGMENTS)
    j = (i + 1) % SEGMENTS
    faces = []
    for ring in range(rings - 1):
        a, b = ring * SEGMENTS, (ring + 1) * SEGMENTS
        faces += [np.stack([a + i, a + j, b + j], 1), np.stack([a + i, b + j, b + i], 1)]
    bottom, top, last = rings * SEGMENTS, rings * SEGMENTS + 1, (rings - 1) * SEGMENTS
    faces.append(np.stack([np.full(SEGMENTS, bottom), j, i], 1))
    faces.append(np.stack([last + i, last + j, np.full(SEGMENTS, top)], 1))
    return Surface(vertices, np.concatenate(faces), normals)


def tube_around(line: Array, radius: float) -> Surface:
    """A closed tube around a line in the plane y = 0."""
    tangent = np.gradient(line, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.array([0.0, 1.0, 0.0])
    up = np.cross(tangent, side)
    angle = np.arange(HANDLE_SEGMENTS) * 2 * np.pi / HANDLE_SEGMENTS
    normal = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * up[:, None]
    vertices = (line[:, None] + radius * normal).reshape(-1, 3)
    i = np.arange(HANDLE_SEGMENTS)
    j = (i + 1) % HANDLE_SEGMENTS
    faces = []
    for ring in range(len(line) - 1):
        a, b = ring * HANDLE_SEGMENTS, (ring + 1) * HANDLE_SEGMENTS
        faces += [np.stack([a + i, b + j, a + j], 1), np.stack([a + i, b + i, b + j], 1)]
    first, last = len(vertices), len(vertices) + 1
    end = (len(line) - 1) * HANDLE_SEGMENTS
    faces.append(np.stack([np.full(HANDLE_SEGMENTS, first), i, j], 1))
    faces.append(np.stack([end + j, end + i, np.full(HANDLE_SEGMENTS, last)], 1))
    vertices = np.concatenate([vertices, line[:1], line[-1:]])
    normals = np.concatenate([normal.reshape(-1, 3), -tangent[:1], tangent[-1:]])
    return Surface(vertices, np.concatenate(faces), normals)


def merged(surfaces: tuple[Surface, ...]) -> Surface:
    """Join surfaces into one list of vertices and faces, without welding them."""
    faces: list[Any] = []
    start = 0
    for surface in surfaces:
        faces.append(surface.faces + start)
        start += len(surface.vertices)
    return Surface(
        np.concatenate([s.vertices for s in surfaces]),
        np.concatenate(faces),
        np.concatenate([s.normals for s in surfaces]),
    )
