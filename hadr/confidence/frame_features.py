"""What can be measured of a frame: how far the glass is, where the hand is, what the camera says.

Each feature has a scale on which steps are alike, and words in which it is said. They are measured
at the size at which a network works, so that they don't depend on the picture's; how the mask
follows the picture (`outline_features`), at one size for all networks, since it needs finer pixels.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from hadr.camera import (
    Array,
    BoolArray,
    FloatArray,
    Intrinsics,
    project,
    resize_color,
    resize_mask,
    unproject,
    window_around,
)

Features = Mapping[str, float]
NEAR_M = 0.03
"""Depth in the glass that is no farther from the answer may be its surface's, metres."""
SKIN_M = (-0.02, 0.07)
"""A hand's joint lies so far behind the depth that is measured at its pixel, metres: 1 to 2 cm
below the skin, more where a finger hides it."""
OUTLINE_WIDTH = 448
"""Width to which a picture is brought before its mask's outline is looked at, pixels."""
FAINT = 2.0
"""A step of brightness, per pixel, that is none; of 255."""
STRETCH = 0.2
"""Half of a stretch of the outline, of the root of the mask's area."""
WEAKEST = 0.15
"""Share of the stretches that are weaker than the one that counts."""
MOST_PARTS = 18
"""Pieces and holes of a mask of glass; those of the bundled frames have up to 8."""

LEAST_FULL = 0.75
"""Share of what a mask's outline holds that is in it: 88 % and more in the bundled frames, where
fingers lie before the glass."""


def _log(unit: float = 0.0) -> Callable[[Array], Array]:
    return lambda v: np.log(np.maximum(v, 0) + unit + 1e-9)


def _share(v: Array) -> Array:
    """Log odds of a share, which end at those of 1 %."""
    return np.asarray(np.log((0.98 * v + 0.01) / (0.99 - 0.98 * v)))


def _signed(unit: float) -> Callable[[Array], Array]:
    return lambda v: np.arcsinh(v / unit)


@dataclass(frozen=True)
class Feature:
    """How a feature is compared and said.

    Args:
        words: What it is, with `{}` in place of its value.
        scale: Brings it to a scale on which steps are alike; it is a share where none is named.
        unit: Behind the value, where it is said.
        factor: From metres, or a share, to that unit.
        slack: What counts as equal, on that scale: half of a range is no less.
        sides: Of a value with a sign, what is said behind a positive and a negative one.
    """

    words: str
    scale: Callable[[Array], Array] = _share
    unit: str = " %"
    factor: float = 100.0
    slack: float = 0.05
    sides: tuple[str, str] | None = None

    def said(self, value: float, low: float, high: float) -> str:
        """Say the value and the range that was learned."""
        here, least, most = (self._number(v) for v in (value, low, high))
        side = self._side
        learned = f"{least}{self.unit}{side(low)} to {most}{self.unit}{side(high)}"
        if side(low) == side(high):
            both = least if least == most else f"{least} to {most}"
            learned = f"{both}{self.unit}{side(low)}"
        return f"{self.words.format(f'{here}{self.unit}{side(value)}')}, in training {learned}"

    def _number(self, value: float) -> str:
        return f"{self.factor * (value if self.sides is None else abs(value)):.3g}"

    def _side(self, value: float) -> str:
        return "" if self.sides is None else f" {self.sides[bool(value < 0)]}"


_BEHIND = ("behind", "before")

