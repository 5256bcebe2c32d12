"""What the segmentation network is trained by, cross-entropy and Dice; it is scored by IoU."""

from __future__ import annotations

from typing import cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from hadr.models.segmentation import SegmentationNet, predict_logits
from hadr.training.frames.batches import FrameTensors
from hadr.training.losses import mean_of
from hadr.training.recipe import Preset

_TARGETS = {"object": "object_mask", "hand": "hand_mask"}


def losses(
    recipe: Preset, model: nn.Module, batch: FrameTensors, epoch: int, generator: torch.Generator
) -> dict[str, Tensor]:
    """Score a batch: binary cross-entropy and Dice, the classes' mean."""
    return mask_losses(model(batch.inputs.color), _truth(model, batch))


def validate(model: nn.Module, frames: FrameTensors, batch_size: int) -> dict[str, float]:
    """Score by intersection over union; the first number is what is missing to 1."""
    network = cast(SegmentationNet, model)
    device = next(model.parameters()).device
    both, either = [], []
    for batch in frames.batches(batch_size):
        part = batch.to(device)
        found, truth = predict_logits(network, part.inputs.color) > 0, _truth(model, part)
        both.append((found & truth).sum(dim=(2, 3)).cpu())
        either.append((found | truth).sum(dim=(2, 3)).cpu())
    scores: dict[str, float] = {}
    for number, name in enumerate(network.config.classes):
        frame, pooled = iou(torch.cat(both)[:, number], torch.cat(either)[:, number])
        if number == 0:
            scores["validation_iou_missing"] = 1 - frame
        scores[f"validation_{name}_iou"] = frame
        scores[f"validation_{name}_iou_pooled"] = pooled
    return scores


def _truth(model: nn.Module, frames: FrameTensors) -> Tensor:
    """Stack the true masks of the network's classes: (B, classes, H, W), bool."""
    classes = cast(SegmentationNet, model).config.classes
    if unknown := set(classes) - set(_TARGETS):
        raise ValueError(f"frames have no true mask of {', '.join(sorted(unknown))}")
    return torch.stack([getattr(frames, _TARGETS[name]) for name in classes], dim=1)


def mask_losses(logits: Tensor, truth: Tensor) -> dict[str, Tensor]:
    """Compute cross-entropy, nats a pixel, and 1 - Dice, each frame and class counting the same.

    Dice has one pixel added above and below, so that an empty mask has a value.
    """
    logits = logits.float()  # sums over a picture are too much for half precision
    target = truth.to(logits.dtype)
    entropy = functional.binary_cross_entropy_with_logits(logits, target, reduction="none")
    found = logits.sigmoid()
    common = (found * target).sum(dim=(2, 3))  # (B, C)
    size = found.sum(dim=(2, 3)) + target.sum(dim=(2, 3))
    dice = 1 - (2 * common + 1) / (size + 1)
    number = dice.numel()
    terms = {
        "cross_entropy": mean_of(entropy.mean(dim=(2, 3)).sum(), number),
        "dice": mean_of(dice.sum(), number),
    }
    return {"loss": terms["cross_entropy"] + terms["dice"], **terms}


def iou(both: Tensor, either: Tensor) -> tuple[float, float]:
    """Mean of the frames' intersection over union (1 where both are empty), and all pixels'."""
    frames = torch.where(either > 0, both / either.clamp(min=1), torch.ones(len(both)))
    total = int(either.sum())
    return float(frames.mean()), float(both.sum()) / total if total else 1.0
