"""The pinhole camera: intrinsics, projection and back-projection, rays, resize and crop.

Frames: the camera frame is OpenCV's (x right, y down, z forward), metres. A pixel's integer
coordinates ``(u, v) = (column, row)`` are its centre, so an image of width ``W`` covers
``u`` in ``[-0.5, W - 0.5]``. A depth image holds z, not the distance along the ray; 0 or NaN
marks a missing value.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from numbers import Real
from reprlib import repr as short
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
FloatArray = npt.NDArray[np.floating[Any]]
BoolArray = npt.NDArray[np.bool_]

LARGEST_IMAGE = 2**26
"""Pixels of the largest image that is taken for one: 8,192 by 8,192, 67 million."""
WIDEST_VIEW = 20.0
"""Image sizes a focal length: an image wider than so many of them is no pinhole camera's (169
degrees)."""
LONGEST_FOCAL_LENGTH = 1e6
"""Pixels; a camera of 1,000 pixels sees then 0.06 degrees."""


@dataclass(frozen=True)
class Intrinsics:
    """Pinhole intrinsics of an image of a known size, without lens distortion.

    Args:
        fx: Focal length along the rows, pixels.
        fy: Focal length along the columns, pixels.
        cx: Column of the principal point, pixels; pixel centres are integers.
        cy: Row of the principal point, pixels.
        width: Image width, pixels.
        height: Image height, pixels.

    Raises:
        ValueError: A size is not positive or beyond `LARGEST_IMAGE`, a focal length is none of a
            pinhole camera of this size (`WIDEST_VIEW`, `LONGEST_FOCAL_LENGTH`), or the principal
            point is further outside of the image than the image is wide or high.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            value = getattr(self, name)
            if not 1 <= value <= LARGEST_IMAGE or value != int(value):
                raise ValueError(
                    f"{name} must be a positive whole number of pixels, at most {LARGEST_IMAGE}, "
                    f"got {value:g}"
                )
        if self.width * self.height > LARGEST_IMAGE:
            raise ValueError(
                f"width and height must give at most {LARGEST_IMAGE} pixels, got "
                f"{self.width}x{self.height}"
            )
        for name, size in (("fx", self.width), ("fy", self.height)):
            value = getattr(self, name)
            if not size / WIDEST_VIEW <= value <= LONGEST_FOCAL_LENGTH:
                raise ValueError(
                    f"{name} must be a focal length in pixels, for an image of {size} between "
                    f"{size / WIDEST_VIEW:g} and {LONGEST_FOCAL_LENGTH:g}, got {value:g}"
                )
        for name, size in (("cx", self.width), ("cy", self.height)):
            value = getattr(self, name)
            if not np.isfinite(value) or not -size <= value <= 2 * size:
                raise ValueError(f"{name} must lie near the image of {size} pixels, got {value}")

    @property
    def matrix(self) -> npt.NDArray[np.float64]:
        """The calibration matrix K, shape (3, 3): pixel ~ K @ point."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of an image of this camera, (height, width)."""
        return self.height, self.width

    @classmethod
    def from_matrix(cls, matrix: npt.ArrayLike, width: int, height: int) -> Intrinsics:
        """Build intrinsics from K, (3, 3), pixels; ValueError for a skew or another form."""
        return cls(**checked_matrix(matrix), width=width, height=height)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Intrinsics:
        """Build intrinsics from ``fx fy cx cy width height``; a ValueError names what is wrong."""
        names = [field.name for field in fields(cls)]
        missing = [key for key in names if key not in values]
        if missing:
            raise ValueError(
                f"intrinsics lack {', '.join(missing)}; found {short(sorted(map(str, values)))}"
            )
        numbers: dict[str, Any] = {name: checked_number(name, values[name]) for name in names}
        whole = {name: int(numbers[name]) for name in names[4:] if numbers[name].is_integer()}
        return cls(**{**numbers, **whole})  # the class refuses other sizes

    def to_dict(self) -> dict[str, float | int]:
        """The six numbers by name."""
        return asdict(self)

    def resized(self, width: int, height: int) -> Intrinsics:
        """Intrinsics of the same view resampled to another size.

        A pixel centre c moves to (c + 0.5) s - 0.5, separately along each axis: squashing
        1280x720 to 224x224 changes fx and fy by different factors.
        """
        sx, sy = width / self.width, height / self.height
        return Intrinsics(
            self.fx * sx,
            self.fy * sy,
            (self.cx + 0.5) * sx - 0.5,
            (self.cy + 0.5) * sy - 0.5,
            width,
            height,
        )


