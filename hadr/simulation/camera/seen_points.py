"""From a depth image to points: those of the object, and those that the gripper must not touch."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from scipy.spatial import cKDTree

from hadr.camera import Intrinsics, back_project
from hadr.simulation.camera.robot_camera import CapturedFrame

Array = npt.NDArray[np.float64]
Depth = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]

_LARGEST_CLOUD = 1500
_SMALLEST_CLOUD = 10
_SCENE_SPACING = 0.015
_SCENE_REACH = 0.50
_FOREARM_FROM = 0.06


def object_points(
    depth: Depth, mask: Mask, camera: Intrinsics, rng: np.random.Generator
) -> Array | None:
    """Points (n, 3) of the mask's pixels, camera frame, without those that lie apart.

    At most 1500 of them, drawn at random; None where fewer than ten are left.
    """
    points = back_project(np.where(mask, depth, 0), camera)[mask]
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) > _LARGEST_CLOUD:
        points = points[np.sort(rng.choice(len(points), _LARGEST_CLOUD, replace=False))]
    points = without_outliers(points)
    return points if len(points) >= _SMALLEST_CLOUD else None


def without_outliers(points: Array) -> Array:
    """Drop points (n, 3) whose mean distance to eight neighbours is two deviations too far."""
    if len(points) <= 8:
        return points
    distances, _ = cKDTree(points).query(points, 9)
    apart = distances[:, 1:].mean(axis=1)
    kept: Array = points[apart <= apart.mean() + 2.0 * apart.std()]
    return kept


def scene_points(frame: CapturedFrame, mask: Mask, keypoints: Array | None) -> Array:
    """Measured points that the gripper must not touch: what stands around, and the forearm.

    The robot knows its own arm and leaves it out, as it does the object's mask (H, W); the hand
    itself is known by its keypoints (21, 3). Camera frame, metres, shape (n, 3): one a cube of
    1.5 cm, within 0.5 m of the hand, or of the picture's middle where none was found.
    """
    near_own = ndimage.binary_dilation(mask | frame.arm_mask, iterations=3)
    points = back_project(np.where(near_own, 0, frame.raw_depth), frame.camera).reshape(-1, 3)
    known = np.isfinite(points[:, 2])
    points, skin = points[known], frame.hand_mask.ravel()[known]
    if keypoints is None:
        middle = np.median(points, axis=0) if len(points) else np.zeros(3)
    else:
        middle = keypoints.mean(axis=0)
    near = np.linalg.norm(points - middle, axis=1) < _SCENE_REACH
    points, skin = points[near], skin[near]
    if keypoints is not None and len(points):
        margin = ndimage.binary_dilation(frame.hand_mask, iterations=2).ravel()[known][near] & ~skin
        distance, _ = cKDTree(keypoints).query(points)
        # pixels beside the hand's outline hold flying points, no obstacles
        points = points[(distance > _FOREARM_FROM) & ~margin]
    _, first = np.unique(np.floor(points / _SCENE_SPACING), axis=0, return_index=True)
    thinned: Array = points[np.sort(first)]
    return thinned
