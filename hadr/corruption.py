"""How depth goes wrong: analytic models of what an RGB-D camera does to glass.

Every model takes z-depth in metres, shape (H, W), 0 where missing, and returns a corrupted copy of
the same form. A mask, (H, W) bool, marks the pixels of the transparent object. All randomness comes
from the generator `rng`, so the same seed gives the same picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hadr.camera import BoolArray, FloatArray, Intrinsics, valid_depth


@dataclass(frozen=True)
class CorruptionConfig:
    """Which models `corrupt` applies; it does so in the order in which the light meets them.

    Attributes:
        erase: Oracle: every pixel of the true object mask is missing (ledger, row 8); comes last.
        see_through: Inside the mask the depth is missing or the background's.
        stereo: Disparity noise and quantisation of a stereo camera.
        edges: Flying pixels and shifted outlines at depth jumps.
        captured: Start from the depth that a camera, real or simulated, has measured, and not
            from the true one (see `hadr.synthesis.depth_sensor.depth_camera`).
    """

    erase: bool = True
    see_through: bool = False
    stereo: bool = False
    edges: bool = False
    captured: bool = False


MISSING_SHARE, BACKGROUND_SHARE = 0.60, 0.31
"""Shares of a glass's mask without depth, and with the background's: the mean of two real D435
frames of ClearGrasp, each counting once. Of the pixels inside the mask whose true depth is known,
45.4 % and 74.6 % are missing, 46.8 % and 15.6 % lie more than 1 cm behind the surface."""

#: No depth in the object's mask, as the published experiments have it.
ORACLE = CorruptionConfig()
#: A stereo camera imitated by formulas: patches, disparity noise, frayed outlines.
ANALYTIC = CorruptionConfig(erase=False, see_through=True, stereo=True, edges=True)
#: What a depth camera measured, taken as it is.
SENSOR = CorruptionConfig(erase=False, captured=True)
#: The same with the depth in the object's mask erased.
ERASED = CorruptionConfig(erase=True, captured=True)

Corruption = Literal["oracle", "analytic", "sensor", "erased"]
CORRUPTIONS: dict[Corruption, CorruptionConfig] = {
    "oracle": ORACLE,
    "analytic": ANALYTIC,
    "sensor": SENSOR,
    "erased": ERASED,
}
"""Those that networks are trained with, by their name in recipes, checkpoints and commands. Where
one does not `erase`, a network so trained is given the measured depth in the mask."""


def erase_mask(depth: FloatArray, mask: BoolArray) -> FloatArray:
    """Erase every pixel of the mask: the oracle corruption of the paper's experiments."""
    _check_images(depth, mask, "mask")
    return np.where(mask, np.float32(0), depth).astype(np.float32)


def ellipse_dropout(
    depth: FloatArray,
    mask: BoolArray | None,
    rng: np.random.Generator,
    *,
    probability: float = 0.8,
    mean_count: float = 20.0,
    radius_shape: float = 10.0,
    radius_scale: float = 1.0,
) -> FloatArray:
    """Drop depth inside random ellipses, the augmentation that LIDF trains with.

    With `probability` the image gets Poisson(`mean_count`) ellipses with radii of
    Gamma(`radius_shape`, `radius_scale`) pixels and any tilt; the defaults are LIDF's. They start
    and erase in the mask, or wherever there is depth.
    """
    eligible = depth > 0 if mask is None else mask
    _check_images(depth, eligible, "mask")
    dropped = depth.copy()
    rows, columns = np.nonzero(eligible)
    if rng.random() >= probability or rows.size == 0:
        return dropped
    height, width = depth.shape
    for centre in rng.integers(rows.size, size=rng.poisson(mean_count)):
        a, b = np.maximum(rng.gamma(radius_shape, radius_scale, size=2), 0.5)
        tilt = rng.uniform(0.0, np.pi)
        row, column = int(rows[centre]), int(columns[centre])
        reach = int(np.ceil(max(a, b)))
        top, bottom = max(row - reach, 0), min(row + reach + 1, height)
        left, right = max(column - reach, 0), min(column + reach + 1, width)
        y, x = np.ogrid[top - row : bottom - row, left - column : right - column]
        along = (x * np.cos(tilt) + y * np.sin(tilt)) / a
        across = (y * np.cos(tilt) - x * np.sin(tilt)) / b
        inside = (along**2 + across**2 <= 1.0) & eligible[top:bottom, left:right]
        dropped[top:bottom, left:right][inside] = 0.0
    return dropped


