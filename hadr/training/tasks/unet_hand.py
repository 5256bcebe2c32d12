"""What the plain U-Net with the hand is trained by: L1 over depth and over its steps."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from hadr.training.frames.batches import FrameTensors
from hadr.training.losses import frame_mean
from hadr.training.recipe import Preset

UNIT_LOSS = 20.0
"""Loss of a metre: so that losses, and the longest gradient of a recipe, have a size like 1."""


def losses(
    recipe: Preset, model: nn.Module, batch: FrameTensors, epoch: int, generator: torch.Generator
) -> dict[str, Tensor]:
    """Score a batch in metres: depth, and its steps from a pixel to the next.

    The first is small when the object is where it should be, the second when its shape is right.
    A step counts where both pixels do. Each frame counts the same, as it does in the scores.
    """
    counted = batch.inputs.mask & (batch.true_depth > 0)
    miss = (model(batch.inputs).depth - batch.true_depth) * counted  # (B, H, W)
    across = counted[:, :, 1:] & counted[:, :, :-1]
    down = counted[:, 1:] & counted[:, :-1]
    steps = ((miss[:, :, 1:] - miss[:, :, :-1]).abs() * across).sum(dim=(1, 2)) + (
        (miss[:, 1:] - miss[:, :-1]).abs() * down
    ).sum(dim=(1, 2))
    depth = frame_mean(miss.abs().sum(dim=(1, 2)), counted.sum(dim=(1, 2)))
    step = frame_mean(steps, across.sum(dim=(1, 2)) + down.sum(dim=(1, 2)))
    return {"loss": UNIT_LOSS * (depth + step), "depth": depth, "step": step}
