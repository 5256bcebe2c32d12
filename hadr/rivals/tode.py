"""TODE-Trans: one Swin Transformer sees colour and depth, convolutions make it depth again.

The network is not told where the object is, nor where the hand is: it answers with the depth of
the whole image, of which the masked pixels are taken. It works in metres as they are, without any
normalisation by frame; training it in bfloat16 would round depth of half a metre to 4 mm.

The layers are the published ones and hold 4.68 M weights. The published code also builds the Swin
Transformer's last normalisation and its classifier of 1000 classes, 193,384 weights that are never
used: 4.87 M, printed as 4.9 M. Two of its traits are kept although they look like slips:

- The normalisation behind each enlarging layer, and the one before the answer, adds as much to the
  variance as it has channels (64 or 128, where 1e-5 is usual). So the first answers are some
  centimetres, not some metres.
- The gate of a coarse level is the bare mean over the channels of the finer one: neither learned
  nor bounded. Stages must therefore come without a layer normalisation, which would make it 0.

What differs: images of any size will do (a level of odd size loses the enlarged image's last row
or column; the published code knows 320x240 alone), and attention's positional biases start at 0.

Source: Chen et al. 2023, "TODE-Trans: Transparent Object Depth Estimation with Transformer", and
its published code, read for its numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional

from hadr.models.backbone import random_swin
from hadr.models.config import NetworkConfig
from hadr.models.network_input import HADRInput, ImageOutput, float_color
from hadr.models.window import WindowConfig, through_window
from hadr.records.provenance import IF_CHANGED

LIMIT_M = 10.0
"""Measured depth beyond this counts as missing."""


@dataclass(frozen=True)
class TODEConfig(NetworkConfig):
    """What the network consists of; the defaults are the published size.

    Args:
        patch: Side of the Swin Transformer's patches, pixels.
        embed_dim: Channels of the first stage; twice as many at each coarser one.
        depths: Transformer blocks of each stage.
        heads: Attention heads of each stage.
        window: Side of the attention window, in tokens.
        drop_path: Largest rate of stochastic depth.
        width: Channels of the decoder; half as many at the image's own resolution.
        gate: How much of a coarse level passes through the finer one's gate, 0..1; the rest passes
            as it is.
        view: Look at a window around hand and glass; None looks at the whole picture.
    """

    hand: ClassVar[str] = "none"

    patch: int = 2
    embed_dim: int = 24
    depths: tuple[int, ...] = (2, 2, 6, 2)
    heads: tuple[int, ...] = (3, 6, 12, 24)
    window: int = 7
    drop_path: float = 0.1
    width: int = 128
    gate: float = 1.0
    view: WindowConfig | None = field(default=None, metadata=IF_CHANGED)

    @property
    def channels(self) -> tuple[int, ...]:
        """Channels of each stage."""
        return tuple(self.embed_dim * 2**stage for stage in range(len(self.depths)))


def fuse_levels(stages: Sequence[Tensor], gate: float) -> list[Tensor]:
    """Multiply each level by the mean over the channels of the finer one, itself fused before.

    The finest comes first and stays, each (B, C_i, H_i, W_i) is half the size of the one before,
    rounded up; `gate`, 0..1, passes the gate, the rest passes as it is.
    """
    fused = [stages[0]]
    for coarse in stages[1:]:
        mean = fused[-1].mean(dim=1, keepdim=True)  # (B, 1, H_i, W_i)
        opening = functional.avg_pool2d(mean, 2, ceil_mode=True)  # (B, 1, H_i+1, W_i+1)
        fused.append(coarse * (gate * opening + (1 - gate)))
    return fused


class _Enlarge(nn.Module):
    """Two 3x3 convolutions beside the identity, then a transposed one that enlarges."""

    def __init__(self, channels: int, out: int, factor: int) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for _ in range(2):
            layers += [nn.Conv2d(channels, channels, 3, padding=1), nn.BatchNorm2d(channels)]
            layers += [nn.LeakyReLU()]
        self.refine = nn.Sequential(*layers)
        self.enlarge = nn.ConvTranspose2d(channels, out, factor, stride=factor)
        self.norm = nn.BatchNorm2d(out, eps=out)

    def forward(self, values: Tensor, size: Sequence[int]) -> Tensor:
        """Enlarge (B, C, h, w) by the factor, and cut it to (B, out, *size)."""
        height, width = size
        values = self.refine(values) + values
        return functional.relu(self.norm(self.enlarge(values)[:, :, :height, :width]))


class TODETrans(nn.Module):
    """The whole network."""

    def __init__(self, config: TODEConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or TODEConfig()
        self.swin = random_swin(config, num_channels=4, hidden_act="relu")  # colour and depth
        for stage in self.swin.hidden_states_norms:
            self.swin.hidden_states_norms[stage] = nn.Identity()
        self.swin.swin.layernorm = nn.Identity()
        width, half = config.width, config.width // 2
        skips = [0, *[width] * (len(config.depths) - 1)]  # what comes from the coarser level
        before = [a + b for a, b in zip(skips, reversed(config.channels), strict=True)]
        out = [*[width] * (len(before) - 1), half]
        factors = [*[2] * (len(before) - 1), config.patch]
        self.decoder = nn.ModuleList(map(_Enlarge, before, out, factors))  # the coarsest first
        self.head = nn.Sequential(
            nn.Conv2d(half, half, 3, padding=1),
            nn.BatchNorm2d(half, eps=half),
            nn.ReLU(),
            nn.Conv2d(half, 1, 3, padding=1),
            nn.ReLU(),
        )
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out")

    @through_window
    def forward(self, inputs: HADRInput) -> ImageOutput:
        """Restore depth; frames may be of any size, hand and intrinsics are not looked at."""
        measured = inputs.depth  # (B, H, W)
        measured = torch.where((measured > 0) & (measured <= LIMIT_M), measured, 0)
        seen = torch.cat((float_color(inputs.color), measured[:, None]), dim=1)  # (B, 4, H, W)
        stages = self.swin(seen).feature_maps  # (B, embed_dim * 2^i, H / patch / 2^i, ...)
        levels = fuse_levels(stages, self.config.gate)[::-1]  # the coarsest first
        sizes = [level.shape[2:] for level in levels[1:]] + [measured.shape[1:]]
        values = self.decoder[0](levels[0], sizes[0])
        for layer, level, size in zip(self.decoder[1:], levels[1:], sizes[1:], strict=True):
            values = layer(torch.cat((values, level), dim=1), size)  # (B, width, *size)
        image = self.head(values)[:, 0].float()  # (B, H, W), metres
        restored = inputs.mask & (image > 0)
        return ImageOutput(image * restored, restored, image)
