"""The segmentation network as the training loop sees it: cross-entropy and Dice, scored by IoU."""

from __future__ import annotations

from typing import cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from hadr.models.segmentation import SegmentationConfig, SegmentationNet, predict_masks
from hadr.training.batches import FrameTensors
from hadr.training.recipe import Preset
from hadr.training.tasks.task import shared_mean

_TARGETS = {"object": "object_mask", "hand": "hand_mask"}


class SegmentationTask:
    """Training of the segmentation network.

    Args:
        recipe: The network and its schedule.

    Raises:
        ValueError: The recipe is that of another network, or a class has no true mask.
    """

    network = "segmentation"

    def __init__(self, recipe: Preset) -> None:
        if not isinstance(recipe.model, SegmentationConfig):
            raise ValueError(
                f"recipe {recipe.name!r} of {recipe.network!r} is none of segmentation"
            )
        self.config = recipe.model
        unknown = set(self.config.classes) - set(_TARGETS)
        if unknown:
            raise ValueError(f"frames have no true mask of {', '.join(sorted(unknown))}")

    def build(self) -> SegmentationNet:
        """Build the network with fresh weights, or with the published ones it names."""
        return SegmentationNet(self.config)

    def losses(
        self, model: nn.Module, batch: FrameTensors, epoch: int, generator: torch.Generator
    ) -> dict[str, Tensor]:
        """Score a batch: binary cross-entropy and Dice, the classes' mean."""
        return mask_losses(model(batch.inputs.color), self._truth(batch))

    def validate(self, model: nn.Module, frames: FrameTensors, batch_size: int) -> dict[str, float]:
        """Score by intersection over union; the first number is what is missing to 1."""
        network = cast(SegmentationNet, model)
        device = next(model.parameters()).device
        both, either = [], []
        for first in range(0, len(frames), batch_size):
            part = frames.take(range(first, min(first + batch_size, len(frames)))).to(device)
            found, truth = predict_masks(network, part.inputs.color), self._truth(part)
            both.append((found & truth).sum(dim=(2, 3)).cpu())
            either.append((found | truth).sum(dim=(2, 3)).cpu())
        scores: dict[str, float] = {}
        for number, name in enumerate(self.config.classes):
            frame, pooled = iou(torch.cat(both)[:, number], torch.cat(either)[:, number])
            if number == 0:
                scores["validation_iou_missing"] = 1 - frame
            scores[f"validation_{name}_iou"] = frame
            scores[f"validation_{name}_iou_pooled"] = pooled
        return scores

    def _truth(self, frames: FrameTensors) -> Tensor:
        """Stack the classes' true masks: (B, classes, H, W), bool."""
        masks = [getattr(frames, _TARGETS[name]) for name in self.config.classes]
        return torch.stack(masks, dim=1)


def mask_losses(logits: Tensor, truth: Tensor) -> dict[str, Tensor]:
    """Compute the loss and its terms, each frame and class counting the same.

    Args:
        logits: Shape (B, C, H, W).
        truth: True masks, the same shape, bool.

    Returns:
        "loss"; "cross_entropy" in nats a pixel; "dice": 1 - 2 |A B| / (|A| + |B|), with one pixel
        added above and below so that an empty mask has a value.
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
        "cross_entropy": shared_mean(entropy.mean(dim=(2, 3)).sum(), number),
        "dice": shared_mean(dice.sum(), number),
    }
    return {"loss": terms["cross_entropy"] + terms["dice"], **terms}


def iou(both: Tensor, either: Tensor) -> tuple[float, float]:
    """Compute the intersection over union.

    Args:
        both: Pixels in both masks of each frame, shape (N,).
        either: Pixels in one of them or both, shape (N,).

    Returns:
        The mean of the frames' values, where a frame in which both masks are empty has 1, and the
        value of all frames' pixels together.
    """
    frames = torch.where(either > 0, both / either.clamp(min=1), torch.ones(len(both)))
    total = int(either.sum())
    return float(frames.mean()), float(both.sum()) / total if total else 1.0
