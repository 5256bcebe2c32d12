"""Is this a usable RGB-D frame? One clear sentence for each way in which it is not.

What can be mended without guessing (NaN, infinity) is mended and written into `notes`; the rest
raises a ValueError that names the value and what is expected.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hadr.camera import BoolArray, FloatArray, Intrinsics, project
from hadr.corruption import CORRUPTIONS, Corruption

DEEPEST_MEDIAN_M = 20.0
NEAREST_MEDIAN_M = 0.02
FARTHEST_M = 30.0
"""Where more is measured, a number stands for "missing"."""
LEAST_CONTRAST = 16
"""Between the darkest and the brightest hundredth of a picture's values, of 255; the bundled frames
have 78 and more."""
SQUARE = 0.03
"""How far from square a calibrated camera's pixels may seem."""
OFF_CENTER = 0.15
"""How far from a picture's middle the optical axis may pass, of its width or height: a few
hundredths for a whole picture, more for a part cut out of one."""
SEES_DEG = (40, 125)
"""Angle across a depth camera's picture: 55 to 90 degrees for most, 120 for the widest."""
LARGEST_MASK = 0.75
"""Share of the picture that glass may cover; what covers more is an inverted mask."""
LEAST_WARM = 0.1
"""Logarithm of red over blue on a hand's skin, which of any kind is redder than blue."""
SAME_SKIN = 0.25
"""How far from the median colour a hand's skin may be, in logarithms of the colours' ratios."""
LEAST_SKIN = (0.9, 0.85)
"""Shares of a hand's pixels that are so warm, and of one colour: 1 to 2 of 100 training and
validation frames have less, and 80 of 100 pictures to which depth and hand do not belong."""
FEW_PIXELS = 15
"""Of fewer points on the hand nothing is said of its colour."""
SKIN_M = (-0.02, 0.04)
"""A bone lies so far behind the depth measured at its pixel, metres."""
GLASS_M = (0.025, 0.30)
"""How large a glass is, the root of its area; those of the bundled training frames seem 5.0 to 10.0
cm, so that a depth in decimetres or centimetres lies outside."""


def checked_depth(
    color: NDArray[np.uint8], depth: FloatArray, camera: Intrinsics, notes: list[str]
) -> NDArray[np.float32]:
    """Check colour, depth (H, W) and camera against each other: the depth, 0 where missing."""
    if color.ndim != 3 or color.shape[2] != 3 or color.dtype != np.uint8:
        raise ValueError(f"colour must be (H, W, 3) uint8 RGB, got {color.shape} {color.dtype}")
    if depth.ndim != 2 or depth.dtype.kind != "f":
        raise ValueError(f"depth must be (H, W) float metres, got {depth.shape} {depth.dtype}")
    if depth.shape != color.shape[:2]:
        raise ValueError(
            f"depth is {_size(depth.shape)} pixels but colour is {_size(color.shape)}; "
            "expected the same size (depth aligned to colour)"
        )
    if depth.shape != camera.shape:
        raise ValueError(
            f"the intrinsics are of a {camera.width}x{camera.height} image but colour and depth "
            f"are {_size(depth.shape)}; expected intrinsics of the same size"
        )
    note_camera(camera, notes)
    dark, bright = np.percentile(color[::4, ::4], (1, 99))
    if bright - dark < LEAST_CONTRAST:
        notes.append(
            f"the colour picture shows nothing (98 % of its values lie between {dark:.0f} and "
            f"{bright:.0f} of 255): what is found in it, or restored from it, means nothing; was "
            "the lens covered, or the light off?"
        )
    for name, odd in (("NaN", np.isnan(depth)), ("infinite", np.isinf(depth))):
        if odd.any():
            notes.append(f"{int(odd.sum())} pixels of the depth are {name} and count as missing")
    return checked_metres("depth", depth)


def note_camera(camera: Intrinsics, notes: list[str]) -> None:
    """Say if a camera with these numbers would be an odd one: a file's numbers may be swapped."""
    odd = []
    if abs((stretched := camera.fy / camera.fx) - 1) > SQUARE:
        odd.append(f"its pixels would not be square (fy is {stretched:.2f} times fx)")
    for name, middle, length in (("cx", camera.cx, camera.width), ("cy", camera.cy, camera.height)):
        if abs(share := (middle + 0.5) / length - 0.5) > OFF_CENTER:
            odd.append(f"{name} = {middle:g} is {100 * abs(share):.0f} % of the picture off center")
    angle = 2 * math.degrees(math.atan(camera.width / camera.fx / 2))
    if not SEES_DEG[0] <= angle <= SEES_DEG[1]:
        odd.append(
            f"it would see {angle:.0f} degrees across, expected {SEES_DEG[0]} to {SEES_DEG[1]}"
        )
    if odd:
        notes.append(
            f"the intrinsics are of an odd camera: {'; '.join(odd)}; are they of this picture, at "
            "this size, and is each number in its place?"
        )


