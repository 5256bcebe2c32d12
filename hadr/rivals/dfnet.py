"""DFNet, the depth filler network of TransCG: a small dense U-Net from colour and depth to depth.

It is given neither the hand nor the object's mask. Depth enters three times over: beside the
colour, and down-sampled beside the features of each dense block. Each frame's depth is brought to
about 0..1 first, by its own minimum, maximum and spread, and the answer is brought back.

Source: Fang et al., "TransCG: A Large-Scale Real-World Dataset for Transparent Object Depth
Completion and a Grasping Baseline", RA-L 2022, and the code released with it, of which only facts
and numbers are used here. Where the releases differ, this is the later one: depth between 0.3 and
1.5 m, down-sampled to the nearest pixel, and a last layer without ReLU. Its removal of depth more
than ten standard deviations from a frame's mean is left out. It fills holes when it restores, and
may when it learns; here it does both or neither.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import torch
from scipy import ndimage
from torch import Tensor, nn

from hadr.models.config import NetworkConfig
from hadr.models.network_input import HADRInput, ImageOutput, float_color
from hadr.models.window import WindowConfig, through_window
from hadr.records.provenance import IF_CHANGED

MARGIN_M = 1e-6
"""Keeps the range of a frame of one depth from being empty."""


@dataclass(frozen=True)
class DFNetConfig(NetworkConfig):
    """What the network consists of; the defaults are the published ones.

    Args:
        width: Channels between the dense blocks.
        layers: Layers of a dense block.
        growth: Channels that each of them adds.
        levels: Resolutions with a skip branch; the coarsest is 1 / 2^(levels + 1) of the input's.
        near_m: Depth nearer than this counts as missing, metres.
        far_m: Depth farther than this counts as missing, metres.
        fill_holes: Missing depth becomes that of the nearest pixel that has some; without it,
            missing depth stays 0, and the network can see where it is missing.
        view: Look at a window around hand and glass; None looks at the whole picture.
    """

    width: int = 64
    layers: int = 5
    growth: int = 12
    levels: int = 3
    near_m: float = 0.3
    far_m: float = 1.5
    fill_holes: bool = True
    view: WindowConfig | None = field(default=None, metadata=IF_CHANGED)

    hand: ClassVar[str] = "none"
    """It does without the hand's keypoints."""

    def in_range(self, depth: Tensor) -> Tensor:
        """Say where depth in metres counts as known; the shape of `depth`, bool."""
        return (depth >= self.near_m) & (depth <= self.far_m)


def fill_nearest(depth: Tensor, known: Tensor) -> Tensor:
    """Give each pixel of depth (B, H, W) that of the nearest known one; zeros without any."""
    filled = torch.zeros_like(depth)
    for number, there in enumerate(known.cpu().numpy()):
        if there.any():
            nearest = ndimage.distance_transform_edt(
                ~there, return_distances=False, return_indices=True
            )
            rows, columns = torch.from_numpy(nearest).long().to(depth.device)  # (H, W) each
            filled[number] = depth[number, rows, columns]
    return filled


def frame_range(depth: Tensor) -> tuple[Tensor, Tensor]:
    """Give the depths (B,), metres, that become 0 and 1: half a deviation beyond a frame's own."""
    values = depth.flatten(1)  # (B, H W)
    margin = 0.5 * values.std(dim=1, correction=0) + MARGIN_M
    return values.amin(dim=1) - margin, values.amax(dim=1) + margin


