"""The log of a TransHand-14K frame: Blender's camera, the keypoints, and their numbers.

Blender's camera looks along -z with y up. Camera coordinates in our OpenCV frame are
``diag(1, -1, -1) inverse(T) X`` for a world point X.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from hadr.camera import TRANSHAND_CAMERA, Array, Intrinsics
from hadr.records.reading import read_json, structured

#: OpenCV's camera axes in Blender's: x the same, y and z the other way round.
BLENDER_FROM_OPENCV: Array = np.diag([1.0, -1.0, -1.0, 1.0])


def camera_pose(point: Sequence[float], angle_degrees: Sequence[float]) -> Array:
    """``world_from_camera`` (4, 4) of the OpenCV camera from place and Euler angles, Rz Ry Rx."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xyz", angle_degrees, degrees=True).as_matrix()
    pose[:3, 3] = point
    return pose @ BLENDER_FROM_OPENCV


def camera_log(world_from_camera: npt.ArrayLike) -> tuple[list[float], list[float]]:
    """The log's ``camera point`` and ``camera angle``; the inverse of :func:`camera_pose`."""
    pose = np.asarray(world_from_camera, dtype=float) @ BLENDER_FROM_OPENCV
    angle = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz", degrees=True)
    return pose[:3, 3].tolist(), angle.tolist()


def rescaled_pixels(uv: npt.ArrayLike, of: Intrinsics, to: Intrinsics) -> Array:
    """Pixels (..., 2) of an image, in the same image resized; files hold those at 1280x720."""
    scale = np.array([to.width / of.width, to.height / of.height])
    return np.asarray((np.asarray(uv, dtype=float) + 0.5) * scale - 0.5)


def read_log(path: Path) -> dict[str, Any]:
    """Read a log; a ``ValueError`` names a file that is not one."""
    log = structured(read_json(path), dict[str, Any], path)
    if log.get("hold_id") is not None:
        structured(log["hold_id"], str, f"{path}: 'hold_id'")
    return log


def numbers(log: Mapping[str, Any], key: str, path: Path, count: int) -> list[float]:
    """``count`` finite numbers from a list or from named values; else a ``ValueError``."""
    if key not in log:
        raise ValueError(f"{path} lacks the key {key!r}; it has {', '.join(log) or 'none'}")
    value = log[key]
    value = list(value.values()) if isinstance(value, Mapping) else value
    found = structured(value, list[float], f"{path}: {key!r}")
    if len(found) != count:
        raise ValueError(f"{path}: {key!r} must hold {count} finite numbers, got {value!r:.80}")
    return found


def log_pose(log: Mapping[str, Any], path: Path) -> Array:
    """``world_from_camera`` (4, 4) of a log; ``path`` names it in errors."""
    point = numbers(log, "camera point", path, 3)
    return camera_pose(point, numbers(log, "camera angle", path, 3))


def log_keypoints(log: Mapping[str, Any], path: Path) -> Array:
    """The first 21 points of ``hand_keypoint``, world, metres, shape (21, 3)."""
    if "hand_keypoint" not in log:
        raise ValueError(f"{path} lacks the key 'hand_keypoint'; it has {', '.join(log) or 'none'}")
    named = log["hand_keypoint"]
    if not isinstance(named, Mapping) or len(named) < 21:
        count = len(named) if isinstance(named, Mapping) else 0
        raise ValueError(f"{path}: 'hand_keypoint' must name at least 21 points, got {count}")
    first = list(named)[:21]
    return np.array([numbers(named, name, path, 3) for name in first])


def is_rigid(matrix: Array) -> bool:
    """Whether (4, 4) is a rotation, to a thousandth, and a shift."""
    turn = matrix[:3, :3]
    turns = np.allclose(turn @ turn.T, np.eye(3), atol=1e-3) and np.linalg.det(turn) > 0
    finite = np.isfinite(matrix).all()
    return bool(turns and finite and np.allclose(matrix[3], (0, 0, 0, 1)))


def log_transform(log: Mapping[str, Any], key: str, path: Path) -> Array | None:
    """A rigid transform (4, 4) of a log, or None where the log has none of this name."""
    if key not in log:
        return None
    rows = structured(log[key], list[list[float]], f"{path}: {key!r}")
    matrix = np.array(rows) if [len(row) for row in rows] == [4] * 4 else np.zeros((4, 4))
    if not is_rigid(matrix):
        raise ValueError(f"{path}: {key!r} must be a rigid 4x4 matrix, got {rows!r:.80}")
    return matrix


def log_camera(log: Mapping[str, Any], width: int, height: int, path: Path) -> Intrinsics:
    """Intrinsics of ``camera internal``: a matrix, named values, or the data set's if left out."""
    value = log.get("camera internal")
    if value is None:
        return TRANSHAND_CAMERA.resized(width, height)
    try:
        if isinstance(value, Mapping):
            return Intrinsics.from_dict({"width": width, "height": height, **value})
        rows = structured(value, list[list[float]], "")
        return Intrinsics.from_matrix(np.array(rows)[:, :3], width, height)
    except (TypeError, ValueError, IndexError, OverflowError) as error:
        raise ValueError(
            f"{path}: 'camera internal' must be a 3x3 matrix or fx, fy, cx, cy by name, got "
            f"{value!r:.80} ({error}); pass camera= to use your own"
        ) from error