def checked_metres(name: str, depth: FloatArray) -> NDArray[np.float32]:
    """Check that a depth image (H, W) can be one in metres: itself, 0 where not finite."""
    clean = np.where(np.isfinite(depth), depth, 0).astype(np.float32)
    if (clean < 0).any():
        raise ValueError(
            f"{name} must not be negative, got {float(clean.min()):g} m in "
            f"{int((clean < 0).sum())} pixels; expected z-depth in metres, 0 where missing"
        )
    valid = clean > 0
    if not valid.any():
        raise ValueError(
            f"{name} is missing everywhere: all {clean.size} pixels are 0, NaN or infinite, "
            "expected z-depth in metres"
        )
    # The median lies beyond a limit where more than half of the pixels do; counting is faster.
    half = np.count_nonzero(valid) / 2
    too_deep = np.count_nonzero(clean > DEEPEST_MEDIAN_M) > half
    too_near = np.count_nonzero(valid & (clean < NEAREST_MEDIAN_M)) > half
    if too_deep or too_near:
        median = float(np.median(clean[valid]))
        factor = 10 ** abs(round(np.log10(median)))
        nearer, than = (median / factor, "smaller") if too_deep else (median * factor, "larger")
        raise ValueError(
            f"{name} has a median of {median:g}, expected metres between {NEAREST_MEDIAN_M:g} and "
            f"{DEEPEST_MEDIAN_M:g}; it would be {nearer:.3g} m with a scale {factor} times {than} "
            "(on the command line: --depth-scale), if it is depth and no disparity"
        )
    if far := int((clean > FARTHEST_M).sum()):
        raise ValueError(
            f"{name} is beyond {FARTHEST_M:g} m in {far} pixels (up to {float(clean.max()):g} m); "
            "expected z-depth in metres, and 0, NaN or infinity where it is missing"
        )
    return clean


def checked_mask(mask: BoolArray | None, clean: NDArray[np.float32], notes: list[str]) -> BoolArray:
    """Check the mask (H, W) bool, or take the pixels without depth where there is none."""
    if mask is None:
        target = clean <= 0
        notes.append(
            f"no mask given: the {int(target.sum())} pixels without depth are restored, wherever "
            "they lie; wrong depth seen through the glass stays"
        )
        return target
    check_mask_form("mask", mask, clean)
    if not mask.any():
        raise ValueError(
            f"the mask is empty: none of its {mask.size} pixels is set, expected the transparent "
            "object's pixels"
        )
    if (share := float(mask.mean())) > LARGEST_MASK:
        raise ValueError(
            f"the mask covers {100 * share:.0f} % of the picture, expected a glass: is it "
            "inverted? What is not 0 is restored"
        )
    return mask


def told_color(
    color: NDArray[np.uint8],
    depth: FloatArray,
    camera: Intrinsics,
    mask: BoolArray,
    keypoints: FloatArray,
) -> tuple[str, ...]:
    """Say if the picture does not show skin where the hand is measured.

    Looked at are points along the bones of the hand, keypoints (21, 3), at which depth (H, W) in
    metres agrees, outside of the mask. Colour (H, W, 3) is RGB.
    """
    from hadr.hand import BONES

    start, end = keypoints[np.array(BONES)].transpose(1, 0, 2)[:, :, None]
    points = (start + (end - start) * np.linspace(0, 1, 9)[:, None]).reshape(-1, 3)
    columns, rows = np.rint(project(points, camera)).astype(int).T
    there = (columns >= 0) & (columns < camera.width) & (rows >= 0) & (rows < camera.height)
    rows, columns, away = rows[there], columns[there], points[there, 2]
    behind = away - depth[rows, columns]
    seen = (behind > SKIN_M[0]) & (behind < SKIN_M[1]) & ~mask[rows, columns]
    if seen.sum() < FEW_PIXELS:
        return ()
    red, green, blue = np.log(color[rows[seen], columns[seen]].T + 4.0)  # dark pixels are noisy
    warm, greenish = red - blue, 2 * green - red - blue
    off = np.hypot(warm - np.median(warm), greenish - np.median(greenish))
    shares = float((warm >= LEAST_WARM).mean()), float((off < SAME_SKIN).mean())
    kinds = zip(("redder than blue, as skin is,", "of one colour"), shares, LEAST_SKIN, strict=True)
    too_few = [
        f"only {int(100 * share)} % of the picture is {kind} (expected {100 * least:.0f})"
        for kind, share, least in kinds
        if share < least
    ]
    if not too_few:
        return ()
    return (
        f"where the hand is, {' and '.join(too_few)}: is the picture of another moment than depth "
        "and hand, is it gray, are red and blue swapped, or is there no hand?",
    )


