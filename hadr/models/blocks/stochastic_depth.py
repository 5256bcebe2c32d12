"""Stochastic depth whose chance belongs to the frames of a batch, not to the process.

In training a residual branch is left out for some frames. Where several processes share a batch,
each draws for the whole batch and takes its own rows: together they then drop what one process
that sees the whole batch would drop.

Source: Huang et al., Deep Networks with Stochastic Depth, 2016.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn


class StochasticDepth(nn.Module):
    """Leave a branch out for some frames of a batch; the identity outside of training.

    A frame goes without it with probability `rate`; the rest is scaled up by 1 / (1 - rate).
    """

    def __init__(self, rate: float) -> None:
        super().__init__()
        self.rate = rate
        self.share: tuple[int, int] | None = None

    def forward(self, branch: Tensor) -> Tensor:
        """Drop or scale the branch of each frame, (B, ...)."""
        if self.rate == 0 or not self.training:
            return branch
        rows = len(branch)
        first, total = self.share or (0, rows)
        shape = (total,) + (1,) * (branch.ndim - 1)
        chance = torch.rand(shape, dtype=branch.dtype, device=branch.device)
        keeps = torch.floor(chance + (1 - self.rate))[first : first + rows]  # (B, 1, ...), 0 or 1
        return branch.div(1 - self.rate) * keeps


def set_share(model: nn.Module, first: int, total: int) -> None:
    """Say which `first` row of a shared batch of `total` rows the network sees next."""
    for module in model.modules():
        if isinstance(module, StochasticDepth):
            module.share = (first, total)


def replace_drop_path(model: nn.Module, class_name: str) -> None:
    """Put `StochasticDepth` in the place of a library's modules of this class and meaning."""
    for parent in list(model.modules()):
        for name, child in list(parent.named_children()):
            if type(child).__name__ == class_name:
                setattr(parent, name, StochasticDepth(float(child.drop_prob)))  # type: ignore[arg-type]
