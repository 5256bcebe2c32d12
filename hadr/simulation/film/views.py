"""From where a film looks at the handover: a pinhole camera beside the table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hadr.camera import Intrinsics
from hadr.handover.poses import camera_at

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """From where the world is looked at.

    Attributes:
        base_from_camera: Pose of the OpenCV camera, shape (4, 4), metres.
        camera: Intrinsics of the picture.
    """

    base_from_camera: Array
    camera: Intrinsics

    def pixel(self, point: npt.ArrayLike) -> tuple[float, float]:
        """Where a point of the base frame, shape (3,), metres, appears: (column, row)."""
        turn, eye = self.base_from_camera[:3, :3], self.base_from_camera[:3, 3]
        x, y, z = (np.asarray(point, dtype=np.float64) - eye) @ turn
        if z <= 0:
            raise ValueError(f"the point lies {-z:.3f} m behind the camera of this view")
        c = self.camera
        return float(c.fx * x / z + c.cx), float(c.fy * y / z + c.cy)


def view_from(
    eye: tuple[float, float, float],
    look_at: tuple[float, float, float],
    *,
    width: int = 640,
    height: int = 360,
    across: float = 1.4,
) -> View:
    """A view of given width at the point that is looked at.

    Args:
        eye: Where the camera stands, base frame, metres.
        look_at: The point in the middle of the picture, metres.
        width: Pixels.
        height: Pixels.
        across: Metres that the picture is wide at that point.
    """
    distance = float(np.linalg.norm(np.subtract(look_at, eye)))
    focal = width * distance / across
    camera = Intrinsics(focal, focal, (width - 1) / 2, (height - 1) / 2, width, height)
    return View(camera_at(np.array(eye), np.array(look_at)), camera)


def side_view(width: int = 640, height: int = 360) -> View:
    """Robot at the left, human at the right: the film's standard view."""
    return view_from((0.72, -1.6, 0.80), (0.36, 0.0, 0.32), width=width, height=height, across=1.55)


def close_view(point: tuple[float, float, float], width: int = 640, height: int = 360) -> View:
    """The same side, near to a point (base frame, metres), for what the fingers do."""
    x, y, z = point
    eye = (x - 0.05, y - 0.75, z + 0.28)
    return view_from(eye, point, width=width, height=height, across=0.46)
