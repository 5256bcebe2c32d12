"""What HADR is trained by: its rays, its first epochs, its loss."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from hadr.models.network_input import masked_rays
from hadr.training.frames.batches import FrameTensors
from hadr.training.losses import hadr_losses
from hadr.training.recipe import Preset


def losses(
    recipe: Preset, model: nn.Module, batch: FrameTensors, epoch: int, generator: torch.Generator
) -> dict[str, Tensor]:
    """Score a batch: the weighted sum and its terms (`hadr.training.tasks.task.Loss`)."""
    config: Any = recipe.model
    row, column = torch.randint(recipe.ray_stride, (2,), generator=generator).tolist()
    output = model(
        batch.inputs,
        rays=masked_rays(batch.inputs.mask, recipe.ray_stride, row, column),
        true_depth=batch.true_depth if epoch < recipe.true_voxel_epochs else None,
    )
    terms = hadr_losses(
        output,
        batch.true_depth,
        batch.inputs.intrinsics,
        config.grid,
        depth_over=recipe.weights.depth_over,
        ray_stride=recipe.ray_stride,
    )
    return {"loss": terms.total(recipe.weights), **vars(terms)}
