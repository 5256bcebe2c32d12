"""A plain U-Net on a crop, with residual blocks: what looks at the pictures in HADR-plus."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional


def layer(channels: int, out: int, stride: int = 1) -> nn.Sequential:
    """A 3x3 convolution with its normalisation and SiLU."""
    return nn.Sequential(
        nn.Conv2d(channels, out, 3, stride, 1, bias=False), nn.BatchNorm2d(out), nn.SiLU()
    )


class ResidualBlock(nn.Module):
    """Two 3x3 convolutions around which the input is carried; starts as the identity."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = layer(channels, channels)
        self.second = nn.Conv2d(channels, channels, 3, 1, 1, bias=False)
        self.norm = nn.BatchNorm2d(channels)
        nn.init.zeros_(self.norm.weight)

    def forward(self, values: Tensor) -> Tensor:
        """Shape (B, C, H, W) to the same."""
        return functional.silu(values + self.norm(self.second(self.first(values))))


class CropUNet(nn.Module):
    """A U-Net on a crop with a whole view: resolutions 1/4, 1/8, 1/16, and all of it at once.

    At the bottom everything that was seen, in a 4x4 arrangement, is joined with a vector of what
    else is known; what is made of it is added to the bottom's map, and is an answer of its own.

    Args:
        channels: Channels of the crop.
        width: Channels at a quarter of the resolution.
        blocks: Residual blocks at each resolution.
        given: Length of the vector of what else is known.
        whole: Length of the answer for the whole crop.
        further: Channels of another network's maps of strides 4, 8 and 16, of as many as it has.
    """

    def __init__(
        self,
        channels: int,
        width: int,
        blocks: int,
        given: int,
        whole: int,
        further: Sequence[int] = (),
    ) -> None:
        super().__init__()
        widths = (width, 2 * width, 3 * width)
        self.stem = nn.Sequential(layer(4 * channels, width // 2), layer(width // 2, width, 2))
        self.further = nn.ModuleList(
            nn.Conv2d(own, w, 1) for own, w in zip(further, widths, strict=False)
        )
        self.down = nn.ModuleList(layer(widths[n], widths[n + 1], 2) for n in range(2))
        self.left = nn.ModuleList(
            nn.Sequential(*(ResidualBlock(w) for _ in range(blocks))) for w in widths
        )
        self.seen = nn.Conv2d(widths[2], width, 1)
        self.join = nn.Sequential(
            nn.Linear(16 * width + given, 4 * width),
            nn.SiLU(),
            nn.Linear(4 * width, 4 * width),
            nn.SiLU(),
        )
        self.to_map = nn.Linear(4 * width, widths[2])
        self.answer = nn.Linear(4 * width, whole)
        self.up = nn.ModuleList(layer(widths[n + 1] + widths[n], widths[n]) for n in range(2))
        self.right = nn.ModuleList(ResidualBlock(widths[n]) for n in range(2))

    def forward(
        self, crop: Tensor, given: Tensor, maps: Sequence[Tensor] = ()
    ) -> tuple[Tensor, Tensor]:
        """Look at crops (B, channels, S, S), with what else is known, (B, given), and further maps.

        Returns:
            A map, shape (B, width, S/4, S/4), and the answer for the whole crop, (B, whole).
        """
        values: Tensor = self.stem(functional.pixel_unshuffle(crop, 2))
        skipped = []
        for number, blocks in enumerate(self.left):  # S/4, S/8, S/16
            if number:
                values = self.down[number - 1](values)
            if number < len(self.further):
                values = values + self.further[number](maps[number])
            values = blocks(values)
            skipped.append(values)
        view = functional.adaptive_avg_pool2d(self.seen(values), 4).flatten(1)  # (B, 16 width)
        joined = self.join(torch.cat((view, given), dim=1))  # (B, 4 width)
        values = values + self.to_map(joined)[:, :, None, None]
        for number in (1, 0):
            values = functional.interpolate(
                values, scale_factor=2, mode="bilinear", align_corners=False
            )
            both = torch.cat((values, skipped[number]), dim=1)
            values = self.right[number](self.up[number](both))  # S/8, S/4
        return values, self.answer(joined)
