"""The side that the camera does not see: an axis of symmetry from normals, and a mirror.

A camera sees the near half of a glass, and a gripper needs to know where the far half ends. Most
vessels are turned about an axis, and every normal of such a surface points at that axis. The axis
that the seen normals point at best gives the plane in which the seen half is mirrored.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from hadr.camera import Array

LARGEST_MISS = 0.006
"""Normals that pass the axis by more than this on the whole belong to no turned surface, metres."""
_MOST_POINTS = 200  # evenly over their order
_SPREAD = 0.2  # least mean squared sine between normals and axis: a flat disc has no axis


@dataclass(frozen=True)
class SymmetryAxis:
    """A line through a point (3,), metres, that a surface is turned about; its sign has no meaning.

    It is missed by the nearest two thirds of the normals by so much, root mean square, metres; what
    is left out may be a handle.
    """

    direction: Array
    point: Array
    miss: float


def symmetry_axis(points: Array, normals: Array) -> SymmetryAxis:
    """The line that the normals of a surface point at best.

    For a direction d the distances of the normals from a line along d are linear in where the line
    passes, so each of some hundred directions costs one equation of two unknowns.

    Points (n, 3) are in metres, the signs of their unit normals (n, 3) do not matter; `miss` is
    infinite where no direction gives an axis (a flat thing).
    """
    chosen = np.linspace(0, len(points) - 1, min(_MOST_POINTS, len(points))).astype(np.int64)
    middle = points.mean(axis=0)
    near, n = points[chosen] - middle, normals[chosen]
    best = _fitted(_half_sphere(120), near, n)
    for width in (0.12, 0.03):
        around = best.direction + width * _half_sphere(40)
        around = np.concatenate([around, 2 * best.direction - around, [best.direction]])
        around /= np.linalg.norm(around, axis=1, keepdims=True)
        best = _fitted(around, near, n)
    # a handle's normals point elsewhere: fit once more to the two thirds that pass nearest
    across = np.cross(best.direction, n)
    off = np.abs((across * (near - best.point)).sum(axis=1))
    kept = off <= np.quantile(off, 0.67)
    best = _fitted(around, near[kept], n[kept])
    return SymmetryAxis(best.direction, best.point + middle, best.miss)


def unseen_side(points: Array, normals: Array, viewpoint: Array) -> tuple[Array, Array]:
    """Guess the far half of an object from its near half.

    The seen points are mirrored in the plane through the axis of symmetry that faces the camera.
    Where the normals give no clear axis, as those of a box, they are mirrored in the middle of
    what is seen: each seen side has its like opposite.

    Given are seen points (n, 3), their unit normals and where the camera stood, metres; guessed
    points (m, 3) come back with theirs. m is 0 where the camera looks along the axis.
    """
    axis = symmetry_axis(points, normals)
    view = viewpoint - points.mean(axis=0)
    view = view / np.linalg.norm(view)
    direction = axis.direction
    if axis.miss > LARGEST_MISS:
        sides = _sides(normals)
        middle = sides @ np.percentile(points @ sides, [1, 99], axis=0).mean(axis=0)
        return 2 * middle - points, -normals
    facing = view - (view @ direction) * direction
    if np.linalg.norm(facing) < 0.3:
        return np.zeros((0, 3)), np.zeros((0, 3))
    facing /= np.linalg.norm(facing)
    depth = points @ facing
    left, right = np.percentile(points @ np.cross(direction, facing), [2, 98])
    nearest, half = float(np.percentile(depth, 98)), float(right - left) / 2
    plane = float(axis.point @ facing)
    if not 0 < nearest - plane < 1.6 * half + 0.01:
        plane = nearest - half
    seen = depth > plane
    mirrored = points[seen] - 2 * (depth[seen] - plane)[:, None] * facing
    turned = normals[seen] - 2 * (normals[seen] @ facing)[:, None] * facing
    return mirrored, turned


def turned_about_axis(points: Array, normals: Array) -> Array:
    """Guess the space that an object may take: its seen points (n, 3) turned about its axis.

    What the hand hides on one side is often seen on another. Points whose normals pass the axis by
    more than 1 cm (a handle) are not turned. Seven copies (m, 3) without the seen ones, metres;
    none where the normals give no clear axis.
    """
    axis = symmetry_axis(points, normals)
    if axis.miss > LARGEST_MISS:
        return np.zeros((0, 3))
    from_axis = points - axis.point
    off = np.abs((np.cross(axis.direction, normals) * from_axis).sum(axis=1))
    turned = from_axis[off < 0.01]
    angles = 2 * np.pi * np.arange(1, 8) / 8
    turns = Rotation.from_rotvec(angles[:, None] * axis.direction).as_matrix()
    return np.concatenate([turned @ turn.T for turn in turns]) + axis.point


def _sides(normals: Array) -> Array:
    """Three axes across each other, the first two along the most frequent normals: columns."""
    frequent = (np.abs(normals @ normals.T) > 0.95).sum(axis=1)
    first = normals[frequent.argmax()]
    across = np.abs(normals @ first) < 0.3
    second = normals[np.where(across, frequent, -1).argmax()] if across.any() else first[[1, 2, 0]]
    axes: Array = np.linalg.qr(np.stack([first, second, np.cross(first, second)], axis=1))[0]
    return axes


def _fitted(directions: Array, points: Array, normals: Array) -> SymmetryAxis:
    """The best of some directions, with the line along it that the normals pass nearest."""
    across = np.cross(directions[:, None], normals)  # (d, n, 3)
    along = (across * points).sum(axis=2)
    spread = (across**2).sum(axis=2).mean(axis=1)
    # along direction there is nothing to solve for: one is added to keep the system regular
    system = np.einsum("dni,dnj->dij", across, across) / len(points)
    system += np.einsum("di,dj->dij", directions, directions) + 1e-9 * np.eye(3)
    right = np.einsum("dni,dn->di", across, along) / len(points)
    places = np.linalg.solve(system, right[..., None])[..., 0]
    off = np.minimum((along - np.einsum("dni,di->dn", across, places)) ** 2, 0.02**2)
    miss = np.sqrt(off.mean(axis=1) / np.maximum(spread, 1e-12))
    miss[spread < _SPREAD] = np.inf
    best = int(miss.argmin())
    return SymmetryAxis(directions[best], places[best], float(miss[best]))


def _half_sphere(count: int) -> Array:
    """Unit vectors spread evenly over half a sphere, shape (count, 3)."""
    height = (np.arange(count) + 0.5) / count
    turn = np.pi * (1 + 5**0.5) * np.arange(count)
    ring = np.sqrt(1 - height**2)
    return np.stack([ring * np.cos(turn), ring * np.sin(turn), height], axis=1)
