"""What a corruption leaves of the depth inside a mask, in three numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hadr.camera import BoolArray, FloatArray, valid_depth


@dataclass(frozen=True)
class CorruptionStatistics:
    """What is left of the depth inside a mask.

    Attributes:
        pixels: Pixels of the mask that have a true depth.
        missing_share: Share of them without a measured depth, 0..1.
        bias_m: Median of measured minus true depth over the rest, metres (positive: behind).
        within_1cm_share: Share of all of them measured within 1 cm of the truth, 0..1.
    """

    pixels: int
    missing_share: float
    bias_m: float
    within_1cm_share: float


def corruption_statistics(
    corrupted: FloatArray, truth: FloatArray, mask: BoolArray
) -> CorruptionStatistics:
    """Count what a corruption left of the depth inside a mask.

    Args:
        corrupted: Measured z-depth in metres, shape (H, W); 0 or NaN is missing.
        truth: True z-depth in metres, shape (H, W); 0 or NaN is unknown and not counted.
        mask: Pixels of the transparent object, shape (H, W) bool.

    Returns:
        The shares and the bias; NaN where nothing can be counted.
    """
    known = mask & valid_depth(truth)
    measured, true = corrupted[known], truth[known]
    valid = valid_depth(measured)
    error = measured[valid] - true[valid]
    pixels = int(known.sum())
    return CorruptionStatistics(
        pixels=pixels,
        missing_share=float(1 - valid.mean()) if pixels else float("nan"),
        bias_m=float(np.median(error)) if error.size else float("nan"),
        within_1cm_share=float((np.abs(error) < 0.01).sum() / pixels) if pixels else float("nan"),
    )
