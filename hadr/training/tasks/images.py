"""What networks of whole depth images are trained by: DFNet, SwinDRNet, TODE-Trans, the U-Net.

Each function is a `hadr.training.tasks.task.Loss`. True depth that is unknown asks for nothing. The
rivals' means run over the pixels of a batch, not frame by frame, as in their published codes; of
those, differences are said where they are.

Source: Fang et al. 2022, "TransCG"; Dai et al. 2022, "Domain Randomization-Enhanced Depth
Simulation and Restoration for Perceiving and Grasping Specular and Transparent Objects"; Chen et
al. 2023, "TODE-Trans"; and their published codes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from hadr.training.frames.batches import FrameTensors
from hadr.training.losses import frame_mean, image_points, mean_where, normals, normals_apart
from hadr.training.recipe import Preset

DFNET_NORMALS = 0.001
"""Weight of (1 - cos) of the normals beside the squared error in square metres, as published."""
DFNET_UNIT = 1000.0
"""Loss of a square metre: the published sum is multiplied by it, to have a size like 1."""
OBJECT_WEIGHT = 1.0
BACKGROUND_WEIGHT = 0.4
NORMALS_WEIGHT = 0.1
GRADIENT_WEIGHT = 0.6
INITIAL_WEIGHT = 0.4
"""Weight of SwinDRNet's depth head's image; that of the mixed one is 1."""
TODE_EVERYWHERE = 0.01
"""Weight of the whole image's mean beside the object's."""
TODE_NORMALS = 0.1
UNET_UNIT = 20.0
"""Loss of a metre: so that losses, and the longest gradient of a recipe, have a size like 1."""


def dfnet(
    recipe: Preset, model: nn.Module, batch: FrameTensors, epoch: int, generator: torch.Generator
) -> dict[str, Tensor]:
    """Score squared depth, and a little wrong normals, by what DFNet says of the whole image.

    A pixel counts where its true depth is known and in the configured range and it is one of the
    object's true pixels, as in the published code for cluttered scenes: the network is not given
    the mask, so a predicted one has no part in it. A normal counts at such a pixel where the true
    depth of the next pixels in column and row is known too, on the object or not. Frames whose
    given depth is missing everywhere do not count.
    """
    config: Any = recipe.model
    image, truth = model(batch.inputs).image, batch.true_depth  # (B, H, W) each
    usable = config.in_range(batch.inputs.depth).flatten(1).any(dim=1)  # (B,)
    known = config.in_range(truth) & usable[:, None, None]
    counted = known & batch.object_mask
    mse = mean_where((image - truth) ** 2, counted)
    apart, whole = _turned(image, batch, known)
    turned = mean_where(apart, whole & counted[:, :-1, :-1])
    return {"loss": DFNET_UNIT * (mse + DFNET_NORMALS * turned), "mse": mse, "normals": turned}


def tode(
    recipe: Preset, model: nn.Module, batch: FrameTensors, epoch: int, generator: torch.Generator
) -> dict[str, Tensor]:
    """Score depth and normals by L1: the object's mean, and 0.01 of that over all pixels."""
    image, truth = model(batch.inputs).image, batch.true_depth  # (B, H, W) each
    known = truth > 0
    miss = (image - truth).abs()
    depth = mean_where(miss, known & batch.object_mask)
    everywhere = mean_where(miss, known)
    apart, whole = _turned(image, batch, known)
    on_object = mean_where(apart, whole & batch.object_mask[:, :-1, :-1])
    all_normals = mean_where(apart, whole)
    both = on_object + TODE_EVERYWHERE * all_normals
    return {
        "loss": depth + TODE_EVERYWHERE * everywhere + TODE_NORMALS * both,
        "depth": depth,
        "depth_everywhere": everywhere,
        "normals": on_object,
        "normals_everywhere": all_normals,
    }


def _turned(image: Tensor, batch: FrameTensors, known: Tensor) -> tuple[Tensor, Tensor]:
    """How far the normals are turned, and where that is known (`normals_apart`)."""
    camera = batch.inputs.intrinsics
    truth = image_points(batch.true_depth, camera)
    return normals_apart(image_points(image, camera), truth, known)


def unet_hand(
    recipe: Preset, model: nn.Module, batch: FrameTensors, epoch: int, generator: torch.Generator
) -> dict[str, Tensor]:
    """Score depth, and its steps from a pixel to the next, by L1 in metres.

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
    return {"loss": UNET_UNIT * (depth + step), "depth": depth, "step": step}


def swindrnet(
    recipe: Preset, model: nn.Module, batch: FrameTensors, epoch: int, generator: torch.Generator
) -> dict[str, Tensor]:
    """Score the mixed image and, with a weight of 0.4, the depth head's own.

    The gradient is compared where its window of 3x3 pixels lies in the image (the published code
    pads with zeros, so that at the border it compares depth itself).
    """
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
