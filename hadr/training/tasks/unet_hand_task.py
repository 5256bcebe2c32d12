"""The plain U-Net with the hand as the training loop sees it: L1 over depth and over its steps."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn

from hadr.rivals.unet_hand import UNetHand, UNetHandConfig
from hadr.training.batches import FrameTensors
from hadr.training.image_losses import depth_and_steps
from hadr.training.pictures import depth_picture
from hadr.training.recipe import Preset
from hadr.training.tasks.hadr_task import validate_depth

UNIT_LOSS = 20.0
"""Loss of a metre: so that losses, and the longest gradient of a recipe, have a size like 1."""


class UNetHandTask:
    """Training of the plain U-Net with the hand.

    Args:
        recipe: The network and its schedule.

    Raises:
        ValueError: The recipe is that of another network.
    """

    network = "unet-hand"

    def __init__(self, recipe: Preset) -> None:
        if not isinstance(recipe.model, UNetHandConfig):
            raise ValueError(f"recipe {recipe.name!r} of {recipe.network!r} is none of unet-hand")
        self.config = recipe.model

    def build(self) -> UNetHand:
        """Build the network with fresh weights."""
        return UNetHand(self.config)

    def losses(
        self, model: nn.Module, batch: FrameTensors, epoch: int, generator: torch.Generator
    ) -> dict[str, Tensor]:
        """Score a batch: depth, and its steps from a pixel to the next, in metres."""
        counted = batch.inputs.mask & (batch.true_depth > 0)
        depth, steps = depth_and_steps(model(batch.inputs).depth, batch.true_depth, counted)
        return {"loss": UNIT_LOSS * (depth + steps), "depth": depth, "step": steps}

    def validate(self, model: nn.Module, frames: FrameTensors, batch_size: int) -> dict[str, float]:
        """Score the restored depth on the object's pixels, per-frame means."""
        return validate_depth(model, frames, batch_size)

    def picture(self, model: nn.Module, frames: FrameTensors) -> npt.NDArray[np.uint8]:
        """Draw restored depth beside the truth."""
        return depth_picture(model, frames)