#: TransHand-14K's camera at its native size (reference: the published loader's principal point).
TRANSHAND_CAMERA = Intrinsics(1137.7778, 1137.7778, 639.5, 359.5, 1280, 720)


def checked_matrix(matrix: Any) -> dict[str, float]:
    """The focal lengths and the principal point of a calibration matrix."""
    if np.shape(matrix) != (3, 3):
        raise ValueError(f"K must have shape (3, 3), got {np.shape(matrix)}")
    k = np.array([[checked_number("K", x) for x in row] for row in matrix])
    if abs(k[0, 1]) > 1e-9 or abs(k[1, 0]) > 1e-9 or not np.allclose(k[2], (0, 0, 1)):
        raise ValueError(f"K must be a pinhole matrix without skew, got {k.tolist()}")
    (fx, _, cx), (_, fy, cy) = k[:2].tolist()
    return {"fx": fx, "fy": fy, "cx": cx, "cy": cy}


def checked_number(name: str, value: Any) -> float:
    """Take a number from a file, or say what stands there (`true` is none, nor is "7")."""
    if isinstance(value, Real) and not isinstance(value, bool):
        with contextlib.suppress(OverflowError):
            return float(value)
    raise ValueError(f"{name} must be a number, got {short(value)}")


def valid_depth(depth: FloatArray) -> BoolArray:
    """Where a depth image holds a measurement: finite and greater than zero, same shape.

    ValueError for whole numbers: those are millimetres, or steps of a file.
    """
    if (kind := np.asarray(depth).dtype).kind != "f":
        raise ValueError(f"depth must be float metres, got {kind}")
    return np.isfinite(depth) & (depth > 0)


def pixel_grid(camera: Intrinsics) -> npt.NDArray[np.float64]:
    """Pixel centres (u, v) of every pixel, shape (H, W, 2)."""
    u, v = np.meshgrid(np.arange(camera.width, dtype=float), np.arange(camera.height, dtype=float))
    return np.stack([u, v], axis=-1)


def back_project(depth: FloatArray, camera: Intrinsics) -> npt.NDArray[np.float64]:
    """Lift a depth image to points in the camera frame.

    Args:
        depth: z-depth in metres, shape (H, W); 0 or NaN marks a missing value.
        camera: Intrinsics of an image of exactly this size.

    Returns:
        Points in metres, shape (H, W, 3); NaN where depth is missing.

    Raises:
        ValueError: The shapes of image and intrinsics differ.
    """
    depth = np.asarray(depth)
    if depth.ndim != 2:
        raise ValueError(f"depth must be (H, W) float metres, got {depth.shape} {depth.dtype}")
    if depth.shape != camera.shape:
        raise ValueError(
            f"depth has shape {depth.shape}, but the intrinsics are of an image of "
            f"{camera.width}x{camera.height} (shape {camera.shape})"
        )
    z = np.where(valid_depth(depth), depth, np.nan).astype(float)
    return unproject(pixel_grid(camera), z, camera)


def unproject(uv: npt.ArrayLike, z: npt.ArrayLike, camera: Intrinsics) -> npt.NDArray[np.float64]:
    """Lift pixels (u, v), shape (..., 2), of z-depths in metres, (...), to points, (..., 3)."""
    pixels, depth = np.asarray(uv, dtype=float), np.asarray(z, dtype=float)
    x = (pixels[..., 0] - camera.cx) / camera.fx * depth
    y = (pixels[..., 1] - camera.cy) / camera.fy * depth
    return np.stack([x, y, depth], axis=-1)


