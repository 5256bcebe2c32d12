"""Naive surface nets: the zero level of a sampled field as a closed triangle surface."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from hadr.camera import Array

Grid = npt.NDArray[np.float32]


def surface_nets(
    values: Grid, axes: tuple[Array, Array, Array]
) -> tuple[Array, npt.NDArray[np.int64]]:
    """Triangulate the zero level of a field, negative inside, sampled at increasing places.

    One vertex (V, 3) per cell that the surface crosses, the mean of the crossings on its edges; one
    quad per grid edge whose ends differ in sign, as two faces (F, 3), counter-clockwise from
    outside. The surface is closed where it stays off the border.
    """
    inside = values < 0
    corners = list(np.ndindex(2, 2, 2))
    shape = tuple(n - 1 for n in values.shape)
    count = np.zeros(shape, dtype=np.int8)
    for i, j, k in corners:
        count += inside[i : i + shape[0], j : j + shape[1], k : k + shape[2]]
    cells = np.argwhere((count > 0) & (count < 8))
    number = np.full(shape, -1, dtype=np.int64)
    number[tuple(cells.T)] = np.arange(len(cells))
    total, crossings = np.zeros((len(cells), 3)), np.zeros(len(cells))
    for first in corners:
        for axis in range(3):
            if first[axis]:
                continue
            second = tuple(int(c + (a == axis)) for a, c in enumerate(first))
            va = values[tuple((cells + first).T)]
            vb = values[tuple((cells + second).T)]
            cross = (va < 0) != (vb < 0)
            fraction = np.where(cross, va / np.where(cross, va - vb, 1.0), 0.0)
            point = np.asarray(first, dtype=float) + fraction[:, None] * np.eye(3)[axis]
            total += np.where(cross[:, None], point, 0.0)
            crossings += cross
    place = cells + total / crossings[:, None]
    columns = zip(place.T, axes, strict=True)
    vertices = np.stack([np.interp(p, np.arange(len(a)), a) for p, a in columns], axis=1)

    quads = []
    for axis in range(3):
        u, v = np.roll(np.eye(3, dtype=int), -axis, axis=0)[1:]  # unit steps across the edge
        along = np.moveaxis(inside, axis, 0)
        a, b = (np.moveaxis(part, 0, axis) for part in (along[:-1], along[1:]))
        for turn, edges in ((1, np.argwhere(a & ~b)), (-1, np.argwhere(~a & b))):
            around = [number[tuple((edges + cell).T)] for cell in (0 * u, -u, -u - v, -v)]
            quads.append(np.stack(around, axis=1)[:, ::turn])
    quad = np.concatenate(quads)
    return vertices, np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])
