"""Restoration without learning: the questions to ask every table first.

Each method takes z-depth in metres, shape (H, W), 0 or NaN where missing, and the pixels to
restore, a mask (H, W) bool, and returns depth of the same form with 0 where missing. Only the
mask's pixels change, and what was measured inside the mask is never used: it is what the camera got
wrong. Where shapes differ, a `ValueError` says so.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hadr.camera import BoolArray, FloatArray, Intrinsics, project, valid_depth, window_around

SLACK_M = 0.06
"""How far the skin may be from the keypoints' depths, metres."""


def raw(depth: FloatArray, mask: BoolArray) -> NDArray[np.float32]:
    """Leave the depth as it is, NaN replaced by 0: the least that a method must beat. A copy."""
    if depth.ndim != 2 or mask.shape != depth.shape or mask.dtype != np.bool_:
        raise ValueError(
            "depth must be (H, W) metres and mask (H, W) bool, got "
            f"{depth.shape} {depth.dtype} and {mask.shape} {mask.dtype}"
        )
    return np.where(valid_depth(depth), depth, 0.0).astype(np.float32)


def nearest_valid(depth: FloatArray, mask: BoolArray) -> FloatArray:
    """Give every pixel of the mask the depth of the nearest measured pixel outside of it.

    Raises:
        ValueError: No pixel outside the mask has depth.
    """
    restored = raw(depth, mask)
    source = (restored > 0) & ~mask
    _check_source(source)
    _, (rows, columns) = ndimage.distance_transform_edt(~source, return_indices=True)
    restored[mask] = restored[rows[mask], columns[mask]]
    return restored


def inpaint(depth: FloatArray, mask: BoolArray) -> FloatArray:
    """Fill the mask with OpenCV's inpainting (Telea's fast marching), each pixel from 3 around it.

    OpenCV overshoots on float images, so the depth goes in as 16-bit steps of 0.1 mm (1 mm where
    the scene is deeper than 6.5 m). Missing pixels around the mask are filled along with it, so
    that their zeros do not bleed in, and are missing again afterwards.

    Raises:
        ValueError: No pixel outside the mask has depth.
    """
    restored = raw(depth, mask)
    _check_source((restored > 0) & ~mask)
    if not mask.any():
        return restored
    # The part of the image that matters: the mask's box with some depth around it.
    margin = 24
    window = window_around(mask, margin)
    while margin <= max(mask.shape) and not ((restored[window] > 0) & ~mask[window]).any():
        margin *= 2
        window = window_around(mask, margin)
    piece, hole = restored[window], mask[window]
    deepest = float(piece.max())
    step_m = 1e-4 if deepest < 65535 * 1e-4 else 1e-3
    if deepest >= 65535 * step_m:
        raise ValueError(f"depth must be below 65.5 m for inpainting, got {deepest:.1f} m")
    steps = np.rint(piece / step_m).astype(np.uint16)
    unknown = (hole | (piece <= 0)).astype(np.uint8)
    filled = cv2.inpaint(steps, unknown, 3.0, cv2.INPAINT_TELEA)
    piece[hole] = filled[hole].astype(np.float32) * np.float32(step_m)
    return restored


def hand_region(shape: tuple[int, int], keypoints_uv: NDArray[np.floating]) -> BoolArray:
    """Mark the convex hull of keypoints (21, 2), pixels (column, row): no forearm.

    Raises:
        ValueError: The keypoints are not (21, 2) finite numbers.
    """
    if keypoints_uv.shape != (21, 2) or not np.isfinite(keypoints_uv).all():
        raise ValueError(
            f"keypoints_uv must be (21, 2) finite pixels, got shape {keypoints_uv.shape}"
        )
    limit = 8 * max(shape)  # OpenCV draws with 16-bit fixed point; far outside is outside
    hull = cv2.convexHull(np.clip(np.rint(keypoints_uv), -limit, limit).astype(np.int32))
    region = np.zeros(shape, np.uint8)
    cv2.fillConvexPoly(region, hull, 1)
    return region.astype(bool)


def hand_median(
    depth: FloatArray,
    mask: BoolArray,
    keypoints_uv: NDArray[np.floating],
    keypoints_z: NDArray[np.floating],
    hand_mask: BoolArray | None = None,
) -> FloatArray:
    """Give the whole mask one depth: the median depth of the hand without the forearm.

    The hand's pixels are those with a measured depth outside the object's mask that lie in the
    convex hull of the keypoints and, where a hand mask is known, in it; without one, those whose
    depth is within `SLACK_M` of the keypoints' range. Where no pixel is left, the keypoints' own
    median depth is taken. Keypoints are pixels (column, row), (21, 2), and z-depth in metres,
    (21,); the hand mask, (H, W) bool, is of hand and arm.
    """
    restored = raw(depth, mask)
    region = hand_region((depth.shape[0], depth.shape[1]), keypoints_uv)
    if hand_mask is not None:
        if hand_mask.shape != depth.shape:
            raise ValueError(
                f"hand_mask must have depth's shape {depth.shape}, got {hand_mask.shape}"
            )
        region &= hand_mask
    else:
        near, far = keypoints_z.min() - SLACK_M, keypoints_z.max() + SLACK_M
        region &= (restored > near) & (restored < far)
    hand = restored[region & ~mask & (restored > 0)]
    restored[mask] = np.median(hand) if hand.size else np.median(keypoints_z)
    return restored


def fill(
    method: str,
    depth: FloatArray,
    mask: BoolArray,
    camera: Intrinsics,
    keypoints: NDArray[np.float64] | None,
    hand_mask: BoolArray | None,
) -> FloatArray:
    """Fill the mask with a method by its name: nearest, inpaint or hand-median.

    From z-depth in metres, keypoints (21, 3) in the camera frame, and the hand's mask, if they are
    known; ValueError where the method needs keypoints and there are none, or no pixel has depth.
    """
    if method == "nearest":
        return nearest_valid(depth, mask)
    if method == "inpaint":
        return inpaint(depth, mask)
    if keypoints is None:
        raise ValueError("method hand-median needs 21 hand keypoints (21, 3), got none")
    return hand_median(depth, mask, project(keypoints, camera), keypoints[:, 2], hand_mask)


def _check_source(source: BoolArray) -> None:
    if not source.any():
        raise ValueError("no pixel outside the mask has a depth, so there is nothing to fill from")