def depth_jumps(depth: FloatArray, jump_m: float = 0.02, width_px: int = 1) -> BoolArray:
    """Find the pixels of depth (H, W), metres, at most `width_px` from where it jumps: (H, W) bool.

    The smallest difference within a 3x3 window that counts is `jump_m`; missing pixels make none.
    """
    near, far = _near_and_far(depth, 3)
    jump = (far - near) > jump_m
    if width_px > 1:
        square = np.ones((3, 3), bool)
        jump = ndimage.binary_dilation(jump, structure=square, iterations=width_px - 1)
    return np.asarray(jump & (depth > 0), dtype=bool)


def edge_noise(
    depth: FloatArray,
    rng: np.random.Generator,
    *,
    width_px: int = 1,
    flying_share: float = 0.3,
    shift_px: float = 0.8,
) -> FloatArray:
    """Fray the outlines: shifted edges and flying pixels where the depth jumps.

    A matching window on an outline sees two surfaces. It takes the wrong one (the outline moves,
    smoothly along the edge) or settles in between (a flying pixel, on neither surface).

    Args:
        depth: z-depth in metres, shape (H, W); it changes only within the disturbed band.
        rng: Source of randomness.
        width_px: How far the band reaches from a jump, pixels.
        flying_share: Expected share of the band that becomes flying pixels, 0..1.
        shift_px: Standard deviation of the outline's shift, pixels.
    """
    band = depth_jumps(depth, width_px=width_px)
    height, width = depth.shape
    shift_v, shift_u = (shift_px * smooth_noise((height, width), 2.0, rng) for _ in range(2))
    v, u = np.indices((height, width))
    source_v = np.clip(np.rint(v + shift_v), 0, height - 1).astype(np.intp)
    source_u = np.clip(np.rint(u + shift_u), 0, width - 1).astype(np.intp)
    shifted = depth[source_v, source_u]
    noisy = np.where(band & (shifted > 0), shifted, depth)
    near, far = _near_and_far(depth, 2 * width_px + 1)
    flying = band & (rng.random((height, width)) < flying_share)
    mixture = near + rng.random((height, width)).astype(np.float32) * (far - near)
    return np.where(flying, mixture, noisy).astype(np.float32)


def see_through(
    depth: FloatArray,
    background_depth: FloatArray,
    mask: BoolArray,
    rng: np.random.Generator,
    *,
    missing_share: float = MISSING_SHARE,
    background_share: float = BACKGROUND_SHARE,
    blob_px: float = 4.0,
) -> FloatArray:
    """Let the camera look through the glass.

    The mask falls into three parts, in connected patches: no depth at all, the depth of what
    stands behind the object, and (a highlight, a label, a rim) the surface's own depth. The
    shares are exact up to rounding; the patches are the level sets of a smooth random field.

    Args:
        depth: z-depth of the object's surface in metres, shape (H, W).
        background_depth: z-depth without the object in metres, shape (H, W).
        mask: Pixels of the transparent object, shape (H, W) bool; no other changes.
        rng: Source of randomness.
        missing_share: Share of the mask without depth, 0..1.
        background_share: Share of the mask that shows the background, 0..1.
        blob_px: Size of the patches, pixels (standard deviation of the smoothing).

    Raises:
        ValueError: Shapes differ, or the shares are not in 0..1 or add up to more than 1.
    """
    _check_images(depth, mask, "mask")
    _check_images(depth, background_depth, "background_depth")
    if min(missing_share, background_share) < 0 or missing_share + background_share > 1:
        raise ValueError(
            "missing_share and background_share must be in 0..1 and add up to at most 1, "
            f"got {missing_share} and {background_share}"
        )
    corrupted = depth.copy()
    field = smooth_noise(depth.shape, blob_px, rng)[mask]
    rank = np.empty(field.size, dtype=np.intp)
    rank[np.argsort(field, kind="stable")] = np.arange(field.size)
    n_missing = round(missing_share * field.size)
    n_background = round((missing_share + background_share) * field.size) - n_missing
    inside = corrupted[mask]
    inside[rank < n_missing] = 0.0
    shows_background = (rank >= n_missing) & (rank < n_missing + n_background)
    inside[shows_background] = background_depth[mask][shows_background]
    corrupted[mask] = inside
    return corrupted


