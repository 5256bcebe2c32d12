"""The head of UPerNet: what the stages of an encoder see becomes one drawing.

Source: Xiao et al. 2018, "Unified Perceptual Parsing for Scene Understanding".
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional

from hadr.models.backbone import enlarge


class PyramidHead(nn.Module):
    """A UPerNet head: a pooling pyramid over the coarsest stage, then the finer stages in turn.

    Args:
        stages: Channels of each stage, the finest first.
        channels: Channels inside of the head.
        answers: Channels of what it draws.
        pools: Cells a side of the pooling pyramid.
        dropout: Probability with which a channel is left out before the last layer.
    """

    def __init__(
        self,
        stages: Sequence[int],
        channels: int,
        answers: int,
        pools: Sequence[int],
        dropout: float,
    ) -> None:
        super().__init__()
        self.pools = tuple(pools)
        coarsest = stages[-1]
        self.pooled = nn.ModuleList(_convolution(coarsest, channels, 1) for _ in pools)
        self.pyramid = _convolution(coarsest + len(self.pools) * channels, channels, 3)
        self.lateral = nn.ModuleList(_convolution(width, channels, 1) for width in stages[:-1])
        self.smooth = nn.ModuleList(_convolution(channels, channels, 3) for _ in stages[:-1])
        self.merge = _convolution(len(stages) * channels, channels, 3)
        self.dropout = ChannelDropout(dropout)
        self.last = nn.Conv2d(channels, answers, 1)
        nn.init.normal_(self.last.weight, std=0.01)
        nn.init.zeros_(self.last.bias)  # type: ignore[arg-type]

    def forward(self, stages: Sequence[Tensor]) -> Tensor:
        """Draw (B, answers, H_1, W_1), float32, at the finest stage's size.

        Args:
            stages: Feature maps, the finest first, each half as fine as the one before (odd sizes
                rounded up), shapes (B, C_i, H_i, W_i).
        """
        coarse = stages[-1]
        parts = [coarse]
        for cells, layers in zip(self.pools, self.pooled, strict=True):
            pooled = layers(functional.adaptive_avg_pool2d(coarse, cells))  # (B, ch, cells, cells)
            parts.append(functional.interpolate(pooled, coarse.shape[2:], mode="bilinear"))
        values = self.pyramid(torch.cat(parts, dim=1))  # (B, ch, H_4, W_4)
        levels = [values]
        for number in reversed(range(len(self.lateral))):
            finer = self.lateral[number](stages[number])
            values = finer + enlarge(values, 2, finer.shape[2:])
            levels.append(self.smooth[number](values))  # (B, ch, H_i, W_i)
        finest = stages[0].shape[2:]
        whole = torch.cat(
            [enlarge(level, 2**n, finest) for n, level in enumerate(reversed(levels))], dim=1
        )  # (B, stages * ch, H_1, W_1)
        values = self.dropout(self.merge(whole)).float()
        # In 32 bits also where the rest has 16, which tell depths of a metre only 4 mm apart.
        with torch.autocast(values.device.type, enabled=False):
            drawn: Tensor = self.last(values)
        return drawn


class ChannelDropout(nn.Module):
    """Leave channels out, for each frame others.

    Each goes with probability `rate`; the rest is scaled up by 1 / (1 - rate).
    """

    def __init__(self, rate: float) -> None:
        super().__init__()
        self.rate = rate

    def forward(self, branch: Tensor) -> Tensor:
        """Drop or scale the channels of (B, C, H, W)."""
        if self.rate == 0 or not self.training:
            return branch
        keeps = torch.rand(*branch.shape[:2], 1, 1, device=branch.device) >= self.rate
        return branch.div(1 - self.rate) * keeps


class _LoneBatchNorm(nn.BatchNorm2d):
    """Batch normalisation that also takes a single value a channel, by its running statistics.

    A batch of one frame, which can be an epoch's last, is a single value once it is pooled to one
    cell. It has no spread to divide by.
    """

    def forward(self, input: Tensor) -> Tensor:
        """Normalise: (B, C, H, W) to the same shape."""
        if input.numel() > input.shape[1]:
            return super().forward(input)
        return functional.batch_norm(
            input, self.running_mean, self.running_var, self.weight, self.bias, eps=self.eps
        )


def _convolution(channels: int, out: int, side: int) -> nn.Sequential:
    """A convolution that keeps the size, with batch normalisation and ReLU."""
    return nn.Sequential(
        nn.Conv2d(channels, out, side, padding=side // 2, bias=False),
        _LoneBatchNorm(out),
        nn.ReLU(),
    )