def _conv(channels: int, out: int, kernel: int = 3, stride: int = 1) -> nn.Sequential:
    """Give a convolution with batch normalisation and ReLU."""
    return nn.Sequential(
        nn.Conv2d(channels, out, kernel, stride, padding=kernel // 2),
        nn.BatchNorm2d(out),
        nn.ReLU(),
    )


class DenseBlock(nn.Module):
    """Layers that each see the input, the depth, and all layers before; the last one answers.

    Each goes by 1x1 to 4 * growth channels, then by 3x3 to growth.
    """

    def __init__(self, channels: int, layers: int, growth: int) -> None:
        super().__init__()
        self.layers = nn.ModuleList(
            nn.Sequential(
                _conv(channels + 1 + number * growth, 4 * growth, kernel=1),
                _conv(4 * growth, growth),
            )
            for number in range(layers)
        )
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.xavier_normal_(module.weight)
                nn.init.zeros_(module.bias)  # type: ignore[arg-type]

    def forward(self, values: Tensor, depth: Tensor) -> Tensor:
        """From (B, channels, h, w) and normalised depth (B, 1, h, w) to (B, growth, h, w)."""
        answer = values
        seen = torch.cat((values, depth), dim=1)
        for number, layer in enumerate(self.layers):
            if number:
                seen = torch.cat((seen, answer), dim=1)  # (B, channels + 1 + number * growth, ...)
            answer = layer(seen)
        return answer


class DenseBranch(nn.Module):
    """A convolution, a dense block, and `after`, which brings its answer back to full width."""

    def __init__(self, channels: int, config: DFNetConfig, after: nn.Module) -> None:
        super().__init__()
        self.before = _conv(channels, config.width)
        self.block = DenseBlock(config.width, config.layers, config.growth)
        self.after = after

    def forward(self, values: Tensor, depth: Tensor) -> Tensor:
        """Go through the three: (B, channels, h, w) and depth (B, 1, h, w) to (B, width, ...)."""
        answer: Tensor = self.after(self.block(self.before(values), depth))
        return answer


class DFNet(nn.Module):
    """The whole network."""

    def __init__(self, config: DFNetConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or DFNetConfig()
        width, growth = config.width, config.growth

        def branch(stride: int = 1) -> DenseBranch:
            return DenseBranch(width, config, _conv(growth, width, stride=stride))

        def upward(channels: int) -> DenseBranch:
            # Dense up-sampling: four times the channels, laid out as pixels twice as fine.
            twice = nn.Sequential(_conv(growth, 4 * width), nn.PixelShuffle(2))
            return DenseBranch(channels, config, twice)

        self.first = _conv(3 + 1, width, stride=2)
        self.skip = nn.ModuleList(branch() for _ in range(config.levels))
        self.down = nn.ModuleList(branch(stride=2) for _ in range(config.levels))
        self.bottom = branch()
        self.up = nn.ModuleList(
            upward(width if number == 0 else 2 * width) for number in range(config.levels + 1)
        )
        self.final = _conv(width, width)
        self.head = nn.Conv2d(width, 1, 1)

    @through_window
    def forward(self, inputs: HADRInput) -> ImageOutput:
        """Restore the depth of masked pixels; frames may be of any size.

        What was measured inside the mask is seen. Nothing is restored in frames without any depth
        in the configured range.
        """
        known = self.config.in_range(inputs.depth)  # (B, H, W)
        usable = known.flatten(1).any(dim=1)[:, None, None]  # (B, 1, 1)
        depth = inputs.depth * known
        if self.config.fill_holes:
            depth = fill_nearest(depth, known)
        low, high = (end[:, None, None] for end in frame_range(depth))  # (B, 1, 1)
        seen = (depth - low) / (high - low)  # (B, H, W), 0..1
        answer = self.network(float_color(inputs.color), seen[:, None])  # (B, H, W)
        image = (low + (high - low) * answer) * usable
        restored = inputs.mask & (image > 0)
        return ImageOutput(image * restored, restored, image)

    def network(self, color: Tensor, depth: Tensor) -> Tensor:
        """Go from colour in 0..1 (B, 3, H, W) and normalised depth (B, 1, H, W) to (B, H, W)."""
        size = depth.shape[2:]
        values = self.first(torch.cat((color, depth), dim=1))  # (B, width, H/2, W/2)
        depths = [depth[:, :, ::2, ::2]]  # where the stride's convolutions are centred
        skipped: list[Tensor] = []
        for skip, down in zip(self.skip, self.down, strict=True):
            skipped.append(skip(values, depths[-1]))
            values = down(values, depths[-1])  # (B, width, H / 2^(level + 1), ...)
            depths.append(depths[-1][:, :, ::2, ::2])
        values = self.bottom(values, depths[-1])
        for up in self.up:
            values = up(values, depths.pop())
            if skipped:  # what was halved from an odd size is a pixel too large now
                fine = skipped.pop()
                values = torch.cat((values[:, :, : fine.shape[2], : fine.shape[3]], fine), dim=1)
        values = values[:, :, : size[0], : size[1]]  # (B, width, H, W)
        values = self.final(values)
        with torch.autocast(values.device.type, enabled=False):  # 16 bits would round to 4 mm
            answer: Tensor = self.head(values.to(self.head.weight.dtype))[:, 0]
        return answer
