"""LIDF as the training loop sees it: two stages in one training, told apart by the epoch.

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

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn

from hadr.models.hadr_input import masked_rays, ray_points
from hadr.rivals.lidf import LIDF, LIDFConfig, LIDFOutput
from hadr.training.batches import FrameTensors
from hadr.training.losses import depth_loss, hadr_losses
from hadr.training.pictures import depth_picture
from hadr.training.recipe import Preset
from hadr.training.tasks.hadr_task import validate_depth

PERTURBATIONS: tuple[tuple[float, float, float], ...] = (
    (0.5, -0.05, 0.0),
    (0.3, 0.0, 0.05),
    (0.1, -0.1, -0.05),
    (0.1, 0.05, 0.1),
)
"""Chance, lower and upper end in metres along the ray of the ways to perturb the ends of a batch;
within them all lengths are alike. Read in the published code: one length for the whole batch."""


class LIDFTask:
    """Training of LIDF.

    The loss is that of HADR with the recipe's weights (`LIDF_WEIGHTS` are the published ones);
    for the refinement without the voxels' probability, which it can't change.

    Args:
        recipe: Network and loss, epochs, true-voxel epochs and the stride of the rays.

    Raises:
        ValueError: The recipe is that of another network.
    """

    network = "lidf"

    def __init__(self, recipe: Preset) -> None:
        if not isinstance(recipe.model, LIDFConfig):
            raise ValueError(f"recipe {recipe.name!r} of {recipe.network!r} is none of LIDF")
        self.recipe, self.config = recipe, recipe.model
        self.first_epochs = max(1, round(self.config.first_share * recipe.epochs))

    def build(self) -> LIDF:
        """Build the network with fresh weights."""
        return LIDF(self.config)

    def stage(self, epoch: int) -> int:
        """Say which stage learns in an epoch: 1, or 2 for the refinement."""
        return 2 if self.config.refine and epoch >= self.first_epochs else 1

    def losses(
        self, model: nn.Module, batch: FrameTensors, epoch: int, generator: torch.Generator
    ) -> dict[str, Tensor]:
        """Score a batch: the weighted sum and its terms.

        "first_depth", in stage 2, is the depth term of the frozen first stage.

        Raises:
            ValueError: The epoch belongs to stage 1 and the network's refinement has begun: a
                training that was ended is resumed with so many more epochs that their share of
                the first stage is longer than all it had.
        """
        network: Any = model
        stage, stride, weights = self.stage(epoch), self.recipe.ray_stride, self.recipe.weights
        if stage == 1 and network.refines:
            raise ValueError(
                f"the refinement has begun already, but of {self.recipe.epochs} epochs the first "
                f"{self.first_epochs} are the first stage's, got epoch {epoch + 1}"
            )
        if stage == 2 and not network.refines:
            network.set_stage(2)
        row, column = torch.randint(stride, (2,), generator=generator).tolist()
        told = stage == 1 and epoch < self.recipe.true_voxel_epochs
        output: LIDFOutput = model(
            batch.inputs,
            rays=masked_rays(batch.inputs.mask, stride, row, column),
            true_depth=batch.true_depth if told else None,
            perturbation_m=(
                draw_perturbation(generator, self.config.perturb_probability) if stage == 2 else 0.0
            ),
        )
        terms = hadr_losses(
            output,
            batch.true_depth,
            batch.inputs.intrinsics,
            self.config.grid,
            depth_over=weights.depth_over,
            ray_stride=stride,
        )
        found = {
            "loss": terms.total(weights if stage == 1 else replace(weights, probability=0.0)),
            "depth": terms.depth,
            "probability": terms.probability,
            "normals": terms.normals,
            "voxel_accuracy": terms.voxel_accuracy,
            "without_true_voxel": terms.without_true_voxel,
        }
        if stage == 2:
            depth = batch.true_depth[tuple(output.rays.unbind(dim=1))]  # (rays,)
            truth = ray_points(output.rays, depth, batch.inputs.intrinsics)  # (rays, 3)
            counted = ((output.chosen >= 0) & (depth > 0)).nonzero().squeeze(1)
            found["first_depth"] = depth_loss(
                output.first_points[counted], truth[counted], weights.depth_over
            )
        return found

    def validate(self, model: nn.Module, frames: FrameTensors, batch_size: int) -> dict[str, float]:
        """Score the restored depth on the object's pixels, per-frame means."""
        return validate_depth(model, frames, batch_size)

    def picture(self, model: nn.Module, frames: FrameTensors) -> npt.NDArray[np.uint8]:
        """Draw restored depth beside the truth."""
        return depth_picture(model, frames)


def draw_perturbation(generator: torch.Generator, probability: float) -> float:
    """Draw how far the ends of a batch are moved before they are refined.

    Args:
        generator: Source of the numbers; always three are taken.
        probability: Chance that they are moved at all, 0..1.

    Returns:
        Metres along the rays, -0.1 to 0.1, by `PERTURBATIONS`; 0 where they are not moved.
    """
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
