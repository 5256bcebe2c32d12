"""What TODE-Trans is trained by: L1 and normals, of the object and a little of the rest.

Source: Chen et al. 2023, "TODE-Trans", and its published code: each term is a mean over the
object's pixels plus 0.01 of the mean over all pixels, all frames of a batch together.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from hadr.training.frames.batches import FrameTensors
from hadr.training.losses import image_points, mean_where, normals_apart
from hadr.training.recipe import Preset

EVERYWHERE = 0.01
"""Weight of the whole image's mean beside the object's."""
NORMALS = 0.1
"""Weight of the normals."""


def losses(
    recipe: Preset, model: nn.Module, batch: FrameTensors, epoch: int, generator: torch.Generator
) -> dict[str, Tensor]:
    """Score a batch: the weighted sum and its four terms (`hadr.training.tasks.task.Loss`)."""
    image, truth = model(batch.inputs).image, batch.true_depth  # (B, H, W) each
    camera = batch.inputs.intrinsics
    known = truth > 0
    miss = (image - truth).abs()
    depth = mean_where(miss, known & batch.object_mask)
    everywhere = mean_where(miss, known)
    apart, whole = normals_apart(image_points(image, camera), image_points(truth, camera), known)
    on_object = mean_where(apart, whole & batch.object_mask[:, :-1, :-1])
    all_normals = mean_where(apart, whole)
    loss = depth + EVERYWHERE * everywhere + NORMALS * (on_object + EVERYWHERE * all_normals)
    return {
        "loss": loss,
        "depth": depth,
        "depth_everywhere": everywhere,
        "normals": on_object,
        "normals_everywhere": all_normals,
    }
