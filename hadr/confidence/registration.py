"""Are colour and depth of one picture, pixel on pixel?

Where depth jumps, from a hand to the wall behind it, the picture mostly changes as well. So edges
of the depth are laid over those of the colour, moved by up to `REACH` pixels each way: they fit
best where they are if the two belong together, and somewhere else, or nowhere, if not. A depth with
holes has lost most of its jumps: on validation frames no limit told right pairs from wrong ones,
so nothing is said of it (`hadr.frame_checks.told_color` looks at the hand).

Source: our own; the limits are from bundled training and validation frames. What it is worth on
test frames stands in `results/confidence/known_ground.json`.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
from scipy import ndimage

from hadr.camera import BoolArray, FloatArray, resize_color, resize_depth, resize_mask

WIDTH = 448
"""Width at which edges are compared, pixels; so wide are the bundled frames."""
REACH = 24
NEAR = 2
"""So many pixels count as no move."""
JUMP_M = 0.04
LEAST_EDGE = 60
"""Of fewer pixels beside a jump nothing is said."""
COMPLETE = 0.99
"""Share of the depth outside of the glass that is known, if it has no holes."""
FITS, DOUBTFUL, ELSEWHERE = 1.0, 2.0, 3.5
"""How many standard deviations of all moves the fit where they are must lie above the mean; below
what it is doubtful; from what another place counts."""


def fit_of_edges(
    color: npt.NDArray[np.uint8], depth: FloatArray, mask: BoolArray
) -> npt.NDArray[np.float64] | None:
    """Say how well depth's edges fit those of the colour at each move, in standard deviations.

    Args:
        color: RGB, shape (H, W, 3), uint8.
        depth: z-depth in metres as it was measured, shape (H, W); 0 = missing.
        mask: The glass, shape (H, W) bool, beside which no edge counts.

    Returns:
        Shape (49, 49): rows and columns that the depth is moved by, from -24 to 24 pixels of a
        picture that is 448 wide; None where the depth has too few edges.
    """
    size = WIDTH, max(round(mask.shape[0] * WIDTH / mask.shape[1]), 1)
    depth = np.nan_to_num(resize_depth(depth, *size))
    away = ~ndimage.maximum_filter(resize_mask(mask, *size), 9)
    gray = np.log(resize_color(color, *size).mean(axis=2) + 8)
    inner = slice(REACH, -REACH), slice(REACH, -REACH)
    fit, count = np.zeros((2 * REACH + 1, 2 * REACH + 1)), 0.0
    for axis, order in ((0, (1, 0)), (1, (0, 1))):
        jumps = _soft((_jumps(depth, axis) & away).astype(float), (0, 0))[inner]
        if 0 in jumps.shape:
            return None
        change = np.abs(_soft(gray, order))
        change /= max(float(np.percentile(change, 97)), 1e-6)
        change = np.minimum(change, 1)
        pair = (change - change.mean()).astype(np.float32), jumps.astype(np.float32)
        fit += cv2.matchTemplate(*pair, cv2.TM_CCORR)
        count += float(jumps.sum())
    spread = float(fit.std())
    return None if count < LEAST_EDGE or spread == 0 else (fit - fit.mean()) / spread


def told_apart(color: npt.NDArray[np.uint8], depth: FloatArray, mask: BoolArray) -> tuple[str, ...]:
    """Say if colour and depth seem to be of two pictures, or lie beside each other."""
    outside = ~mask
    if np.count_nonzero(outside & (depth > 0)) < COMPLETE * np.count_nonzero(outside):
        return ()
    if (fit := fit_of_edges(color, depth, mask)) is None:
        return ()
    middle = slice(REACH - NEAR, REACH + NEAR + 1)
    here, best = float(fit[middle, middle].max()), float(fit.max())
    down, right = (int(n) - REACH for n in np.unravel_index(int(fit.argmax()), fit.shape))
    if best >= ELSEWHERE and here < DOUBTFUL and np.hypot(down, right) > 2 * NEAR:
        scale = mask.shape[1] / WIDTH
        across = f"{abs(right) * scale:.0f} pixels to the {'left' if right < 0 else 'right'}"
        along = f"{abs(down) * scale:.0f} {'up' if down < 0 else 'down'}"
        return (
            "colour and depth may not be aligned: their edges fit best where the depth is moved "
            f"by {across} and {along}",
        )
    if here < FITS:
        return ("colour and depth may be of two pictures: their edges are not in the same places",)
    return ()


def _jumps(depth: FloatArray, axis: int) -> BoolArray:
    """Pixels behind which, along an axis, known depth differs by more than `JUMP_M`."""
    one, next_ = (np.take(depth, range(n, depth.shape[axis] - 1 + n), axis) for n in (0, 1))
    found = (np.abs(next_ - one) > JUMP_M) & (one > 0) & (next_ > 0)
    width = [(1, 0) if n == axis else (0, 0) for n in range(2)]
    return np.asarray(np.pad(found, width))


def _soft(image: FloatArray, order: tuple[int, int]) -> FloatArray:
    return np.asarray(ndimage.gaussian_filter(image, 1, order=order))