def depth_to_use(
    depth: NDArray[np.float32], mask: BoolArray, corruption: Corruption
) -> NDArray[np.float32]:
    """Erase z-depth that was measured in the mask, if this corruption does: 0 = missing."""
    return np.where(mask, np.float32(0), depth) if CORRUPTIONS[corruption].erase else depth


def note_measured(
    depth: NDArray[np.float32],
    mask: BoolArray,
    corruption: Corruption,
    skipped_by: str | None,
    notes: list[str],
) -> None:
    """Say what becomes of depth that was measured inside the mask, which a network may skip."""
    measured = int((mask & (depth > 0)).sum())
    if CORRUPTIONS[corruption].erase:
        fate = "not trusted and was erased"
    else:
        fate = f"not used: {skipped_by} looks at none there" if skipped_by else "trusted"
    if measured:
        notes.append(
            f"{measured} of the mask's {int(mask.sum())} pixels had a measured depth; it is {fate}"
        )


def note_size(
    mask: BoolArray, depth: NDArray[np.float32], camera: Intrinsics, notes: list[str]
) -> None:
    """Say if a glass of the mask's pixels, as near as what is nearest around it, can't be one."""
    side = float(np.sqrt(mask.sum()))
    reach = max(2, round(0.2 * side))
    ring = ndimage.maximum_filter(mask, 2 * reach + 1) & ~mask & (depth > 0)
    if not ring.any():
        return
    away = float(np.percentile(depth[ring], 5))
    size = side * away / np.sqrt(camera.fx * camera.fy)
    if not GLASS_M[0] <= size <= GLASS_M[1]:
        notes.append(
            f"the glass would measure {100 * size:.2g} cm, if it is as near as what was measured "
            f"around it ({away:.3g} m); expected {100 * GLASS_M[0]:g} to {100 * GLASS_M[1]:g} cm: "
            "is the depth in metres (on the command line: --depth-scale), are intrinsics and mask "
            "of this picture?"
        )


def check_mask_form(name: str, mask: BoolArray, clean: NDArray[np.float32]) -> None:
    """Raise a ValueError unless the mask is (H, W) bool of the depth's size."""
    if mask.dtype != np.bool_ or mask.ndim != 2:
        raise ValueError(f"{name} must be (H, W) bool, got {mask.shape} {mask.dtype}")
    if mask.shape != clean.shape:
        raise ValueError(
            f"{name} is {_size(mask.shape)} pixels but depth is {_size(clean.shape)}; "
            "expected the same size"
        )


def check_apart(mask: BoolArray | None, hand_mask: BoolArray) -> None:
    """Raise a ValueError if the object's mask, (H, W) bool, is mostly the hand's."""
    if mask is not None and mask.shape == hand_mask.shape:
        both, size = int((mask & hand_mask).sum()), int(mask.sum())
        if both > size / 2:
            raise ValueError(
                f"mask and hand mask share {both} of the mask's {size} pixels, expected the "
                "transparent object in the one and hand and arm in the other"
            )


def checked_hand(
    keypoints: NDArray[np.floating], camera: Intrinsics, notes: list[str]
) -> NDArray[np.float64]:
    """Check the hand keypoints, (21, 3), metres: finite, in front, and of a hand's size."""
    from hadr.hand import KEYPOINT_NAMES, check_keypoints

    hand = check_keypoints(keypoints)
    worst = int(np.argmin(hand[:, 2]))
    if hand.max() > DEEPEST_MEDIAN_M:
        raise ValueError(
            f"a hand keypoint has a coordinate of {hand.max():g} m, expected at most "
            f"{DEEPEST_MEDIAN_M:g}; are the keypoints in metres?"
        )
    if hand[worst, 2] <= 0:
        raise ValueError(
            f"hand keypoint {worst} ({KEYPOINT_NAMES[worst]}) has z = {hand[worst, 2]:g} m, "
            "expected every keypoint in front of the camera (camera frame, z > 0)"
        )
    extent = float(np.linalg.norm(hand - hand[0], axis=1).max())
    if not 0.02 < extent < 0.5:
        raise ValueError(
            f"the hand's farthest keypoint is {extent:g} m from the wrist, expected 0.02 to 0.5; "
            "are the keypoints in metres?"
        )
    uv = project(hand, camera)
    inside = (np.abs((uv + 0.5) / (camera.width, camera.height) - 0.5) <= 0.5).all(axis=1)
    if not inside.any():
        notes.append(
            "all 21 hand keypoints project outside of the image; are they in this camera's frame?"
        )
    return hand


def _size(shape: tuple[int, ...]) -> str:
    return f"{shape[1]}x{shape[0]}"
