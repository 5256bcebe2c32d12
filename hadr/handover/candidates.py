"""Grasp candidates from points alone: a small geometric stand-in for a trained grasp detector.

A candidate needs two things: a slab of the object that fits between the fingers, and surfaces at
the slab's two ends that face the fingers (an antipodal pair holds without slipping).
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from hadr.handover.grasps import Grasps

Array = NDArray[np.float64]

FINGER_HEIGHT = 0.02
"""Thickness of a finger along the height axis, metres."""
FINGER_REACH = 0.06
"""How far past the first touched point the fingers can hold, metres."""


def surface_normals(points: Array, viewpoint: Array, neighbours: int = 16) -> Array:
    """Unit normals of a point cloud, turned to the side from which it was seen.

    Args:
        points: Shape (n, 3), metres.
        viewpoint: Where the camera stood, shape (3,), metres.
        neighbours: How many nearest points span the tangent plane.

    Returns:
        Normals, shape (n, 3).
    """
    _, near = cKDTree(points).query(points, k=min(neighbours, len(points)))
    around = points[near] - points[near].mean(axis=1, keepdims=True)  # (n, k, 3)
    _, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around))
    normals: Array = vectors[:, :, 0]
    away = ((viewpoint - points) * normals).sum(axis=1) < 0
    normals[away] *= -1
    return normals


def sample_grasps(
    points: Array,
    rng: np.random.Generator,
    *,
    viewpoint: Array | None = None,
    attempts: int = 400,
    turns: int = 6,
    largest_width: float = 0.085,
    frame: str = "camera",
) -> Grasps:
    """Draw grasp candidates around an object's points.

    Each attempt takes a surface point and an approach direction that meets the surface from
    outside, tries several turns about it, and keeps the turn with the best score. The score, 0 to
    1, is the mean of |n . c| over the points next to the two fingers: n normal, c closing axis.

    Args:
        points: Points of the object alone, shape (n, 3), metres; seen from one side is enough.
        rng: Source of the draws.
        viewpoint: Where the camera stood, shape (3,), metres; the frame's origin if left out.
        attempts: How many points and directions to try.
        turns: Turns about the approach axis tried at each, over half a circle.
        largest_width: Widest opening of the gripper, metres.
        frame: Name of the points' frame.

    Returns:
        Candidates, highest score first. The grasp's point is where the object is met first.

    Raises:
        ValueError: Fewer than 30 points, another shape, NaN, or no candidate found.
    """
    cloud = np.asarray(points, dtype=np.float64)
    if cloud.ndim != 2 or cloud.shape[1] != 3 or len(cloud) < 30:
        raise ValueError(f"points must be at least 30 rows of 3 metres, got shape {cloud.shape}")
    if not np.isfinite(cloud).all():
        raise ValueError("points must be finite, got NaN or infinity; drop the missing ones first")
    if len(cloud) > 3000:
        cloud = cloud[rng.choice(len(cloud), 3000, replace=False)]
    eye = np.zeros(3) if viewpoint is None else np.asarray(viewpoint, dtype=np.float64)
    normals = surface_normals(cloud, eye)
    rows = []
    for _ in range(attempts):
        seed = int(rng.integers(len(cloud)))
        approach = rng.normal(size=3)
        approach /= np.linalg.norm(approach)
        if approach @ normals[seed] > -0.3:
            continue
        side = np.cross(approach, np.eye(3)[np.argmin(np.abs(approach))])
        side /= np.linalg.norm(side)
        axes = np.stack([approach, side, np.cross(approach, side)], axis=1)
        tries = (
            _evaluate(cloud, normals, seed, axes, angle, largest_width)
            for angle in rng.uniform(0, np.pi / turns) + np.arange(turns) * np.pi / turns
        )
        kept = [row for row in tries if row is not None]
        if kept:
            rows.append(max(kept, key=lambda row: float(row[0])))
    if not rows:
        raise ValueError(
            f"no candidate among {attempts} attempts: the object is wider than the gripper's "
            f"{largest_width} m in every direction tried, or its points are too sparse"
        )
    table = np.stack(rows)
    return Grasps.from_rows(table[np.argsort(-table[:, 0], kind="stable")], frame)


def _evaluate(
    cloud: Array, normals: Array, seed: int, axes: Array, angle: float, largest_width: float
) -> Array | None:
    """A row of 17 numbers for one point and axes turned by an angle; None without a grasp there."""
    c, s = np.cos(angle), np.sin(angle)
    rotation = axes @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    closing = rotation[:, 1]
    local = (cloud - cloud[seed]) @ rotation  # along approach, closing, height
    slab = np.abs(local[:, 2]) < FINGER_HEIGHT / 2
    slab &= np.abs(local[:, 1]) < largest_width
    if slab.sum() < 8:
        return None
    first = float(local[slab, 0].min())
    slab &= local[:, 0] < first + FINGER_REACH
    low, high = local[slab, 1].min(), local[slab, 1].max()
    width = high - low + 0.01
    if not 0.015 < width <= largest_width:
        return None
    ends = slab & ((local[:, 1] < low + 0.15 * width) | (local[:, 1] > high - 0.15 * width))
    quality = float(np.abs(normals[ends] @ closing).mean())
    point = cloud[seed] + rotation @ np.array([first, (low + high) / 2, 0.0])
    return np.concatenate([[quality, width, FINGER_HEIGHT, 0.02], rotation.ravel(), point, [-1]])
