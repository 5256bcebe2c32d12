"""What DFNet is trained by: squared error of depth and a little for wrong normals.

Source: Fang et al. 2022, "TransCG", and its published code.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from hadr.training.frames.batches import FrameTensors
from hadr.training.losses import image_points, mean_where, normals_apart
from hadr.training.recipe import Preset

NORMALS_WEIGHT = 0.001
"""Weight of (1 - cos) of the normals beside the squared error in square metres, as published."""
UNIT_LOSS = 1000.0
"""Loss of a square metre: the published sum is multiplied by it, to have a size like 1."""


def losses(
    recipe: Preset, model: nn.Module, batch: FrameTensors, epoch: int, generator: torch.Generator
) -> dict[str, Tensor]:
    """Score a batch by what the network says of the whole image (`hadr.training.tasks.task.Loss`).

    A pixel counts where its true depth is known and in the configured range and it is one of the
    object's true pixels, as in the published code for cluttered scenes: the network is not given
    the mask, so a predicted one has no part in it. A normal counts at such a pixel where the true
    depth of the next pixels in column and row is known too, on the object or not. Each pixel of the
    batch counts the same, as published. Frames whose given depth is missing everywhere do not
    count.
    """
    config: Any = recipe.model
    image, truth = model(batch.inputs).image, batch.true_depth  # (B, H, W) each
    camera = batch.inputs.intrinsics
    usable = config.in_range(batch.inputs.depth).flatten(1).any(dim=1)  # (B,)
    known = config.in_range(truth) & usable[:, None, None]
    counted = known & batch.object_mask
    mse = mean_where((image - truth) ** 2, counted)
    apart, whole = normals_apart(image_points(image, camera), image_points(truth, camera), known)
    turned = mean_where(apart, whole & counted[:, :-1, :-1])
    return {"loss": UNIT_LOSS * (mse + NORMALS_WEIGHT * turned), "mse": mse, "normals": turned}
