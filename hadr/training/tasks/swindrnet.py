"""What SwinDRNet is trained by: depth, normals and gradient, on and off the object.

Published are the weights below; AdamW with a weight decay of 0.01, whose rate rises to 1e-4 in 500
steps and falls from there linearly to 0; batches of 8 and 20 epochs. The same loss is taken of the
mixed image and, with a weight of 0.4, of the depth head's own. Means run over all pixels of a
batch, not frame by frame.

Where true depth is unknown nothing is asked for; and the gradient is compared where its window of
3x3 pixels lies in the image (the published code pads with zeros, so that at the border it compares
depth itself).

Source: Dai et al. 2022, "Domain Randomization-Enhanced Depth Simulation and Restoration for
Perceiving and Grasping Specular and Transparent Objects", and the published training.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from hadr.training.frames.batches import FrameTensors
from hadr.training.losses import image_points, mean_where, normals
from hadr.training.recipe import Preset

OBJECT_WEIGHT = 1.0
BACKGROUND_WEIGHT = 0.4
NORMALS_WEIGHT = 0.1
GRADIENT_WEIGHT = 0.6
INITIAL_WEIGHT = 0.4
"""Weight of the depth head's image; that of the mixed one is 1."""


def losses(
    recipe: Preset, model: nn.Module, batch: FrameTensors, epoch: int, generator: torch.Generator
) -> dict[str, Tensor]:
    """Score a batch: the sum, its terms on the object, and depth off the object."""
    output = model(batch.inputs)
    truth, intrinsics, glass = batch.true_depth, batch.inputs.intrinsics, batch.object_mask
    on, off = image_terms(output.image, truth, intrinsics, glass)
    initial_on, initial_off = image_terms(output.initial, truth, intrinsics, glass)
    mixed = OBJECT_WEIGHT * on.total + BACKGROUND_WEIGHT * off.total
    initial = OBJECT_WEIGHT * initial_on.total + BACKGROUND_WEIGHT * initial_off.total
    return {
        "loss": mixed + INITIAL_WEIGHT * initial,
        "depth": on.depth,
        "normals": on.normals,
        "gradient": on.gradient,
        "background": off.depth,
        "initial": initial_on.depth,
    }


@dataclass(frozen=True)
class ImageTerms:
    """How far a depth image is from the truth in a part of the pixels; each 0 at best.

    Attributes:
        depth: Mean absolute error, metres.
        normals: Mean absolute error of the normals' three components.
        gradient: Mean absolute error of Sobel's two derivatives, added; metres, where a slope of
            one metre a pixel counts as 8.
    """

    depth: Tensor
    normals: Tensor
    gradient: Tensor

    @property
    def total(self) -> Tensor:
        """The weighted sum."""
        return self.depth + NORMALS_WEIGHT * self.normals + GRADIENT_WEIGHT * self.gradient


def image_terms(
    depth: Tensor, truth: Tensor, intrinsics: Tensor, glass: Tensor
) -> tuple[ImageTerms, ImageTerms]:
    """Compare depth (B, H, W) with the truth, 0 = unknown, on the object and off it.

    A normal belongs where its pixel does, and counts if true depth is known there, to the right
    and below; a gradient belongs where the middle of its window does, and counts if true depth is
    known in all of it.
    """
    known = truth > 0
    error = (depth - truth) * known  # (B, H, W)
    clouds = [image_points(image, intrinsics) for image in (depth, truth)]
    turn = normals(clouds[0]) - normals(clouds[1])
    slope, turn = _slope(error), turn.abs().mean(dim=-1)  # (B, H - 2, W - 2), (B, H - 1, W - 1)
    corner = known[:, :-1, :-1] & known[:, :-1, 1:] & known[:, 1:, :-1]  # (B, H - 1, W - 1)
    rows = known[:, :-2] & known[:, 1:-1] & known[:, 2:]  # (B, H - 2, W)
    window = rows[:, :, :-2] & rows[:, :, 1:-1] & rows[:, :, 2:]  # (B, H - 2, W - 2)
    on, off = (
        ImageTerms(
            depth=mean_where(error.abs(), known & part),
            normals=mean_where(turn, corner & part[:, :-1, :-1]),
            gradient=mean_where(slope, window & part[:, 1:-1, 1:-1]),
        )
        for part in (glass, ~glass)
    )
    return on, off


def _slope(image: Tensor) -> Tensor:
    """Absolute derivatives across and down by Sobel's windows, added: (B, H - 2, W - 2)."""
    down = image[:, :-2] + 2 * image[:, 1:-1] + image[:, 2:]  # (B, H - 2, W)
    across = image[:, :, :-2] + 2 * image[:, :, 1:-1] + image[:, :, 2:]  # (B, H, W - 2)
    return (down[:, :, 2:] - down[:, :, :-2]).abs() + (across[:, 2:] - across[:, :-2]).abs()
