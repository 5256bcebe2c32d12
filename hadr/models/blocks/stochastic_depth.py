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

    Args:
        rate: Probability that a frame goes without the branch, 0..1; the rest is scaled up by
            1 / (1 - rate).
    """

    def __init__(self, rate: float) -> None:
        super().__init__()
        self.rate = rate
        self.share: tuple[int, int] | None = None

    def forward(self, branch: Tensor) -> Tensor:
        """Drop or scale.

        Args:
            branch: Output of the residual branch, shape (B, ...).

        Returns:
            The same shape; zeros for frames without it.
        """
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
    """Put `StochasticDepth` in the place of a library's own modules of the same meaning.

    Args:
        model: The network that holds them, changed in place.
        class_name: Name of their class; they have an attribute `drop_prob`.
    """
    for parent in list(model.modules()):
        for name, child in list(parent.named_children()):
            if type(child).__name__ == class_name:
                setattr(parent, name, StochasticDepth(float(child.drop_prob)))  # type: ignore[arg-type]
