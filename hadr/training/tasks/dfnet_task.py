"""DFNet as the training loop sees it: squared error of depth and a little for wrong normals."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn

from hadr.rivals.dfnet import DFNet, DFNetConfig
from hadr.training.batches import FrameTensors
from hadr.training.losses import normals
from hadr.training.pictures import depth_picture
from hadr.training.recipe import Preset
from hadr.training.tasks.hadr_task import validate_depth
from hadr.training.tasks.task import shared_mean

Pixels = Literal["object", "image"]
"""Which pixels count: the object's, or all."""
NORMALS_WEIGHT = 0.001
"""Weight of (1 - cos) of the normals beside the squared error in square metres, as published."""
UNIT_LOSS = 1000.0
"""Loss of a square metre: the published sum is multiplied by it, to have a size like 1."""


class DFNetTask:
    """Training of DFNet.

    Args:
        recipe: The network and its schedule.
        pixels: Which pixels count, see `losses`. The published code takes "object" in cluttered
            scenes and "image" in those of a single thing; its metrics are the object's.

    Raises:
        ValueError: The recipe is that of another network, or `pixels` is unknown.
    """

    network = "dfnet"

    def __init__(self, recipe: Preset, pixels: Pixels = "object") -> None:
        if not isinstance(recipe.model, DFNetConfig):
            raise ValueError(f"recipe {recipe.name!r} of {recipe.network!r} is none of dfnet")
        if pixels not in get_args(Pixels):
            raise ValueError(f"pixels must be 'object' or 'image', got {pixels!r}")
        self.config, self.pixels = recipe.model, pixels

    def build(self) -> DFNet:
        """Build the network with fresh weights."""
        return DFNet(self.config)

    def losses(
        self, model: nn.Module, batch: FrameTensors, epoch: int, generator: torch.Generator
    ) -> dict[str, Tensor]:
        """Score a batch by what the network says of the whole image.

        A pixel counts where its true depth is known and in the configured range and, with
        "object", where it is one of the object's true pixels: the network is not given the mask,
        so a predicted one has no part in it. A normal counts at such a pixel where the true depth
        of the next pixels in column and row is known too, on the object or not. Each pixel of the
        batch counts the same, as published. Frames whose given depth is missing everywhere do not
        count.
        """
        image = model(batch.inputs).image  # (B, H, W)
        truth = batch.true_depth
        usable = self.config.in_range(batch.inputs.depth).flatten(1).any(dim=1)  # (B,)
        known = self.config.in_range(truth) & usable[:, None, None]
        counted = known & batch.object_mask if self.pixels == "object" else known
        mse = shared_mean(((image - truth) ** 2 * counted).sum(), counted.sum())
        turned = normals_miss(image, truth, batch.inputs.intrinsics, counted, known)
        return {
            "loss": UNIT_LOSS * (mse + NORMALS_WEIGHT * turned),
            "mse": mse,
            "normals": turned,
        }

    def validate(self, model: nn.Module, frames: FrameTensors, batch_size: int) -> dict[str, float]:
        """Score the restored depth on the object's pixels, per-frame means."""
        return validate_depth(model, frames, batch_size)

    def picture(self, model: nn.Module, frames: FrameTensors) -> npt.NDArray[np.uint8]:
        """Draw restored depth beside the truth."""
        return depth_picture(model, frames)


def normals_miss(
    depth: Tensor, truth: Tensor, intrinsics: Tensor, counted: Tensor, known: Tensor
) -> Tensor:
    """Mean of 1 - cos between the normals of two depth images.

    Args:
        depth: z-depth in metres, shape (B, H, W).
        truth: True z-depth, shape (B, H, W).
        intrinsics: fx, fy, cx, cy of each frame, shape (B, 4).
        counted: Pixels that count, shape (B, H, W), bool.
        known: Where the truth is known, shape (B, H, W), bool; a normal counts where its pixel
            counts and the next ones in column and row are known.

    Returns:
        One number from 0 (parallel) to 2 (opposite); 0 where no normal counts.
    """
    counts = counted[:, :-1, :-1] & known[:, :-1, 1:] & known[:, 1:, :-1]  # (B, H - 1, W - 1)
    found, right = (normals(image_points(image, intrinsics)) for image in (depth, truth))
    return shared_mean(((1 - (found * right).sum(dim=-1)) * counts).sum(), counts.sum())


def image_points(depth: Tensor, intrinsics: Tensor) -> Tensor:
    """Lift whole depth images to points.

    Args:
        depth: z-depth in metres, shape (B, H, W).
        intrinsics: fx, fy, cx, cy of each frame in pixels, shape (B, 4).

    Returns:
        Points in metres, camera frame, shape (B, H, W, 3).
    """
    height, width = depth.shape[1:]
    fx, fy, cx, cy = intrinsics[:, :, None, None].unbind(dim=1)  # (B, 1, 1) each
    columns = torch.arange(width, device=depth.device)  # (W,)
    rows = torch.arange(height, device=depth.device)[:, None]  # (H, 1)
    return torch.stack(((columns - cx) / fx * depth, (rows - cy) / fy * depth, depth), dim=-1)
