"""TODE-Trans as the training loop sees it: L1 and normals, of the object and a little of the rest.

Source: Chen et al. 2023, "TODE-Trans", and its published code: each term is a mean over the
object's pixels plus 0.01 of the mean over all pixels, all frames of a batch together.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn

from hadr.models.hadr_input import masked_rays, ray_points
from hadr.rivals.tode import TODEConfig, TODETrans
from hadr.training.batches import FrameTensors
from hadr.training.losses import normals
from hadr.training.pictures import depth_picture
from hadr.training.recipe import Preset
from hadr.training.tasks.hadr_task import validate_depth
from hadr.training.tasks.task import shared_mean

EVERYWHERE = 0.01
"""Weight of the whole image's mean beside the object's."""
NORMALS = 0.1
"""Weight of the normals."""


class TODETask:
    """Training of TODE-Trans.

    Args:
        recipe: The network and its schedule.

    Raises:
        ValueError: The recipe is that of another network.
    """

    network = "tode"

    def __init__(self, recipe: Preset) -> None:
        if not isinstance(recipe.model, TODEConfig):
            raise ValueError(f"recipe {recipe.name!r} of {recipe.network!r} is none of tode")
        self.config = recipe.model

    def build(self) -> TODETrans:
        """Build the network with fresh weights."""
        return TODETrans(self.config)

    def losses(
        self, model: nn.Module, batch: FrameTensors, epoch: int, generator: torch.Generator
    ) -> dict[str, Tensor]:
        """Score a batch: the weighted sum and its four terms."""
        image = model(batch.inputs).image  # (B, H, W)
        known = batch.true_depth > 0
        miss = (image - batch.true_depth).abs()
        depth = masked_mean(miss, known & batch.object_mask)
        everywhere = masked_mean(miss, known)
        apart, whole = normals_apart(image, batch.true_depth, batch.inputs.intrinsics)
        on_object = masked_mean(apart, whole & batch.object_mask[:, :-1, :-1])
        all_normals = masked_mean(apart, whole)
        loss = depth + EVERYWHERE * everywhere + NORMALS * (on_object + EVERYWHERE * all_normals)
        return {
            "loss": loss,
            "depth": depth,
            "depth_everywhere": everywhere,
            "normals": on_object,
            "normals_everywhere": all_normals,
        }

    def validate(self, model: nn.Module, frames: FrameTensors, batch_size: int) -> dict[str, float]:
        """Score the restored depth on the object's pixels, per-frame means."""
        return validate_depth(model, frames, batch_size)

    def picture(self, model: nn.Module, frames: FrameTensors) -> npt.NDArray[np.uint8]:
        """Draw restored depth beside the truth."""
        return depth_picture(model, frames)


def masked_mean(values: Tensor, counted: Tensor) -> Tensor:
    """Mean over the pixels that count, of all frames together; 0 where none does.

    Args:
        values: Shape (B, H, W).
        counted: Shape (B, H, W), bool.
    """
    return shared_mean((values * counted).sum(), counted.sum())


def normals_apart(depth: Tensor, true_depth: Tensor, intrinsics: Tensor) -> tuple[Tensor, Tensor]:
    """Compare the normals of two depth images, each from a pixel and the next two.

    Args:
        depth: z-depth in metres, shape (B, H, W).
        true_depth: True z-depth, shape (B, H, W); 0 = unknown.
        intrinsics: fx, fy, cx, cy of each frame, pixels, shape (B, 4).

    Returns:
        1 - cos of the angle between them, shape (B, H - 1, W - 1): 0 = parallel, 2 = opposite;
        and where the truth has a normal, which takes the pixel, the next in its row and the next
        in its column, the same shape, bool.
    """
    known = true_depth > 0
    pixels = masked_rays(torch.ones_like(known))  # (B * H * W, 3)
    of_both = [
        normals(ray_points(pixels, image.flatten(), intrinsics).view(*known.shape, 3))
        for image in (depth, true_depth)
    ]  # (B, H - 1, W - 1, 3) each
    whole = known[:, :-1, :-1] & known[:, :-1, 1:] & known[:, 1:, :-1]
    return 1 - (of_both[0] * of_both[1]).sum(dim=-1), whole
