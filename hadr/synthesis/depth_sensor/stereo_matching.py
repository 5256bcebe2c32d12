"""From two infrared pictures to a depth image: matching, checks, filters, alignment to colour."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from hadr.camera import Intrinsics

Float = npt.NDArray[np.float32]
Picture = npt.NDArray[np.uint8]

#: Parts of a pixel in which disparity is reported.
STEPS = 32


@dataclass(frozen=True)
class Matching:
    """How the matcher works and what it refuses.

    Args:
        block: Side of the matching window, pixels, odd.
        disparities: How many disparities are searched, a multiple of 16.
        uniqueness: How much worse than the best match, in percent, every other one must be.
        left_right: Largest difference of the two directions' disparities, pixels.
        window: Standard deviation of the window of sub-pixel matching, pixels.
        iterations: Its steps; 0 leaves the disparity as the semi-global matcher found it.
        likeness: Least normalised cross-correlation (NCC) of the two matched windows, -1..1.
        texture: Least root mean square of the horizontal gradient in it, grey values a pixel.
        jump: Disparity step that counts as an edge, pixels.
        edge: Pixels on both sides of such an edge that are refused, 0 or more.
        speckle: Isolated patches of fewer pixels are refused.
        median: Side of the median filter, 3 or 5.
    """

    block: int = 7
    disparities: int = 128
    uniqueness: int = 12
    left_right: int = 1
    window: float = 2.2
    iterations: int = 3
    likeness: float = 0.75
    texture: float = 2.0
    jump: float = 2.5
    edge: int = 1
    speckle: int = 60
    median: int = 5


def match(left: Picture, right: Picture, how: Matching) -> Float:
    """Find the disparity of every pixel of the left picture by semi-global matching.

    Both are rectified grey pictures, (H, W) uint8. Disparity in pixels, (H, W) float32, in steps of
    1/32; 0 where there is none.

    Raises:
        ValueError: The pictures differ in shape or are no grey pictures of 8 bits.
    """
    grey = left.dtype == right.dtype == np.uint8
    if left.shape != right.shape or left.ndim != 2 or not grey:
        raise ValueError(
            f"left and right must be (H, W) uint8 of one shape, got {left.shape} {left.dtype} and "
            f"{right.shape} {right.dtype}"
        )
    matcher = cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=how.disparities,
        blockSize=how.block,
        P1=8 * how.block**2,
        P2=32 * how.block**2,
        disp12MaxDiff=how.left_right,
        preFilterCap=31,
        uniquenessRatio=how.uniqueness,
        speckleWindowSize=0,
        speckleRange=0,
        mode=cv2.STEREO_SGBM_MODE_SGBM,
    )
    found = np.asarray(matcher.compute(left, right))
    found = np.where(found > 0, found, 0).astype(np.int16)
    disparity, sure = _refine(left, right, (found / 16).astype(np.float32), how)
    found = np.where(sure, np.rint(disparity * STEPS), 0).astype(np.int16)
    found = _without_edges(found, how)
    cv2.filterSpeckles(found, 0, how.speckle, STEPS)
    smooth = cv2.medianBlur(found, how.median)
    found = np.where((found > 0) & (smooth > 0), smooth, 0).astype(np.int16)
    return np.asarray(found / np.float32(STEPS), dtype=np.float32)


def _refine(
    left: Picture, right: Picture, disparity: Float, how: Matching
) -> tuple[Float, npt.NDArray[np.bool_]]:
    """Sub-pixel disparity by least squares in a window (Gauss-Newton), and where to trust it."""
    # A semi-global matcher's own parabola is drawn to whole pixels; this is not.
    first = _without_mean(left)
    second = _without_mean(right)
    slope = cv2.Sobel(second, cv2.CV_32F, 1, 0, ksize=1, scale=0.5)
    height, width = left.shape
    v, u = np.mgrid[0:height, 0:width].astype(np.float32)
    known = (disparity > 0).astype(np.float32)

    def window(image: Float) -> Float:
        return np.asarray(cv2.GaussianBlur(image * known, (0, 0), how.window), dtype=np.float32)

    refined = disparity.copy()
    rise = cv2.remap(slope, u - refined, v, cv2.INTER_LINEAR)  # for `strong`, without iterations
    for _ in range(how.iterations):
        there = cv2.remap(second, u - refined, v, cv2.INTER_CUBIC)
        rise = cv2.remap(slope, u - refined, v, cv2.INTER_LINEAR)
        change = window(rise * (there - first)) / (window(rise * rise) + 1.0)
        refined = (refined + np.clip(change, -0.5, 0.5) * known).astype(np.float32)
    there = cv2.remap(second, u - refined, v, cv2.INTER_CUBIC)
    left_power, right_power = window(first * first), window(there * there)
    ncc = window(first * there) / np.sqrt(left_power * right_power + 1e-6)
    sure = (disparity > 0) & (refined > 0.5) & (np.abs(refined - disparity) < 1.0)
    strong = window(rise * rise) > how.texture**2 * np.maximum(window(np.ones_like(first)), 1e-6)
    return refined, sure & (ncc > how.likeness) & strong


def _without_mean(picture: Picture) -> Float:
    grey = picture.astype(np.float32)
    return np.asarray(grey - cv2.GaussianBlur(grey, (0, 0), 6.0), dtype=np.float32)


def _without_edges(found: npt.NDArray[np.int16], how: Matching) -> npt.NDArray[np.int16]:
    """Refuse what lies beside a disparity step or beside a gap."""
    square = np.ones((3, 3), np.uint8)
    near = cv2.dilate(found, square)
    far = cv2.erode(np.where(found > 0, found, np.int16(32767)), square)
    step = (found > 0) & (near - far > round(STEPS * how.jump))
    gap = cv2.morphologyEx((found == 0).astype(np.uint8), cv2.MORPH_OPEN, square)
    size = 2 * how.edge + 1
    bad = cv2.dilate(step.astype(np.uint8) | gap, np.ones((size, size), np.uint8))
    return np.where(bad > 0, np.int16(0), found)


def align_to_color(depth: Float, imager: Intrinsics, color: Intrinsics, imager_x: float) -> Float:
    """Look at a depth image (metres, 0 missing) from the colour camera, nearest surface first.

    Each depth pixel is a small square; colour pixels whose centres it covers take its depth. What
    the imager, ``imager_x`` metres to the right, could not see stays empty: the occlusion shadow.
    """
    rows, columns = np.nonzero(depth > 0)
    z = depth[rows, columns].astype(float)
    half = 0.55  # a little overlap: neighbours at other depths leave no gaps

    def edge(pixel: npt.NDArray[np.float64], side: float) -> npt.NDArray[np.float64]:
        x = (pixel + side - imager.cx) / imager.fx * z + imager_x
        return np.asarray(color.fx * x / z + color.cx)

    left, right = edge(columns.astype(float), -half), edge(columns.astype(float), half)
    scale = color.fy / imager.fy
    top = (rows - half - imager.cy) * scale + color.cy
    bottom = (rows + half - imager.cy) * scale + color.cy
    u0, u1 = np.ceil(left).astype(int), np.floor(right).astype(int)
    v0, v1 = np.ceil(top).astype(int), np.floor(bottom).astype(int)
    wide = int(max((u1 - u0).max(initial=-1), 0)) + 1
    tall = int(max((v1 - v0).max(initial=-1), 0)) + 1
    nearest = np.full(color.height * color.width, np.inf)
    for dv in range(tall):
        for du in range(wide):
            u, v = u0 + du, v0 + dv
            inside = (u <= u1) & (v <= v1) & (u >= 0) & (v >= 0)
            inside &= (u < color.width) & (v < color.height)
            at = v[inside] * color.width + u[inside]
            np.minimum.at(nearest, at, z[inside])
    aligned = np.where(np.isfinite(nearest), nearest, 0.0)
    return aligned.reshape(color.shape).astype(np.float32)
