"""How far skin is from glass: a table of distances that a search can ask a million times.

Hands stay outside of the *filled* object, its mouth closed, so that a finger that passes right
through a thin wall is as deep inside as it looks. A finger that reaches into the mouth is measured
from the hollow's side instead: it may be in the hollow or above the rim, nowhere else.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import zoom

from hadr.camera import Array
from hadr.records.caches import kept
from hadr.synthesis.glass.distance import signed_distance
from hadr.synthesis.glass.objects import glass_object
from hadr.synthesis.glass.shape import GlassObject, profile

Floats = npt.NDArray[np.float32]

#: Cells of the table over (r, z) and around a handle, metres.
_CELL, _HANDLE_CELL = 0.0005, 0.001
_COARSE = 0.0015
_REACH, _BEYOND = 0.15, 0.10


@dataclass(frozen=True, eq=False)
class ClearanceTable:
    """Distances around one object, looked up at the nearest cell (0.3 mm off at most).

    Args:
        outside: Distance from the filled object over (r, z), negative inside.
        hollow: The same for a finger in the mouth: positive in the hollow and above the rim,
            negative in the wall and on its other side.
        glass: Distance from the glass alone over (r, z).
        lowest: Height of the table's first row.
        handle: Distance in a box around the handle over (x, |y|, z); empty without one.
        handle_from: Corner of that box.
    """

    outside: Floats
    hollow: Floats
    glass: Floats
    lowest: float
    handle: Floats
    handle_from: tuple[float, float, float]

    def _cells(self, points: Floats) -> npt.NDArray[np.intp]:
        r = np.sqrt(points[..., 0] ** 2 + points[..., 1] ** 2)
        rows = np.clip((r * (1 / _CELL) + 0.5).astype(np.intp), 0, self.outside.shape[0] - 1)
        columns = ((points[..., 2] - self.lowest) * (1 / _CELL) + 0.5).astype(np.intp)
        columns = np.clip(columns, 0, self.outside.shape[1] - 1)
        return np.asarray(rows * self.outside.shape[1] + columns)

    def around(self, points: Floats) -> Floats:
        """Distance from the filled object, object frame, metres, shape of the points less one."""
        distance = self.outside.take(self._cells(points))
        if self.handle.size:
            x, y, z = np.moveaxis(points, -1, 0)
            beside = (x - self.handle_from[0], np.abs(y), z - self.handle_from[2])
            index = np.stack([way / _HANDLE_CELL + 0.5 for way in beside]).astype(np.intp)
            size = np.array(self.handle.shape).reshape((3,) + (1,) * (index.ndim - 1))
            near = ((index >= 0) & (index < size)).all(axis=0)
            distance[near] = self.handle[tuple(index[:, near])]
        return np.asarray(distance)

    def glass_near(self, points: Floats, free: Floats) -> Floats:
        """Distance from the glass itself, metres; where a point is not free, that instead.

        The closed mouth of the filled object is nothing that a finger could touch.
        """
        glass = self.glass.take(self._cells(points))
        # Beside a handle the filled object is the glass.
        beside = (points[..., 0] > self.handle_from[0]) if self.handle.size else False
        return np.asarray(np.where((free < 0) | beside, free, np.maximum(free, glass)))

    def within(self, points: Floats) -> Floats:
        """Distance for a finger in the mouth, object frame, metres."""
        return np.asarray(self.hollow.take(self._cells(points)))


def hollow_distance(item: GlassObject, points: npt.ArrayLike) -> Array:
    """Distance for skin in the mouth: positive in the hollow and above the rim, else negative.

    Points (N, 3) in the object's frame, metres.
    """
    p = np.asarray(points, dtype=float)
    curve = profile(item)
    rim = int(np.argmax(curve[:, 1]))
    top = float(curve[rim, 1])
    inner = curve[rim:]
    rz = np.stack([np.hypot(p[:, 0], p[:, 1]), p[:, 2]], axis=1)
    glass = signed_distance(item, p)
    filled = signed_distance(item, p, filled=True)
    free = ((filled < 0) & (glass > 0)) | (rz[:, 1] > top)
    a, edge = inner[:-1], np.diff(inner, axis=0)
    length = np.maximum((edge * edge).sum(1), 1e-18)
    squared = np.full(len(p), np.inf)
    for start, along, size in zip(a, edge, length, strict=True):
        offset = rz - start
        fraction = np.clip(offset @ along / size, 0, 1)
        squared = np.minimum(squared, ((offset - fraction[:, None] * along) ** 2).sum(1))
    # From the side of the wall a finger would have to climb over the rim.
    return np.asarray(np.where(free, np.maximum(glass, 0), -np.sqrt(squared)))


@kept(16)
def clearance_table(object_id: str) -> ClearanceTable:
    """The table of an object, made once."""
    item = glass_object(object_id)
    r = np.arange(0.0, _REACH, _COARSE)
    z = np.arange(-_BEYOND, item.height + _BEYOND, _COARSE)
    rr, zz = np.meshgrid(r, z, indexing="ij")
    # The half plane opposite to a handle.
    points = np.stack([-rr.ravel(), np.zeros(rr.size), zz.ravel()], axis=1)
    parts = np.array_split(points, 16)

    def table(values: list[Array]) -> Floats:
        grid = np.concatenate(values).reshape(rr.shape)
        scale = [((n - 1) * round(_COARSE / _CELL) + 1) / n for n in grid.shape]
        return np.asarray(zoom(grid, scale, order=1, grid_mode=False), dtype=np.float32)

    outside = table([signed_distance(item, p, filled=True) for p in parts])
    glass = table([signed_distance(item, p) for p in parts])
    hollow = table([hollow_distance(item, p) for p in parts])
    handle: Floats = np.zeros((0, 0, 0), np.float32)
    corner = (0.0, 0.0, 0.0)
    if item.handle:
        line = np.asarray(item.handle)
        thick = item.handle_radius + 0.016
        low = np.array([line[:, 0].min() - 0.004, 0.0, line[:, 1].min() - thick])
        high = np.array([line[:, 0].max() + thick, thick, line[:, 1].max() + thick])
        axes = [np.arange(a, b, _HANDLE_CELL) for a, b in zip(low, high, strict=True)]
        box = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        flat = np.array_split(box.reshape(-1, 3), 32)
        values = np.concatenate([signed_distance(item, p, filled=True) for p in flat])
        handle = values.reshape(box.shape[:3]).astype(np.float32)
        corner = (float(low[0]), 0.0, float(low[2]))
    return ClearanceTable(outside, hollow, glass, -_BEYOND, handle, corner)