def project(points: npt.ArrayLike, camera: Intrinsics) -> npt.NDArray[np.float64]:
    """Project points of the camera frame, metres, shape (..., 3), to pixels (u, v), shape (..., 2).

    Points at or behind the camera's centre become NaN; those outside of the image keep their
    coordinates.
    """
    p = np.asarray(points, dtype=float)
    if p.shape[-1:] != (3,):
        raise ValueError(f"points must have shape (..., 3), got {p.shape}")
    z = np.where(p[..., 2] > 0, p[..., 2], np.nan)
    u = camera.fx * p[..., 0] / z + camera.cx
    v = camera.fy * p[..., 1] / z + camera.cy
    return np.stack([u, v], axis=-1)


def ray_directions(camera: Intrinsics) -> npt.NDArray[np.float64]:
    """Unit directions of the rays through all pixel centres, camera frame, shape (H, W, 3)."""
    d = unproject(pixel_grid(camera), np.ones(camera.shape), camera)
    return np.asarray(d / np.linalg.norm(d, axis=-1, keepdims=True))


def transform_points(transform: npt.ArrayLike, points: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Apply a rigid transform ``left_from_right``, (4, 4), e.g. ``camera_from_world``, to points.

    They are in metres, (..., 3), in the frame on the transform's right, and what is given in that
    on its left. ValueError where a shape differs.
    """
    t, p = np.asarray(transform, dtype=float), np.asarray(points, dtype=float)
    if t.shape != (4, 4):
        raise ValueError(f"transform must have shape (4, 4), got {t.shape}")
    if p.shape[-1:] != (3,):
        raise ValueError(f"points must have shape (..., 3), got {p.shape}")
    return np.asarray(p @ t[:3, :3].T + t[:3, 3])


def window_around(mask: BoolArray, margin: int) -> tuple[slice, slice]:
    """The rows and columns of a mask's bounding box, (H, W), and of `margin` pixels around it.

    They end at the image's border, and are used as ``image[window_around(mask, 20)]``. ValueError
    where the mask is empty.
    """
    if not mask.any():
        raise ValueError(f"the mask is empty: none of its {mask.size} pixels is set")
    lines = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    rows, columns = (
        slice(max(int(line[0]) - margin, 0), min(int(line[-1]) + margin + 1, size))
        for line, size in zip(lines, mask.shape, strict=True)
    )
    return rows, columns


def resize_color(color: npt.NDArray[np.uint8], width: int, height: int) -> npt.NDArray[np.uint8]:
    """Resize a colour image, shape (H, W, 3) uint8, by area when it shrinks, linearly else."""
    if width < 1 or height < 1:
        raise ValueError(f"target size must be positive, got {width}x{height}")
    shrinks = width < color.shape[1] or height < color.shape[0]
    method = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    resized = cv2.resize(np.ascontiguousarray(color), (width, height), interpolation=method)
    return np.asarray(resized, dtype=np.uint8)


def _nearest(target: int, source: int) -> npt.NDArray[np.int64]:
    """For each pixel of a resized line the old pixel that lies nearest to its centre."""
    centres = (np.arange(target) + 0.5) * source / target - 0.5
    return np.clip(np.floor(centres + 0.5).astype(np.int64), 0, source - 1)


def resize_depth(depth: npt.NDArray[Any], width: int, height: int) -> npt.NDArray[Any]:
    """Resize a depth image (H, W) by its nearest pixel, so that no depth is invented at an edge.

    A new pixel's centre c looks at the old pixel nearest to (c + 0.5) / s - 0.5; the intrinsics
    follow with :meth:`Intrinsics.resized`.
    """
    if width < 1 or height < 1:
        raise ValueError(f"target size must be positive, got {width}x{height}")
    return depth[np.ix_(_nearest(height, depth.shape[0]), _nearest(width, depth.shape[1]))]


def resize_mask(mask: BoolArray, width: int, height: int) -> BoolArray:
    """Resize a mask by its nearest pixel, with the same pixels as :func:`resize_depth`."""
    return np.asarray(resize_depth(mask, width, height), dtype=bool)
