"""What HADR is trained by: its rays, its first epochs, its loss."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from hadr.models.network_input import masked_rays
from hadr.training.frames.batches import FrameTensors
from hadr.training.losses import LossTerms, hadr_losses
from hadr.training.recipe import Preset


def losses(
    recipe: Preset, model: nn.Module, batch: FrameTensors, epoch: int, generator: torch.Generator
) -> dict[str, Tensor]:
    """Score a batch: the weighted sum and its terms (`hadr.training.tasks.task.Loss`)."""
    start = torch.randint(recipe.ray_stride, (2,), generator=generator).tolist()
    told = epoch < recipe.true_voxel_epochs
    _, terms = ray_terms(recipe, model, batch, start, told=told)
    return {"loss": terms.total(recipe.weights), **vars(terms)}


def ray_terms(
    recipe: Preset,
    model: nn.Module,
    batch: FrameTensors,
    start: list[int],
    *,
    told: bool,
    **more: Any,
) -> tuple[Any, LossTerms]:
    """Restore strided rays from a first row and column on, and score them; more for the model.

    Where `told`, each ray takes its true voxel.
    """
    config: Any = recipe.model
    output = model(
        batch.inputs,
        rays=masked_rays(batch.inputs.mask, recipe.ray_stride, *start),
        true_depth=batch.true_depth if told else None,
        **more,
    )
    return output, hadr_losses(
        output,
        batch.true_depth,
        batch.inputs.intrinsics,
        config.grid,
        depth_over=recipe.weights.depth_over,
        ray_stride=recipe.ray_stride,
    )
