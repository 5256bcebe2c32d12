"""The depth sensor of the camera beside the robot: how it errs, and how it fails on glass.

A formula for what the path-traced stereo camera of chapter 1 does, fast enough for ten pictures a
second: holes and background on glass, errors that grow with distance, frayed and shadowed edges.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hadr.camera import Intrinsics
from hadr.corruption import edge_noise, see_through, smooth_noise, stereo_noise

Depth = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]

FOCAL, BASELINE = 425.0, 0.050
"""The imagers' focal length, pixels, and distance, metres: a D435's, as in `depth_camera`."""
FARTHEST = 4.0
"""Larger depths are not reported, metres."""


@dataclass(frozen=True)
class DepthSensor:
    """How the depth sensor errs.

    The shares on glass are the means of the path-traced stereo camera's frames of held glasses in
    `data_samples` (validation): 75 % of the glass is missing, 19 % lies more than 1 cm behind the
    surface, most of it on what stands behind; 6 % is about right. Disparities are those of a D435
    (`hadr.synthesis.depth_sensor.depth_camera`), given in its own pixels.

    Attributes:
        missing: Share of the glass without depth.
        behind: Share of it that shows what is behind the glass, or something in between.
        disparity_std: Standard deviation of the matching error, pixels.
        disparity_step: The matcher's step, pixels.
        lost: Share of all pixels that find no match for another reason; a tenth of the hand is
            then missing, as in those frames.
    """

    missing: float = 0.75
    behind: float = 0.19
    disparity_std: float = 0.08
    disparity_step: float = 1 / 16
    lost: float = 0.08

    def measure(
        self,
        depth: Depth,
        background_depth: Depth,
        object_mask: Mask,
        camera: Intrinsics,
        rng: np.random.Generator,
    ) -> Depth:
        """The z-depth that is measured, metres, shape (H, W) float32; 0 where nothing is.

        From the true z-depth, with and without the glass, and the glass's mask, each (H, W).
        """
        # what passes the glass is bent: the match lies between its surface and the background
        share = np.clip(1.15 + 0.45 * smooth_noise(depth.shape, 3.0, rng), 0.1, 1.0)
        apparent = (depth + share * (background_depth - depth)).astype(np.float32)
        seen = see_through(
            depth,
            apparent,
            object_mask,
            rng,
            missing_share=self.missing,
            background_share=self.behind,
            blob_px=2.0,
        )
        scale = camera.fx / FOCAL  # the sensor's pixels are not the picture's
        raw = stereo_noise(
            seen,
            camera,
            rng,
            baseline_m=BASELINE,
            disparity_step=self.disparity_step * scale,
            disparity_std=self.disparity_std * scale,
        )
        raw = edge_noise(raw, rng, flying_share=0.15, shift_px=0.5)
        patches = smooth_noise(depth.shape, 2.0, rng)
        lost = patches > np.quantile(patches, 1 - self.lost)
        lost |= in_shadow(background_depth, camera.fx * BASELINE)
        lost |= raw > FARTHEST
        return np.where(lost, 0, raw).astype(np.float32)


def in_shadow(depth: Depth, focal_baseline: float) -> Mask:
    """Pixels (H, W) of the left imager that something nearer hides from the right one."""
    disparity = focal_baseline / np.where(depth > 0, depth, np.inf)
    column = np.arange(depth.shape[1]) - disparity  # where the right imager sees it
    nearest = np.minimum.accumulate(column[:, ::-1], axis=1)[:, ::-1]
    hidden = np.zeros(depth.shape, dtype=bool)
    hidden[:, :-1] = nearest[:, 1:] <= column[:, :-1]
    return hidden
