"""Rigid poses (4, 4): a check, distance, what lies between, a camera that looks at a point."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from hadr.camera import Array


def norm(vector: Array) -> float:
    """Length of a vector (n,), as of `np.linalg.norm` in a fraction of its time."""
    return math.sqrt(vector @ vector)


def check_pose(pose: Array, name: str = "pose") -> Array:
    """A pose as float64; ValueError, with its name, for what is no rigid transform.

    That is not (4, 4), not finite, or the upper left block is no proper rotation.
    """
    matrix = np.asarray(pose, dtype=np.float64)
    if matrix.shape != (4, 4):
        raise ValueError(f"{name} must be a (4, 4) transform, got shape {matrix.shape}")
    if not np.isfinite(matrix).all():
        raise ValueError(f"{name} must be finite, got NaN or infinity in it")
    rotation = matrix[:3, :3]
    error = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if error > 1e-6 or np.linalg.det(rotation) < 0 or not np.allclose(matrix[3], [0, 0, 0, 1]):
        raise ValueError(
            f"{name} must hold a proper rotation (R R^T = I, det +1) over the row 0 0 0 1, got "
            f"R R^T off by {error:.2g} and det {np.linalg.det(rotation):.3g}"
        )
    return matrix


def pose_distance(first: Array, second: Array) -> tuple[float, float]:
    """Distance in metres and angle in radians between two poses (4, 4) of one frame."""
    turn = first[:3, :3].T @ second[:3, :3]
    cosine = (float(turn[0, 0] + turn[1, 1] + turn[2, 2]) - 1) / 2
    return norm(first[:3, 3] - second[:3, 3]), float(np.arccos(min(max(cosine, -1.0), 1.0)))


def turn_between(first: Array, second: Array) -> Array:
    """Rotation vector (3,), in the first pose's frame, by which the second (4, 4) is turned."""
    return np.asarray(Rotation.from_matrix(first[:3, :3].T @ second[:3, :3]).as_rotvec())


def between(first: Array, second: Array, part: float, turn: Array | None = None) -> Array:
    """A part of the way from one pose (4, 4) to another: 0 gives the first, 1 the second.

    It lies on the straight line, turned about the one axis that leads there; whoever asks for
    several parts gives the `turn_between` the two.
    """
    if part >= 1.0:
        return second.copy()
    turn = turn_between(first, second) if turn is None else turn
    pose = first.copy()
    pose[:3, :3] = first[:3, :3] @ Rotation.from_rotvec(part * turn).as_matrix()
    pose[:3, 3] += part * (second[:3, 3] - first[:3, 3])
    return pose


def toward(first: Array, second: Array, distance: float, angle: float) -> Array:
    """Go from one pose (4, 4) toward another, by at most a distance (metres) and an angle.

    The angle is in radians; exactly the second pose where it lies within both.
    """
    way, turn = pose_distance(first, second)
    part = min(distance / max(way, 1e-12), angle / max(turn, 1e-12))
    return between(first, second, part)


def camera_at(position: Array, look_at: Array) -> Array:
    """base_from_camera (4, 4) of a camera at a point (3,) that looks at another, the image upright.

    Metres, base frame (z up); the camera's x is right, y down, z forward. The base's x is up in the
    image of one that looks straight down. ValueError where the two points are one.
    """
    forward = np.asarray(look_at, dtype=np.float64) - position
    if (far := np.linalg.norm(forward)) < 1e-9:
        raise ValueError(f"a camera at {np.asarray(position).tolist()} can't look at itself")
    forward /= far
    right = np.cross(forward, [0.0, 0.0, 1.0])
    if np.linalg.norm(right) < 1e-6:
        right = np.cross(forward, [1.0, 0.0, 0.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = position
    return pose
