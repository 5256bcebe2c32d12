"""Read where a real camera stands, from a calibration file of the CORSMAL handover set-up."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from hadr.camera import Intrinsics
from hadr.handover.ur5 import check_pose

Array = npt.NDArray[np.float64]


class Calibration(NamedTuple):
    """A camera's calibration: intrinsics, and its pose in the frame that it was calibrated in."""

    intrinsics: Intrinsics
    base_from_camera: Array


def read_calibration(
    path: str | Path,
    camera: str = "camera1",
    sensor: str = "rgb",
    *,
    width: int = 1280,
    height: int = 720,
    base_from_world: Array | None = None,
) -> Calibration:
    """Read a calibration file of the CORSMAL handover set-up (RealSense cameras).

    The file holds, for each camera, ``K`` and ``extrinsics_world_to_camera`` (``R``, ``t``, and
    ``P = K [R | t]``) of the sensors ``rgb``, ``ir1``, ``ir2``; metres.

    Args:
        path: The JSON file.
        camera: Which camera.
        sensor: Which of its sensors.
        width: Width of its images, which the file does not tell, pixels.
        height: Their height, pixels.
        base_from_world: Where the calibration's world lies in the robot's base frame, shape
            (4, 4); they are the same where it is left out.

    Returns:
        Intrinsics and base_from_camera.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is none of this form, or its numbers contradict each other.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"no calibration file at {path}")
    try:
        values: Any = json.loads(path.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is no JSON: {error}") from error
    try:
        matrix = np.asarray(values[camera]["K"][sensor], dtype=float)
        pose = values[camera]["extrinsics_world_to_camera"][sensor]
        turn, shift = np.asarray(pose["R"], dtype=float), np.asarray(pose["t"], dtype=float)
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path} lacks {camera}/{sensor} with K, R and t: {error}") from error
    if turn.shape != (3, 3) or shift.size != 3:
        raise ValueError(f"{path}: R must be (3, 3) and t (3,), got {turn.shape}, {shift.shape}")
    camera_from_world = np.eye(4)
    camera_from_world[:3, :3], camera_from_world[:3, 3] = turn, shift.ravel()
    check_pose(camera_from_world, f"{camera}/{sensor} of {path}")
    if "P" in pose:
        off = np.abs(matrix @ camera_from_world[:3] - np.asarray(pose["P"], dtype=float)).max()
        if not off < 0.1:
            raise ValueError(f"{path}: P of {camera}/{sensor} is not K [R | t], off by {off:.3g}")
    world = np.eye(4) if base_from_world is None else base_from_world
    return Calibration(
        Intrinsics.from_matrix(matrix, width, height),
        check_pose(world, "base_from_world") @ np.linalg.inv(camera_from_world),
    )
