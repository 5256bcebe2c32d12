"""HADR as the training loop sees it: its rays, its first epochs, its loss."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn

from hadr.metrics import mean_over_frames
from hadr.models.hadr import HADR, HADRConfig, masked_rays
from hadr.training.batches import FrameTensors
from hadr.training.evaluation import evaluate
from hadr.training.losses import hadr_losses
from hadr.training.pictures import depth_picture
from hadr.training.recipe import Preset


class HADRTask:
    """Training of HADR.

    Args:
        recipe: Network and loss, true-voxel epochs and the stride of the rays.

    Raises:
        ValueError: The recipe is that of another network.
    """

    network = "hadr"

    def __init__(self, recipe: Preset) -> None:
        if not isinstance(recipe.model, HADRConfig):
            raise ValueError(f"recipe {recipe.name!r} of {recipe.network!r} is none of HADR")
        self.recipe, self.config = recipe, recipe.model

    def build(self) -> HADR:
        """Build the network with fresh weights, or with the published ones it names."""
        return HADR(self.config)

    def losses(
        self, model: nn.Module, batch: FrameTensors, epoch: int, generator: torch.Generator
    ) -> dict[str, Tensor]:
        """Score a batch: the weighted sum and its terms."""
        stride, weights = self.recipe.ray_stride, self.recipe.weights
        row, column = torch.randint(stride, (2,), generator=generator).tolist()
        output = model(
            batch.inputs,
            rays=masked_rays(batch.inputs.mask, stride, row, column),
            true_depth=batch.true_depth if epoch < self.recipe.true_voxel_epochs else None,
        )
        terms = hadr_losses(
            output,
            batch.true_depth,
            batch.inputs.intrinsics,
            self.config.grid,
            depth_over=weights.depth_over,
            ray_stride=stride,
        )
        return {
            "loss": terms.total(weights),
            "depth": terms.depth,
            "probability": terms.probability,
            "normals": terms.normals,
            "voxel_accuracy": terms.voxel_accuracy,
            "without_true_voxel": terms.without_true_voxel,
        }

    def validate(self, model: nn.Module, frames: FrameTensors, batch_size: int) -> dict[str, float]:
        """Score the restored depth on the object's pixels, per-frame means."""
        return validate_depth(model, frames, batch_size)

    def picture(self, model: nn.Module, frames: FrameTensors) -> npt.NDArray[np.uint8]:
        """Draw restored depth beside the truth."""
        return depth_picture(model, frames)


def validate_depth(model: nn.Module, frames: FrameTensors, batch_size: int) -> dict[str, float]:
    """Score any network that restores depth, on the object's pixels, at the frames' own size.

    Args:
        model: A depth network.
        frames: The frames.
        batch_size: Frames at a time.

    Returns:
        RMSE and MAE in metres and the share within 5 %, each a mean over the frames.
    """
    scores = mean_over_frames(evaluate(model, frames, batch_size))
    return {
        "validation_rmse_m": scores.rmse_m,
        "validation_mae_m": scores.mae_m,
        "validation_delta_105": scores.delta_105,
    }