FEATURES: dict[str, Feature] = {
    "distance": Feature("the glass is {} away", _log(), " m", 1),
    "size": Feature("the glass measures {} across", _log(), " cm"),
    "lens": Feature(
        "the camera sees another angle: focal length {} of the picture's width", _log(), slack=0.08
    ),
    "known_around": Feature("the camera measured depth on {} of what is around the glass"),
    "near_around": Feature("{} of the depth around the glass is within 10 cm of it"),
    "depth_around": Feature(
        "what is around the glass is {} it", _signed(0.1), " cm", sides=_BEHIND
    ),
    "rough": Feature("the depth camera's noise is another: {} at 1 m", _log(1e-4), " mm", 1000),
    "even": Feature("{} of the measured depth has no noise, as if computed"),
    "known_in": Feature("the camera measured depth on {} of the glass"),
    "near_in": Feature("{} of the depth measured in the glass is within 3 cm of the answer"),
    "behind_in": Feature("{} of the depth measured in the glass is over 3 cm behind the answer"),
    "spread_in": Feature(
        "half of the depth measured in the glass is spread over {}", _log(0.003), " cm"
    ),
    "outline": Feature(
        "the mask may not follow the glass: {} of what changes near its outline lies on it"
    ),
    "faint": Feature("the mask may not follow the glass: {} of its outline follow nothing"),
    "across": Feature(
        "the mask may not follow the glass: on its outline's weakest stretch {} of what changes "
        "does so across it"
    ),
    "clear_in": Feature(
        "the mask may not follow the glass: its outline changes {} times as much as its inside",
        _log(),
        "",
        1,
    ),
    "hand": Feature(
        "the hand has another size: its bones measure {} in the mean", _log(), " mm", 1000
    ),
    "fingers": Feature(
        "the hand has other proportions: the lengths of its bones differ by {}", _log()
    ),
    "tilt": Feature(
        "the hand points {} the camera",
        _signed(1),
        " of its length",
        1,
        sides=("away from", "toward"),
    ),
    "touch": Feature("the hand's nearest joints are {} beside the glass", _log(0.002), " cm"),
    "beside": Feature("the hand's middle is {} beside the glass's", _log(0.01), " cm"),
    "behind": Feature("the glass is restored {} the hand", _signed(0.05), " cm", sides=_BEHIND),
    "off": Feature(
        "the hand's joints lie {} the depth measured there", _signed(0.02), " cm", sides=_BEHIND
    ),
    "agree": Feature("measured depth agrees with {} of the hand's joints"),
    "seen": Feature(
        "the glass looks unlike those in training: what is seen there is off by {}",
        _log(0.05),
        "",
        1,
    ),
}
"""The features by name."""


def frame_features(
    depth: FloatArray,
    restored: FloatArray,
    camera: Intrinsics,
    mask: BoolArray,
    keypoints: FloatArray | None = None,
) -> dict[str, float]:
    """Measure a frame at the size at which a network works: features by name, lengths in metres.

    From z-depth as the camera measured it, in the glass too, and the network's answer, (H, W),
    metres, 0 = missing; intrinsics of this size; the pixels to restore, (H, W) bool, one at least;
    and the hand's keypoints, camera frame, metres, (21, 3). What can't be measured is left out.
    """
    known, answered = depth > 0, mask & (restored > 0)
    answer = float(np.median(restored[answered])) if answered.any() else np.nan
    away = answer if keypoints is None else float(np.median(keypoints[:, 2]))
    side = np.sqrt(mask.sum())
    near = max(2, round(0.2 * side))
    ring, wide = (ndimage.maximum_filter(mask, 2 * reach + 1) & ~mask for reach in (near, 2 * near))
    around = depth[ring & known]
    found: dict[str, float] = {
        "distance": away,
        "size": float(side / np.sqrt(camera.fx * camera.fy)) * away,
        "lens": camera.fx / camera.width,
        "known_around": _mean(known[ring]),
        "near_around": _mean(np.abs(around - away) < 0.1),
        "depth_around": _median(around) - away,
        **_noise(depth, wide),
    }
    inside = known & mask
    if inside.any():
        off = (depth - restored)[inside & answered]
        found |= {
            "known_in": float(inside.sum() / mask.sum()),
            "near_in": _mean(np.abs(off) < NEAR_M),
            "behind_in": _mean(off > NEAR_M),
            "spread_in": float(np.subtract(*np.percentile(off, (75, 25)))) if off.size else np.nan,
        }
    if keypoints is not None:
        found |= {"behind": answer - away, **_hand_features(depth, camera, mask, keypoints)}
    return {name: value for name, value in found.items() if np.isfinite(value)}


