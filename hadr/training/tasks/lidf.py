"""What LIDF is trained by: two stages in one training, told apart by the epoch.

The published network is trained twice: the first stage for 60 epochs, then, with that one frozen,
the refinement for 30. Here both are parts of one training, and the epoch's number alone decides:
the first `first_share` of the epochs belong to the first stage. So a resumed training goes on in
the same stage, and ends with the same weights as one that ran through. In each stage the other
one's weights get no gradient at all, not a gradient of zero, and Adam leaves such weights alone.

Source: Zhu et al. 2021 and its published code: weights of the loss, perturbation.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import torch
from torch import Tensor, nn

from hadr.models.network_input import ray_points
from hadr.training.frames.batches import FrameTensors
from hadr.training.losses import depth_loss
from hadr.training.recipe import Preset
from hadr.training.tasks.hadr import ray_terms

PERTURBATIONS: tuple[tuple[float, float, float], ...] = (
    (0.5, -0.05, 0.0),
    (0.3, 0.0, 0.05),
    (0.1, -0.1, -0.05),
    (0.1, 0.05, 0.1),
)
"""Chance, lower and upper end in metres along the ray of the ways to perturb the ends of a batch;
within them all lengths are alike. Read in the published code: one length for the whole batch."""


def first_epochs(recipe: Preset) -> int:
    """Count the epochs of the first stage."""
    config: Any = recipe.model
    return max(1, round(float(config.first_share) * recipe.epochs))


def stage(recipe: Preset, epoch: int) -> int:
    """Say which stage learns in an epoch: 1, or 2 for the refinement."""
    config: Any = recipe.model
    return 2 if config.refine and epoch >= first_epochs(recipe) else 1


def losses(
    recipe: Preset, model: nn.Module, batch: FrameTensors, epoch: int, generator: torch.Generator
) -> dict[str, Tensor]:
    """Score a batch: the weighted sum and its terms (`hadr.training.tasks.task.Loss`).

    The loss is that of HADR with the recipe's weights (`LIDF_WEIGHTS` are the published ones);
    for the refinement without the voxels' probability, which it can't change. "first_depth", in
    stage 2, is the depth term of the frozen first stage. ValueError where the epoch belongs to
    stage 1 and the refinement has begun: a training that was ended is resumed with so many more
    epochs that their share of the first stage is longer than all it had.
    """
    network: Any = model
    config: Any = recipe.model
    learns, weights = stage(recipe, epoch), recipe.weights
    if learns == 1 and network.refines:
        raise ValueError(
            f"the refinement has begun already, but of {recipe.epochs} epochs the first "
            f"{first_epochs(recipe)} are the first stage's, got epoch {epoch + 1}"
        )
    if learns == 2 and not network.refines:
        network.set_stage(2)
    start = torch.randint(recipe.ray_stride, (2,), generator=generator).tolist()
    told = learns == 1 and epoch < recipe.true_voxel_epochs
    moved_m = draw_perturbation(generator, config.perturb_probability) if learns == 2 else 0.0
    output, terms = ray_terms(recipe, model, batch, start, told=told, perturbation_m=moved_m)
    loss = terms.total(weights if learns == 1 else replace(weights, probability=0.0))
    found = {"loss": loss, **vars(terms)}
    if learns == 2:
        depth = batch.true_depth[tuple(output.rays.unbind(dim=1))]  # (rays,)
        truth = ray_points(output.rays, depth, batch.inputs.intrinsics)  # (rays, 3)
        counted = ((output.chosen >= 0) & (depth > 0)).nonzero().squeeze(1)
        found["first_depth"] = depth_loss(
            output.first_points[counted], truth[counted], weights.depth_over
        )
    return found


def draw_perturbation(generator: torch.Generator, probability: float) -> float:
    """Draw by `PERTURBATIONS` how far, metres, a batch's ends are moved; always three numbers."""
    happens, kind, place = torch.rand(3, generator=generator, dtype=torch.float64).tolist()
    if happens >= probability:
        return 0.0
    low, high = PERTURBATIONS[-1][1:]
    for chance, *ends in PERTURBATIONS:
        if kind < chance:
            low, high = ends
            break
        kind -= chance
    return float(low + place * (high - low))
