"""What a data set is made of: numbers of its frames, one row a frame."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from hadr.camera import Array
from hadr.data.frame import Frame
from hadr.synthesis.glass.objects import bodies, glass_object
from hadr.synthesis.rendering.raycast import RayCaster
from hadr.synthesis.scene.contents import Contents

_SILHOUETTE_WIDTH = 160


@dataclass(frozen=True)
class FrameStatistics:
    """Columns of N frames; NaN where a frame lacks what a number needs.

    Args:
        object_id: The object of each frame.
        split: The split of each frame.
        hold_id: The holding pose, or an empty name.
        distance_m: From the camera to the mean of the hand's keypoints, metres.
        glass_depth_m: Median true depth of the glass, metres.
        glass_share: Pixels of glass over all pixels.
        hand_share: Pixels of hand and forearm over all pixels.
        visible_share: Pixels of glass over those of the same glass without hand or arm.
        missing_share: Pixels of glass without raw depth over all pixels of glass.
        bias_m: Median of raw minus true depth on the glass, metres; plus lies behind.
        hand_error_m: Median distance of raw from true depth on the hand, metres.
        world_error_m: The same on everything that is neither hand nor glass.
    """

    object_id: tuple[str, ...]
    split: tuple[str, ...]
    hold_id: tuple[str, ...]
    distance_m: Array
    glass_depth_m: Array
    glass_share: Array
    hand_share: Array
    visible_share: Array
    missing_share: Array
    bias_m: Array
    hand_error_m: Array
    world_error_m: Array

    def __len__(self) -> int:
        return len(self.object_id)


def frame_statistics(frames: Iterable[Frame]) -> FrameStatistics:
    """Measure frames one after the other, one row a frame; at least one."""
    names: list[tuple[str, str, str]] = []
    rows: list[list[float]] = []
    for frame in frames:
        names.append((frame.object_id, frame.split, frame.hold_id or ""))
        glass, hand = frame.object_mask, frame.hand_mask
        row = [float(np.linalg.norm(frame.keypoints.mean(axis=0))), _middle(frame.depth[glass])]
        row += [float(glass.mean()), float(hand.mean()), visible_share(frame)]
        rows.append([*row, *_raw_errors(frame)])
    if not rows:
        raise ValueError("no frames to measure")
    object_ids, splits, holds = zip(*names, strict=True)
    return FrameStatistics(object_ids, splits, holds, *np.array(rows).T)


def visible_share(frame: Frame) -> float:
    """How much of the glass's silhouette inside the picture is free, 0 to 1; NaN of no pose."""
    if frame.world_from_object is None:
        return float("nan")
    width = min(_SILHOUETTE_WIDTH, frame.camera.width)
    camera = frame.camera.resized(width, round(width * frame.camera.height / frame.camera.width))
    object_from_camera = np.linalg.inv(frame.world_from_object) @ frame.world_from_camera
    silhouette = _alone(frame.object_id).labels(camera, object_from_camera).object_mask
    if not silhouette.any():
        return float("nan")
    return min(1.0, float(frame.object_mask.mean() / silhouette.mean()))


@lru_cache(maxsize=16)
def _alone(object_id: str) -> RayCaster:
    return RayCaster(Contents(glass=bodies(glass_object(object_id))))


def _raw_errors(frame: Frame) -> tuple[float, float, float, float]:
    """Missing share and bias on the glass; error on the hand and on the rest, metres."""
    nan = float("nan")
    raw, true = frame.raw_depth, frame.depth
    if raw is None:
        return nan, nan, nan, nan
    seen = (raw > 0) & (true > 0)
    error = raw - true
    glass, hand = frame.object_mask, frame.hand_mask
    rest = ~(glass | hand)
    missing = float((raw <= 0)[glass].mean()) if glass.any() else nan
    on_hand, beyond = (_middle(np.abs(error[part & seen])) for part in (hand, rest))
    return missing, _middle(error[glass & seen]), on_hand, beyond


def _middle(values: npt.NDArray[np.float32]) -> float:
    """The median, NaN of nothing."""
    return float(np.median(values)) if values.size else float("nan")