def outline_features(color: npt.NDArray[np.uint8], mask: BoolArray) -> dict[str, float]:
    """Measure whether a mask (H, W) ends where the picture, RGB (H, W, 3) uint8, changes.

    Across the outline of glass its brightness makes a step. Where a mask is too wide, or of another
    shape, there are steeper ones beside its outline; where it cuts through the glass, as many along
    it as across. A hand's skin is smoother than glass. What can't be measured is left out.
    """
    size = OUTLINE_WIDTH, max(round(mask.shape[0] * OUTLINE_WIDTH / mask.shape[1]), 1)
    mask = resize_mask(mask, *size)
    if not mask.any():
        return {}
    window = window_around(mask, 16)
    mask, gray = mask[window], resize_color(color, *size)[window].mean(axis=2)
    beyond = ndimage.distance_transform_edt(~mask) - ndimage.distance_transform_edt(mask)
    steps = np.stack([ndimage.gaussian_filter(gray, 0.7, order=o) for o in ((1, 0), (0, 1))])
    across = np.stack(np.gradient(ndimage.gaussian_filter(beyond, 1)))
    across /= np.maximum(np.linalg.norm(across, axis=0), 1e-3)
    step = np.abs((steps * across).sum(axis=0))
    rim, change = np.abs(beyond) <= 1, np.hypot(*steps)
    on, near, any_way = (
        ndimage.maximum_filter(image, reach) for image, reach in ((step, 3), (step, 9), (change, 3))
    )
    stretch = 2 * max(2, round(STRETCH * float(np.sqrt(mask.sum())))) + 1
    share, count = (
        ndimage.uniform_filter(image, stretch, mode="constant")[rim]
        for image in (rim * on / (any_way + FAINT / 4), rim.astype(float))
    )
    on, near = on[rim], near[rim]
    found = {
        "outline": _mean(on[near > 0] / near[near > 0]),
        "faint": _mean(on < FAINT),
        "across": float(np.quantile(share / count, WEAKEST)),
        "clear_in": _mean(change[rim]) / (_mean(change[beyond < -3]) + 0.1),
    }
    return {name: value for name, value in found.items() if np.isfinite(value)}


def torn(mask: BoolArray) -> tuple[str, ...]:
    """Say if a mask, (H, W) bool, has more pieces and holes than one of glass, or is hollow."""
    pieces = ndimage.label(mask, np.ones((3, 3)))[1]
    holes = ndimage.label(np.pad(~mask, 1, constant_values=True))[1] - 1
    if pieces + holes > MOST_PARTS:
        return (f"the mask is torn: {pieces} pieces and {holes} holes, expected a handful",)
    full = float(mask.sum() / max(ndimage.binary_fill_holes(mask).sum(), 1))
    if full < LEAST_FULL:
        return (f"the mask is hollow: {100 * full:.0f} % of what its outline holds is in it",)
    return ()


def _mean(values: npt.NDArray[Any]) -> float:
    return float(values.mean()) if values.size else np.nan


def _median(values: FloatArray) -> float:
    return float(np.median(values)) if values.size else np.nan


def _noise(depth: FloatArray, region: BoolArray) -> dict[str, float]:
    """Second differences of depth, which noise makes and a plane has none of."""
    parts = []
    for z, at in ((depth, region), (depth.T, region.T)):
        before, here, after = z[:-2], z[1:-1], z[2:]
        good = at[1:-1] & (before > 0) & (here > 0) & (after > 0)
        parts.append((np.abs(before - 2 * here + after) / np.maximum(here, 1e-6) ** 2)[good])
    # a stereo camera's noise grows with the square of the distance
    bent = np.concatenate(parts)
    return {"rough": _median(bent), "even": _mean(bent < 1e-4)}


def _hand_features(
    depth: FloatArray, camera: Intrinsics, mask: BoolArray, keypoints: FloatArray
) -> dict[str, float]:
    """The hand's form, and where it is against glass and measured depth."""
    from hadr.hand import BONES

    away = float(np.median(keypoints[:, 2]))
    bones = np.linalg.norm(np.diff(keypoints[np.array(BONES)], axis=1)[:, 0], axis=1)
    rows, columns = np.nonzero(mask)
    middle = unproject((columns.mean(), rows.mean()), away, camera)
    uv = project(keypoints, camera)
    last = (camera.width - 1, camera.height - 1)
    cell = np.rint(np.clip(uv, 0, last)).astype(int)
    beyond = np.linalg.norm(uv - cell, axis=1) * (np.abs(uv - cell).max(axis=1) > 0.5)
    column, row = cell.T
    gap = (ndimage.distance_transform_edt(~mask)[row, column] + beyond) * away / camera.fx
    measured = depth[row, column]
    seen = (beyond == 0) & (measured > 0) & ~mask[row, column]
    off = keypoints[seen, 2] - measured[seen]
    along = keypoints[9] - keypoints[0]
    return {
        "hand": float(bones.mean()),
        "fingers": float(bones.std() / bones.mean()),
        "tilt": float(along[2] / max(np.linalg.norm(along), 1e-6)),
        "touch": float(np.sort(gap)[:3].mean()),
        "beside": float(np.linalg.norm(keypoints[:, :2].mean(axis=0) - middle[:2])),
        "off": _median(off),
        "agree": _mean((off > SKIN_M[0]) & (off < SKIN_M[1])),
    }