def stereo_noise(
    depth: FloatArray,
    camera: Intrinsics,
    rng: np.random.Generator,
    *,
    baseline_m: float = 0.055,
    disparity_step: float = 1 / 8,
    disparity_std: float = 0.1,
) -> FloatArray:
    """Measure the depth with a stereo pair: matching noise, then a sub-pixel grid.

    The camera measures the disparity d = f b / z, not z. A constant error of d becomes an error
    of z that grows with its square: dz = z^2 / (f b) * dd. Where no positive disparity is left, the
    depth is missing.

    Args:
        depth: z-depth in metres, shape (H, W).
        camera: Intrinsics of the depth image (fx is used).
        rng: Source of randomness.
        baseline_m: Distance of the two imagers, metres.
        disparity_step: Sub-pixel step of the matcher, pixels; 0 leaves disparity continuous.
        disparity_std: Standard deviation of the matching error, pixels.

    Raises:
        ValueError: A parameter is negative, or the baseline is not positive.
    """
    if baseline_m <= 0 or disparity_step < 0 or disparity_std < 0:
        raise ValueError(
            "baseline_m must be positive and disparity_step, disparity_std not negative, got "
            f"{baseline_m}, {disparity_step}, {disparity_std}"
        )
    seen = valid_depth(depth)
    disparity = camera.fx * baseline_m / np.where(seen, depth, 1.0).astype(np.float64)
    measured = disparity + disparity_std * rng.standard_normal(depth.shape)
    if disparity_step > 0:
        measured = np.rint(measured / disparity_step) * disparity_step
    valid = seen & (measured > 0)
    z = camera.fx * baseline_m / np.where(valid, measured, 1.0)
    return np.where(valid, z, 0.0).astype(np.float32)


def corrupt(
    depth: FloatArray,
    mask: BoolArray,
    camera: Intrinsics,
    rng: np.random.Generator,
    config: CorruptionConfig = ORACLE,
    background_depth: FloatArray | None = None,
    raw_depth: FloatArray | None = None,
) -> FloatArray:
    """Apply the chosen models in physical order.

    Args:
        depth: True z-depth in metres, shape (H, W).
        mask: Pixels of the transparent object, shape (H, W) bool.
        camera: Intrinsics of the depth image.
        rng: Source of randomness.
        config: Which models; the default is the paper's oracle.
        background_depth: z-depth without the object in metres; `see_through` needs it.
        raw_depth: z-depth that a camera measured, in metres; `captured` needs it.

    Raises:
        ValueError: `see_through` without `background_depth`, `captured` without `raw_depth`, or
            shapes differ.
    """
    _check_images(depth, mask, "mask")
    corrupted = depth.astype(np.float32)
    if config.captured:
        if raw_depth is None:
            raise ValueError("captured needs raw_depth (H, W), got None")
        _check_images(depth, raw_depth, "raw_depth")
        corrupted = np.where(valid_depth(raw_depth), raw_depth, 0.0).astype(np.float32)
    if config.see_through:
        if background_depth is None:
            raise ValueError("see_through needs background_depth (H, W), got None")
        corrupted = see_through(corrupted, background_depth, mask, rng)
    if config.stereo:
        corrupted = stereo_noise(corrupted, camera, rng)
    if config.edges:
        corrupted = edge_noise(corrupted, rng)
    return erase_mask(corrupted, mask) if config.erase else corrupted


def smooth_noise(
    shape: tuple[int, ...], smooth_px: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return white noise smoothed by a Gaussian of `smooth_px`, scaled to mean 0 and std 1."""
    noise = ndimage.gaussian_filter(rng.standard_normal(shape), smooth_px, mode="wrap")
    spread = float(noise.std())
    return np.asarray((noise - noise.mean()) / (spread if spread > 0 else 1.0))


def _near_and_far(depth: FloatArray, window: int) -> tuple[FloatArray, FloatArray]:
    """Return the smallest and largest valid depth in a square window, each (H, W)."""
    valid = depth > 0
    near = ndimage.minimum_filter(np.where(valid, depth, np.inf), size=window)
    far = ndimage.maximum_filter(np.where(valid, depth, 0.0), size=window)
    near = np.where(np.isfinite(near), near, far)
    return near.astype(np.float32), far.astype(np.float32)


def _check_images(depth: FloatArray, other: NDArray[Any], name: str) -> None:
    if depth.ndim != 2 or depth.shape != other.shape:
        raise ValueError(
            f"depth and {name} must be (H, W) of the same size, got {depth.shape} and {other.shape}"
        )
    if depth.dtype.kind != "f":
        raise ValueError(f"depth must be float metres, got {depth.dtype}")
