"""A plain U-Net that is given the hand: what a sceptic compares HADR with.

No rays, no voxels, no attention: pictures in, a picture out. It sees colour, the object's mask,
measured depth relative to the hand's, which of it is near the hand, and the keypoints with their
relative depth; it answers with the object's depth relative to the hand's. What a method gains
over this one, it gains by more than by being told where the hand is.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

from hadr.models.backbone import enlarge
from hadr.models.blocks.efficientnet_lite import EfficientNetLite0, LiteConfig
from hadr.models.config import NetworkConfig
from hadr.models.hand.crop import hand_depth, keypoint_maps, relative_depth
from hadr.models.network_input import DepthOutput, HADRInput, float_color
from hadr.models.window import WindowConfig, through_window
from hadr.records.provenance import IF_CHANGED

REACH_M = 0.2
"""Measured depth farther than this from the hand's is cut off."""
UNIT_M = 0.1
"""The network's answer, and the keypoints' relative depth, are in units of this."""


@dataclass(frozen=True)
class UNetHandConfig(NetworkConfig):
    """What the network consists of.

    Args:
        width: Channels at half of the input's resolution, twice as many at each coarser one.
        levels: Number of resolutions, the first included.
        view: Look at a window around hand and glass; None looks at the whole picture.
        lite: An EfficientNet-Lite0, whose maps join the levels of their size (strides 4, 8, ...).
    """

    width: int = 38
    levels: int = 4
    view: WindowConfig | None = field(default=None, metadata=IF_CHANGED)
    lite: LiteConfig | None = field(default=None, metadata=IF_CHANGED)


def _twice(channels: int, out: int) -> nn.Sequential:
    """Two 3x3 convolutions, each with batch normalisation and ReLU."""
    layers: list[nn.Module] = []
    for before in (channels, out):
        layers += [nn.Conv2d(before, out, 3, padding=1, bias=False), nn.BatchNorm2d(out), nn.ReLU()]
    return nn.Sequential(*layers)


class UNetHand(nn.Module):
    """The whole network."""

    channels = 3 + 1 + 2 + 2  # colour, mask, relative depth and where near, keypoints twice

    def __init__(self, config: UNetHandConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or UNetHandConfig()
        widths = [config.width * 2**level for level in range(config.levels)]
        before = [4 * self.channels, *widths[:-1]]
        if config.lite:
            self.lite = EfficientNetLite0(config.lite)
            for level, channels in enumerate(config.lite.channels[: config.levels - 1], start=1):
                before[level] += channels
        self.down = nn.ModuleList(_twice(b, w) for b, w in zip(before, widths, strict=True))
        self.up = nn.ModuleList(_twice(coarse + fine, fine) for fine, coarse in pairwise(widths))
        self.head = nn.Conv2d(widths[0], 4, 1)

    @through_window
    def forward(self, inputs: HADRInput) -> DepthOutput:
        """Restore the depth of masked pixels, in frames of even height and width.

        Raises:
            ValueError: A frame has no hand, or height or width is odd.
        """
        height, width = inputs.depth.shape[1:]
        if height % 2 or width % 2:
            raise ValueError(f"height and width must be even, got {height} x {width}")
        hand = hand_depth(inputs)  # (B,)
        values = functional.pixel_unshuffle(self.pictures(inputs, hand), 2)  # (B, 32, H/2, W/2)
        maps = self.lite(float_color(inputs.color)) if self.config.lite else []  # strides 4, 8, ...
        skipped: list[Tensor] = []
        for level, layers in enumerate(self.down):
            if level:
                values = functional.max_pool2d(values, 2, ceil_mode=True)
            if 0 < level <= len(maps):
                rows, columns = values.shape[2:]
                values = torch.cat((values, maps[level - 1][:, :, :rows, :columns]), dim=1)
            values = layers(values)  # (B, width * 2^level, H / 2^(level + 1), ...)
            skipped.append(values)
        for level in reversed(range(len(self.up))):
            fine = skipped[level]
            values = enlarge(values, 2, fine.shape[2:])
            values = self.up[level](torch.cat((values, fine), dim=1))
        relative = functional.pixel_shuffle(self.head(values), 2)[:, 0].float()  # (B, H, W)
        depth = hand[:, None, None] + UNIT_M * relative
        restored = inputs.mask & (depth > 0)
        return DepthOutput(depth * restored, restored)

    def pictures(self, inputs: HADRInput, hand: Tensor) -> Tensor:
        """Make what the network sees: (B, channels, H, W)."""
        color = float_color(inputs.color) - 0.5  # (B, 3, H, W)
        mask = inputs.mask.unsqueeze(1).to(color.dtype)  # (B, 1, H, W)
        depth = relative_depth(inputs.depth * ~inputs.mask, hand, REACH_M)  # (B, 2, H, W)
        height = (inputs.keypoints[:, :, 2] - hand[:, None]) / UNIT_M  # (B, 21)
        points = keypoint_maps(
            inputs.keypoints_uv, height, (mask.shape[2], mask.shape[3]), radius=1.5
        )  # (B, 2, H, W)
        return torch.cat((color, mask, depth, points), dim=1)
