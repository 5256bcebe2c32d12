"""What networks take: frames as tensors; the way there from one frame, and back to its size."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from scipy import ndimage
from torch import Tensor

from hadr.camera import (
    BoolArray,
    FloatArray,
    Intrinsics,
    project,
    resize_color,
    resize_depth,
    resize_mask,
    valid_depth,
)
from hadr.hand import check_keypoints


@dataclass(frozen=True)
class HADRInput:
    """A batch of frames of one size.

    Attributes:
        color: sRGB in 0..1, shape (B, 3, H, W); many frames at once are kept as bytes in 0..255,
            which `take` turns into floats.
        depth: Corrupted z-depth in metres, shape (B, H, W); 0 = missing.
        mask: Pixels to restore, shape (B, H, W), bool.
        intrinsics: fx, fy, cx, cy in pixels of this size, shape (B, 4).
        keypoints: Hand keypoints in metres, camera frame, shape (B, 21, 3); zeros if unknown.
        keypoints_uv: The same as pixels (column, row), shape (B, 21, 2); zeros if unknown.
    """

    color: Tensor
    depth: Tensor
    mask: Tensor
    intrinsics: Tensor
    keypoints: Tensor
    keypoints_uv: Tensor

    def __len__(self) -> int:
        """Give the number of frames."""
        return int(self.color.shape[0])

    def take(self, frames: Tensor | slice) -> HADRInput:
        """Give the batch of some frames, by their indices; its colour is in 0..1."""
        chosen = {f.name: getattr(self, f.name)[frames] for f in fields(self)}
        return HADRInput(**chosen | {"color": float_color(chosen["color"])})

    def to(self, device: torch.device | str) -> HADRInput:
        """Give the batch on another device."""
        return HADRInput(**{f.name: getattr(self, f.name).to(device) for f in fields(self)})


@dataclass(frozen=True)
class DepthOutput:
    """What every network that restores depth gives for a batch; most give more.

    Attributes:
        depth: Restored z-depth in metres, shape (B, H, W); 0 where nothing was restored.
        restored: Where depth was restored, shape (B, H, W), bool.
    """

    depth: Tensor
    restored: Tensor


@dataclass(frozen=True)
class ImageOutput(DepthOutput):
    """The same of a network that answers for the whole `image`, z-depth in metres, (B, H, W)."""

    image: Tensor


def float_color(color: Tensor) -> Tensor:
    """Turn colour bytes into sRGB in 0..1, float32; floats stay as they are."""
    return color.float() / 255 if color.dtype == torch.uint8 else color


def frame_to_input(
    color: npt.NDArray[np.uint8],
    depth: FloatArray,
    mask: BoolArray,
    keypoints: npt.ArrayLike | None,
    camera: Intrinsics,
    size: tuple[int, int],
) -> HADRInput:
    """Bring one frame to the network's size (width, height), pixels, and form: a batch of one.

    Colour, RGB (H, W, 3) uint8, is resized by area, corrupted z-depth, metres, (H, W), 0 or NaN =
    missing, and mask, (H, W) bool, by their nearest pixel, and the intrinsics, of an image of
    exactly this size, follow. A frame of another shape than `size` is squashed: fx and fy then
    change by different factors, and the geometry stays exact (ledger, row 12). Keypoints are in the
    camera frame, metres, (21, 3), or None; their pixels are computed from them. ValueError where
    shapes or types differ from these, or keypoints hold NaN.
    """
    if color.shape != (*camera.shape, 3) or color.dtype != np.uint8:
        raise ValueError(
            f"color must be {(*camera.shape, 3)} uint8, got {color.shape} {color.dtype}"
        )
    for name, image in (("depth", depth), ("mask", mask)):
        if image.shape != camera.shape:
            raise ValueError(f"{name} must be {camera.shape} as the intrinsics, got {image.shape}")
    width, height = size
    resized = camera.resized(width, height)
    points, uv = np.zeros((21, 3)), np.zeros((21, 2))
    if keypoints is not None:
        points = check_keypoints(keypoints)
        uv = np.nan_to_num(project(points, resized))
    small = resize_depth(depth, width, height)
    return HADRInput(
        color=_batch_of_one(resize_color(color, width, height) / 255).permute(0, 3, 1, 2),
        depth=_batch_of_one(np.where(valid_depth(small), small, 0)),
        mask=torch.from_numpy(resize_mask(mask, width, height).copy())[None],
        intrinsics=_batch_of_one(np.array([resized.fx, resized.fy, resized.cx, resized.cy])),
        keypoints=_batch_of_one(points),
        keypoints_uv=_batch_of_one(uv),
    )


def masked_rays(mask: Tensor, stride: int = 1, row_start: int = 0, column_start: int = 0) -> Tensor:
    """List the pixels of a mask (B, H, W), or those of every n-th row and column from a first one.

    Gives rows (frame, row, column), shape (R, 3), long, in raster order.
    """
    kept = mask[:, row_start::stride, column_start::stride].nonzero()
    scale = kept.new_tensor([1, stride, stride])
    return kept * scale + kept.new_tensor([0, row_start, column_start])


def ray_points(pixels: Tensor, depth: Tensor, intrinsics: Tensor) -> Tensor:
    """Lift pixels (frame, row, column), (N, 3), of z-depth (N,) to points (N, 3), camera frame.

    In metres; the intrinsics are fx, fy, cx, cy of each frame, shape (B, 4).
    """
    fx, fy, cx, cy = intrinsics.index_select(0, pixels[:, 0]).unbind(dim=1)
    x = (pixels[:, 2] - cx) / fx
    y = (pixels[:, 1] - cy) / fy
    return torch.stack((x * depth, y * depth, depth), dim=1)


def enlarge_restored(
    values: FloatArray,
    known: BoolArray,
    asked: BoolArray,
    shape: tuple[int, ...],
    window: tuple[slice, slice] | None = None,
) -> tuple[npt.NDArray[np.float32], BoolArray]:
    """Enlarge images, and the answer to the question where they hold something.

    Values are bilinear between the known pixels (unknown ones get no weight), and those of the
    nearest known pixel where all four neighbours are unknown. A pixel of the result counts as
    restored where the nearest of the small pixels that were asked for is known: so beyond the
    mask's rim the neighbour inside of it decides, and a hole within the mask stays a hole.

    From K images (K, h, w) and which pixels were restored, and were to be, (h, w) bool each, to
    images (K, H, W) float32, zeros where nothing is known at all, and where they hold a restored
    value, (H, W) bool; of these only the rows and columns of the window, if there is one.
    """
    rows, columns = window or (slice(0, shape[0]), slice(0, shape[1]))
    top, bottom, down = _neighbours(shape[0], known.shape[0], rows)
    left, right, across = _neighbours(shape[1], known.shape[1], columns)
    size = (len(top), len(left))
    if not known.any():
        return np.zeros((len(values), *size), np.float32), np.zeros(size, bool)

    stack = np.concatenate((np.where(known, values, 0), known[None])).astype(np.float32)
    tall = stack[:, top] * (1 - down[:, None]) + stack[:, bottom] * down[:, None]  # (K + 1, H, w)
    wide = tall[:, :, left] * (1 - across) + tall[:, :, right] * across  # (K + 1, H, W)
    total, weight = wide[:-1], wide[-1]

    pixel = np.ix_(np.where(down < 0.5, top, bottom), np.where(across < 0.5, left, right))
    _, near = ndimage.distance_transform_edt(~known, return_indices=True)
    nearest = stack[:-1, near[0][pixel], near[1][pixel]]
    _, asker = ndimage.distance_transform_edt(~(asked | known), return_indices=True)
    restored: BoolArray = known[asker[0][pixel], asker[1][pixel]]
    images = np.where(weight > 1e-3, total / np.maximum(weight, 1e-3), nearest)
    return images.astype(np.float32), restored


def _neighbours(
    target: int, source: int, wanted: slice
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.float32]]:
    """Both pixels between which those of a resized line lie, and the second's weight."""
    centre = (np.arange(target)[wanted] + 0.5) * source / target - 0.5
    first = np.floor(centre).astype(np.int64)
    part = (centre - first).astype(np.float32)
    return first.clip(0, source - 1), (first + 1).clip(0, source - 1), part


def _batch_of_one(values: npt.NDArray[Any]) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(values, dtype=np.float32))[None]
