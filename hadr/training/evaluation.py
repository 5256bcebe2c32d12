"""Evaluation: the network and the methods without learning, on the same pixels of the same frames.

All are scored at the frames' resolution, on the object's pixels, with `hadr.metrics`. A pixel
without a predicted depth is scored as the depth 0 that stands in the image, so that no method
gains by leaving out what is difficult.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import torch
from torch import nn

from hadr.camera import BoolArray, FloatArray
from hadr.metrics import DepthMetrics, frame_metrics, mean_over_frames
from hadr.models.hadr import HADROutput
from hadr.rivals import classical
from hadr.training.frames.batches import FrameTensors

Restorer = Callable[[FrameTensors, int], FloatArray]
"""From the frames and a frame's number to restored z-depth in metres, shape (H, W)."""


def predict(model: nn.Module, frames: FrameTensors, batch_size: int = 8) -> list[HADROutput]:
    """Restore all frames; one output a batch. The network is in evaluation mode meanwhile."""
    was_training = model.training
    device = next(model.parameters()).device
    model.eval()
    with torch.no_grad():
        outputs = [
            model(frames.inputs.take(slice(first, first + batch_size)).to(device))
            for first in range(0, len(frames), batch_size)
        ]
    model.train(was_training)
    return outputs


def predict_depth(model: nn.Module, frames: FrameTensors, batch_size: int = 8) -> FloatArray:
    """Give all frames' depth, (N, H, W) metres: restored in the mask, as measured elsewhere."""
    restored = torch.cat([output.depth.cpu() for output in predict(model, frames, batch_size)])
    depth: FloatArray = torch.where(frames.inputs.mask, restored, frames.inputs.depth).numpy()
    return depth


def score(depth: FloatArray, frames: FrameTensors) -> list[DepthMetrics]:
    """Score depth images (N, H, W), metres, on the object's pixels; 0 = missing counts as 0."""
    truth, mask = frames.true_depth.numpy(), frames.object_mask.numpy()
    return [
        frame_metrics(depth[number], truth[number], mask[number], missing="zero")
        for number in range(len(frames))
    ]


def evaluate(model: nn.Module, frames: FrameTensors, batch_size: int = 8) -> list[DepthMetrics]:
    """Score a network on the object's pixels of each frame; `mean_over_frames` averages."""
    return score(predict_depth(model, frames, batch_size), frames)


def _parts(frames: FrameTensors, number: int) -> tuple[FloatArray, BoolArray]:
    return frames.inputs.depth[number].numpy(), frames.inputs.mask[number].numpy()


def _hand_median(frames: FrameTensors, number: int) -> FloatArray:
    keypoints, uv = frames.inputs.keypoints[number], frames.inputs.keypoints_uv[number]
    return classical.hand_median(
        *_parts(frames, number),
        uv.numpy().astype(np.float64),
        keypoints[:, 2].numpy().astype(np.float64),
        frames.hand_mask[number].numpy(),
    )


CLASSICAL: dict[str, Restorer] = {
    "raw": lambda frames, number: classical.raw(*_parts(frames, number)),
    "inpainting": lambda frames, number: classical.inpaint(*_parts(frames, number)),
    "nearest": lambda frames, number: classical.nearest_valid(*_parts(frames, number)),
    "hand-median": _hand_median,
}
"""The methods that learn nothing, by the names that tables give them."""


def compare(
    frames: FrameTensors, models: Mapping[str, nn.Module], batch_size: int = 8
) -> dict[str, list[DepthMetrics]]:
    """Score the methods without learning and some networks on the same frames.

    Gives the metrics of each frame by the method's name, the classical ones first.
    """
    rows = {
        name: score(np.stack([restorer(frames, n) for n in range(len(frames))]), frames)
        for name, restorer in CLASSICAL.items()
    }
    rows.update({name: evaluate(model, frames, batch_size) for name, model in models.items()})
    return rows


def averages(rows: Mapping[str, list[DepthMetrics]]) -> dict[str, DepthMetrics]:
    """Average each method's metrics over the frames."""
    return {name: mean_over_frames(metrics) for name, metrics in rows.items()}
