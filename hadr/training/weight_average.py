"""The running average of a network's weights over the steps of its training.

Late in training the weights circle around a minimum; their average lies nearer to it.
"""

from __future__ import annotations

import copy

import torch
from torch import nn


class WeightAverage:
    """Exponential average of weights; buffers (such as running statistics) are copied.

    Args:
        network: The network whose weights are averaged; it is copied.
        decay: Share that is kept a step, 0..1. In the first steps less is kept, so that the
            random weights of the start are forgotten.
    """

    def __init__(self, network: nn.Module, decay: float) -> None:
        self.decay = decay
        self.network = copy.deepcopy(network).eval()
        for weight in self.network.parameters():
            weight.requires_grad_(False)

    @torch.no_grad()
    def follow(self, network: nn.Module, steps: int) -> None:
        """Take in the weights after a step.

        Args:
            network: The network.
            steps: Steps so far, this one included.
        """
        keep = min(self.decay, (1 + steps) / (10 + steps))
        for mean, weight in zip(self.network.parameters(), network.parameters(), strict=True):
            mean.lerp_(weight, 1 - keep)
        for own, value in zip(self.network.buffers(), network.buffers(), strict=True):
            own.copy_(value)
