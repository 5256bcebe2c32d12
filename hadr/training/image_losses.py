"""Losses of networks whose answer is a depth image: depth itself, and the shape it has."""

from __future__ import annotations

import torch
from torch import Tensor

from hadr.training.tasks.task import shared_mean


def depth_and_steps(depth: Tensor, truth: Tensor, counted: Tensor) -> tuple[Tensor, Tensor]:
    """Mean absolute error of depth, and of its steps from a pixel to the next.

    The first is small when the object is where it should be, the second when its shape is right.
    Each frame counts the same, as it does in the scores.

    Args:
        depth: z-depth in metres, shape (B, H, W).
        truth: True z-depth, shape (B, H, W).
        counted: Pixels that count, shape (B, H, W), bool; a step counts where both pixels do.

    Returns:
        Two numbers in metres; 0 where nothing counts.
    """
    miss = (depth - truth) * counted  # (B, H, W)
    across = counted[:, :, 1:] & counted[:, :, :-1]
    down = counted[:, 1:] & counted[:, :-1]
    steps = ((miss[:, :, 1:] - miss[:, :, :-1]).abs() * across).sum(dim=(1, 2)) + (
        (miss[:, 1:] - miss[:, :-1]).abs() * down
    ).sum(dim=(1, 2))
    return (
        frame_mean(miss.abs().sum(dim=(1, 2)), counted.sum(dim=(1, 2))),
        frame_mean(steps, across.sum(dim=(1, 2)) + down.sum(dim=(1, 2))),
    )


def frame_mean(total: Tensor, count: Tensor) -> Tensor:
    """Mean of each frame's own mean, over the frames in which anything counts.

    Args:
        total: Sum over each frame, shape (B,).
        count: How much entered it, shape (B,).

    Returns:
        One number; 0 where nothing counts.
    """
    counts = count > 0
    means = torch.where(counts, total / count.clamp(min=1e-6), torch.zeros_like(total))
    return shared_mean(means.sum(), counts.sum())
