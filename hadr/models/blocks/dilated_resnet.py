"""LIDF's colour network: a ResNet whose last two stages are dilated, so that its stride stays 8.

The stages of a ResNet halve the resolution: strides 4, 8, 16, 32. Here the last two do not; their
3x3 kernels reach two and four times as far instead (dilation 2 and 4). A 1x1 convolution takes the
last stage to the wanted channels, and a bilinear resize to the image.

A cell of the map is centred on the picture's pixel (8 i, 8 j), the resize takes it to be centred
on (8 i + 3.5, 8 j + 3.5): the published network has the same fixed shift, which it can learn.

Source: Zhu et al. 2021, "RGB-D Local Implicit Function for Depth Completion of Transparent
Objects", and its published code for stride, dilations and initial weights.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from torch import Tensor, nn

from hadr.models.backbone import enlarge
from hadr.models.blocks.resnet import UNetConfig, build_resnet
from hadr.models.config import NetworkConfig

STRIDE = 8
"""Pixels from one cell of the map to the next."""
DILATIONS = {2: 2, 3: 4}
"""Dilation of the stages that do not halve, by their number from 0."""


@dataclass(frozen=True)
class DilatedResNetConfig(NetworkConfig):
    """Size of the network; the defaults are ResNet-34's.

    Args:
        depths: Residual blocks of each stage.
        widths: Channels of each stage; the first convolution has as many as the first stage.
        pretrained: Name of published ImageNet weights, such as "microsoft/resnet-34"; None starts
            from random weights, as the published network does.
    """

    depths: tuple[int, ...] = (3, 4, 6, 3)
    widths: tuple[int, ...] = (64, 128, 256, 512)
    pretrained: str | None = None

    def resnet(self) -> UNetConfig:
        """The same as `build_resnet` takes it."""
        return UNetConfig(self.depths, self.widths, pretrained=self.pretrained)


class DilatedResNet(nn.Module):
    """From colour to a dense feature map of so many channels."""

    def __init__(self, config: DilatedResNetConfig, channels: int = 32) -> None:
        super().__init__()
        self.resnet = build_resnet(config.resnet(), 3)
        stages: Any = self.resnet.encoder.stages  # type: ignore[union-attr]
        for number, dilation in DILATIONS.items():
            for layer in stages[number].modules():
                if isinstance(layer, nn.Conv2d):
                    layer.stride = (1, 1)
                    if layer.kernel_size == (3, 3):
                        layer.dilation = layer.padding = (dilation, dilation)
        self.reduce = nn.Conv2d(config.widths[-1], channels, 1)
        nn.init.normal_(self.reduce.weight, std=0.01)
        nn.init.zeros_(self.reduce.bias)  # type: ignore[arg-type]

    def forward(self, color: Tensor) -> Tensor:
        """Compute the map (B, channels, H, W) of normalised colour (B, 3, H, W), any size."""
        resnet: Any = self.resnet
        values = resnet.embedder(color)  # (B, widths[0], H / 4, W / 4)
        for stage in resnet.encoder.stages:
            values = stage(values)  # (B, widths[s], H / 4, W / 4), then H / 8, W / 8
        coarse = self.reduce(values)  # (B, channels, ceil(H / 8), ceil(W / 8))
        return enlarge(coarse, STRIDE, color.shape[2:])
