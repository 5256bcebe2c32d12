"""What a network is given besides colour: the depth's corruption, and true or predicted hints.

Predictions of masks and keypoints are computed once and stored in the frames. Scoring stays on the
true mask (`FrameTensors.object_mask`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from hadr.training.batches import Corruption, FrameTensors
from hadr.training.checkpoints import load_checkpoint

TRUE = "true"


@dataclass(frozen=True)
class Given:
    """What a network is given.

    Args:
        corruption: How the depth went wrong.
        masks: "true", or the segmentation checkpoint that predicts them.
        keypoints: "true", or the hand-keypoint checkpoint that predicts them.
        seed: Seed of the analytic corruption.
    """

    corruption: Corruption = "oracle"
    masks: str | Path = TRUE
    keypoints: str | Path = TRUE
    seed: int = 0

    def record(self) -> dict[str, str]:
        """The same for a training's record: files by their names."""
        return {
            "corruption": self.corruption,
            "masks": Path(self.masks).name,
            "keypoints": Path(self.keypoints).name,
        }


def with_predicted(frames: FrameTensors, given: Given, batch_size: int = 16) -> FrameTensors:
    """Put predicted masks and keypoints in the place of the true ones, where asked for.

    With the oracle corruption the depth is missing in the true mask already; it is erased in the
    predicted one as well. The keypoints' network looks where the predicted hand is, or the true
    one where masks are true; a frame without a hand keeps zeros, which mean "unknown".

    Args:
        frames: The frames with true masks and keypoints.
        given: What is asked for.
        batch_size: Frames at a time.

    Returns:
        The frames, or the same ones where nothing is to be predicted.

    Raises:
        FileNotFoundError: A checkpoint does not exist.
        ValueError: A checkpoint is one of another network.
    """
    inputs, hand = frames.inputs, frames.hand_mask
    if str(given.masks) != TRUE:
        model = _network(given.masks, "segmentation")
        masks = torch.cat([_masks(model, part) for part in _parts(frames, batch_size)])
        if masks.shape[1] > 1:
            hand = masks[:, 1]
        depth = inputs.depth
        if given.corruption == "oracle":
            depth = torch.where(masks[:, 0], torch.zeros_like(depth), depth)
        inputs = replace(inputs, mask=masks[:, 0], depth=depth)
        frames = replace(frames, inputs=inputs)
    if str(given.keypoints) != TRUE:
        model = _network(given.keypoints, "hand-keypoints")
        found = torch.zeros_like(inputs.keypoints)
        seen = hand.flatten(1).any(dim=1).nonzero().squeeze(1)
        for index in torch.split(seen, batch_size):
            found[index] = _keypoints(model, frames.take(index), hand[index])
        uv = pixels_of(found, inputs.intrinsics) * (found != 0).any(dim=-1, keepdim=True)
        frames = replace(frames, inputs=replace(inputs, keypoints=found, keypoints_uv=uv))
    return frames


def pixels_of(points: Tensor, intrinsics: Tensor) -> Tensor:
    """Project keypoints.

    Args:
        points: Metres, camera frame, shape (N, 21, 3).
        intrinsics: fx, fy, cx, cy, shape (N, 4).

    Returns:
        Pixels (column, row), shape (N, 21, 2).
    """
    focal, centre = intrinsics[:, None, :2], intrinsics[:, None, 2:]
    return points[..., :2] / points[..., 2:].clamp(min=1e-6) * focal + centre


def _network(path: str | Path, kind: str) -> Any:
    model, meta = load_checkpoint(path)
    if meta["network"] != kind:
        raise ValueError(f"{path} holds a network of kind {meta['network']!r}, expected {kind!r}")
    return model


def _parts(frames: FrameTensors, batch_size: int) -> list[FrameTensors]:
    return [
        frames.take(range(first, min(first + batch_size, len(frames))))
        for first in range(0, len(frames), batch_size)
    ]


def _masks(model: Any, frames: FrameTensors) -> Tensor:
    """Masks of the object and, if the network knows it, the hand: bool (B, classes, H, W)."""
    with torch.no_grad():
        logits: Tensor = model(frames.inputs.color)  # (B, classes, H, W)
    return logits > 0


def _keypoints(model: Any, frames: FrameTensors, hand: Tensor) -> Tensor:
    from hadr.models.hand_keypoints import predict_keypoints

    with torch.no_grad():
        return predict_keypoints(model, frames.inputs, hand)
