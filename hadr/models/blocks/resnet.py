"""A U-Net with a ResNet encoder: the form of both helper networks, hand keypoints and masks.

The ResNet is that of the `transformers` package. Besides its four stages (strides 4, 8, 16, 32) the
decoder also takes the map of its first convolution (stride 2), and ends there.

Source: He et al. 2016, "Deep Residual Learning"; Ronneberger et al. 2015, "U-Net"; the paper names
both encoders: ResNet-18 for the keypoints, ResNet-34 for the masks.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from hadr.models.backbone import load_published
from hadr.models.blocks.efficientnet_lite import HALF, EfficientNetLite0, LiteConfig
from hadr.models.config import NetworkConfig

_STAGES = 4


@dataclass(frozen=True)
class UNetConfig(NetworkConfig):
    """Size of a U-Net with a ResNet encoder; the defaults are ResNet-18's.

    Args:
        depths: Residual blocks of each stage: (2, 2, 2, 2) is ResNet-18, (3, 4, 6, 3) ResNet-34.
        widths: Channels of each stage; the first convolution has as many as the first stage.
        decoder: Channels of the decoder at strides 16, 8, 4 and 2.
        pretrained: Name of published ImageNet weights, such as "microsoft/resnet-18", which are
            fetched once over the network; None starts from random weights.

    Raises:
        ValueError: There are not four stages, or a number is not positive.
    """

    depths: tuple[int, ...] = (2, 2, 2, 2)
    widths: tuple[int, ...] = (64, 128, 256, 512)
    decoder: tuple[int, ...] = (256, 128, 64, 64)
    pretrained: str | None = None

    def __post_init__(self) -> None:
        for name in ("depths", "widths", "decoder"):
            numbers = getattr(self, name)
            if len(numbers) != _STAGES or min(numbers) < 1:
                raise ValueError(f"{name} needs {_STAGES} positive numbers, got {numbers}")


def build_resnet(config: UNetConfig, channels: int) -> nn.Module:
    """Build the encoder, a `ResNetBackbone`; importing `transformers` takes some seconds.

    Published weights are for 3 channels: with another number the first convolution's kernels are
    summed over the colours, as if a grey picture were given three times, and shared among them.
    OSError where the weights can't be had, ValueError where they are of another size.
    """
    from transformers import ResNetBackbone, ResNetConfig

    if config.pretrained is None:
        size = ResNetConfig(
            num_channels=channels,
            embedding_size=config.widths[0],
            hidden_sizes=list(config.widths),
            depths=list(config.depths),
            layer_type="basic",
        )
        return ResNetBackbone(size)  # type: ignore[no-any-return]
    resnet = load_published(ResNetBackbone, config.pretrained)
    found = tuple(resnet.config.depths), tuple(resnet.config.hidden_sizes)
    if found != (config.depths, config.widths):
        raise ValueError(
            f"{config.pretrained!r} has depths and widths {found}, but "
            f"{(config.depths, config.widths)} is configured"
        )
    if channels != 3:
        old = resnet.embedder.embedder.convolution
        new = nn.Conv2d(channels, old.out_channels, 7, stride=2, padding=3, bias=False)
        with torch.no_grad():
            new.weight.copy_(old.weight.sum(dim=1, keepdim=True) / channels)
        resnet.embedder.embedder.convolution = new
        resnet.embedder.num_channels = channels
    return resnet  # type: ignore[no-any-return]


class ResNetUNet(nn.Module):
    """From a picture of so many channels to features at half of its resolution.

    With `lite` an EfficientNet-Lite0 of four stages is the encoder instead, of sRGB in 0..1.
    """

    def __init__(self, config: UNetConfig, channels: int, lite: LiteConfig | None = None) -> None:
        super().__init__()
        if lite:
            self.lite, widths, half = EfficientNetLite0(lite), lite.channels, HALF
        else:
            self.resnet, widths = build_resnet(config, channels), config.widths
            half = widths[0]
        skips = (*reversed(widths[:-1]), half)  # strides 16, 8, 4, 2
        below = (widths[-1], *config.decoder[:-1])
        self.blocks = nn.ModuleList(
            _DecoderBlock(low + skip, out)
            for low, skip, out in zip(below, skips, config.decoder, strict=True)
        )

    def forward(self, picture: Tensor) -> Tensor:
        """Compute features (B, decoder[-1], ceil(H / 2), ceil(W / 2)) of pictures (B, C, H, W).

        The ResNet's feature in row i, column j is centred on the picture's pixel (2 i, 2 j).
        Lite0's reach beyond the picture where its size is no multiple of 32.
        """
        if hasattr(self, "lite"):
            *skips, values = self.lite(picture, half=True)  # strides 2, 4, 8, 16 and 32
        else:
            resnet: Any = self.resnet
            skips = [resnet.embedder.embedder(picture)]  # (B, widths[0], H / 2, W / 2)
            values = resnet.embedder.pooler(skips[0])  # (B, widths[0], H / 4, W / 4)
            for stage in resnet.encoder.stages:
                values = stage(values)  # (B, widths[s], H / 2^(s+2), W / 2^(s+2))
                skips.append(values)
            skips.pop()
        for block, skip in zip(self.blocks, reversed(skips), strict=True):
            values = block(values, skip)  # (B, decoder[b], twice as high, twice as wide)
        return values  # type: ignore[no-any-return]


class _DecoderBlock(nn.Module):
    """Enlarge to the skip's size, join, convolve twice."""

    def __init__(self, channels: int, out: int) -> None:
        super().__init__()
        self.convolutions = nn.Sequential(*_convolution(channels, out), *_convolution(out, out))

    def forward(self, low: Tensor, skip: Tensor) -> Tensor:
        size = (int(skip.shape[2]), int(skip.shape[3]))
        joined = torch.cat((functional.interpolate(low, size=size, mode="nearest"), skip), dim=1)
        values: Tensor = self.convolutions(joined)
        return values


def _convolution(channels: int, out: int) -> tuple[nn.Module, ...]:
    return (
        nn.Conv2d(channels, out, 3, padding=1, bias=False),
        nn.BatchNorm2d(out),
        nn.ReLU(inplace=True),
    )
