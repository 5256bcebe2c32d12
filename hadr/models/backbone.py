"""The colour backbone: a Swin Transformer and the aggregation of its scales into one dense map.

Stage i of a Swin Transformer has stride 4 * 2^(i-1) and embed_dim * 2^(i-1) channels. (The paper
prints H/4i x W/4i x iC, which is not what a Swin Transformer gives: ledger, row 11.)

Source: paper, "Ray and Voxel Feature Extraction"; Liu et al. 2021, "Swin Transformer". The Swin
Transformer itself is that of the `transformers` package, in plain torch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from hadr.models.blocks.stochastic_depth import replace_drop_path
from hadr.records.provenance import IF_CHANGED

IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_STD = (0.229, 0.224, 0.225)


@dataclass(frozen=True)
class BackboneConfig:
    """The size of the Swin Transformer; the defaults are Swin-T, the paper's.

    Args:
        embed_dim: Channels of the first stage.
        depths: Transformer blocks of each stage.
        heads: Attention heads of each stage.
        window: Side of the attention window, in tokens.
        drop_path: Largest rate of stochastic depth, 0..1.
        normalize_color: Subtract ImageNet's mean and divide by its standard deviation, as the
            ImageNet weights expect; False hands the 0..1 colours on as the published code does
            (ledger, row 13).
        patch: Side of a token of the first stage, pixels; 2 keeps more of a small picture.
        pretrained: Name of published weights, e.g. "microsoft/swin-tiny-patch4-window7-224", which
            are fetched once over the network; None starts from random weights.

    Raises:
        ValueError: The numbers of stages differ, heads do not divide a stage's channels, or the
            patch is not positive.
    """

    embed_dim: int = 96
    depths: tuple[int, ...] = (2, 2, 6, 2)
    heads: tuple[int, ...] = (3, 6, 12, 24)
    window: int = 7
    drop_path: float = 0.2
    normalize_color: bool = True
    pretrained: str | None = None
    patch: int = field(default=4, metadata=IF_CHANGED)

    def __post_init__(self) -> None:
        if len(self.depths) != len(self.heads) or not self.depths:
            raise ValueError(
                f"depths and heads need one number a stage, got {self.depths} and {self.heads}"
            )
        if self.patch < 1:
            raise ValueError(f"patch must be at least 1, got {self.patch}")
        for channels, heads in zip(self.channels, self.heads, strict=True):
            if channels % heads:
                raise ValueError(f"{heads} heads do not divide a stage of {channels} channels")

    @property
    def channels(self) -> tuple[int, ...]:
        """Channels of each stage."""
        return tuple(self.embed_dim * 2**stage for stage in range(len(self.depths)))


def build_swin(config: BackboneConfig) -> nn.Module:
    """Build the Swin Transformer; importing `transformers` takes some seconds.

    Args:
        config: Its size, and the name of its weights if any.

    Returns:
        A module that turns colour (B, 3, H, W) into one feature map a stage.

    Raises:
        OSError: The named weights can't be fetched or are not in the local cache.
        ValueError: The named weights are of another size than the configuration says.
    """
    from transformers import SwinBackbone, SwinConfig

    stages = [f"stage{number + 1}" for number in range(len(config.depths))]
    if config.pretrained is None:
        size = SwinConfig(
            embed_dim=config.embed_dim,
            patch_size=config.patch,
            depths=list(config.depths),
            num_heads=list(config.heads),
            window_size=config.window,
            drop_path_rate=config.drop_path,
            out_features=stages,
        )
        random: nn.Module = SwinBackbone(size)
        replace_drop_path(random, "SwinDropPath")
        return random
    try:
        swin: Any = SwinBackbone.from_pretrained(
            config.pretrained, out_features=stages, drop_path_rate=config.drop_path
        )
    except (OSError, RuntimeError) as error:
        raise OSError(
            f"the weights {config.pretrained!r} are not in the local cache and could not be "
            "fetched; connect to the network once, or leave `pretrained` out to start from "
            f"random weights ({type(error).__name__})"
        ) from error
    own = swin.config
    found = (own.embed_dim, tuple(own.depths), own.window_size, own.patch_size)
    wanted = (config.embed_dim, config.depths, config.window, config.patch)
    if found != wanted:
        raise ValueError(
            f"{config.pretrained!r} has embed_dim, depths, window and patch {found}, but {wanted} "
            "is configured"
        )
    pretrained: nn.Module = swin
    replace_drop_path(pretrained, "SwinDropPath")
    return pretrained


def enlarge(features: Tensor, factor: int, size: Sequence[int]) -> Tensor:
    """Resize bilinearly by a whole factor, then cut off what reaches beyond the picture.

    A picture's height need not be a whole number of cells: the last one may reach beyond its end.
    A map is enlarged by the side of its cells and then cut, never squeezed into the picture.

    Args:
        features: Shape (B, C, h, w).
        factor: Pixels that a cell becomes, along each axis.
        size: Height and width to cut to, at most (h * factor, w * factor).

    Returns:
        Shape (B, C, height, width), as `size` says.
    """
    if factor > 1:
        features = functional.interpolate(
            features, scale_factor=factor, mode="bilinear", align_corners=False
        )
    return features[:, :, : size[0], : size[1]]


class FeatureAggregation(nn.Module):
    """Bring all stages to one map of `channels` channels, of which a ray then takes its part.

    Each stage goes through a 1x1 convolution to `embed_dim` channels and is resized bilinearly to
    the first stage's size, H/4 x W/4. The stages are concatenated, a 1x1 convolution takes them to
    `channels`, and a bilinear resize brings the map to H x W.

    A cell of each stage spans twice as many pixels as one of the stage before. Where the picture is
    no multiple of the coarsest, the Swin Transformer pads below and on the right, and a coarse map
    reaches beyond the picture: what does is cut off after the resize.

    Nothing in this chain bends: convolutions of 1x1 and resizes commute (the weights of a resize
    sum to one), and two convolutions in a row are one, whose matrix is the product of theirs. So
    each stage is multiplied once, to `channels` channels, at its own small size, and the last
    resize is left to the caller. The weights are those of the chain, and so is the result.

    Args:
        stage_channels: Channels of each stage.
        channels: Channels of the dense map.
        multi_scale: False is the ablation without aggregation: only the first stage is used. The
            paper does not say which one; the first has the finest grid, and a ray needs to know
            what is at its own pixel.
    """

    def __init__(
        self, stage_channels: Sequence[int], channels: int = 32, multi_scale: bool = True
    ) -> None:
        super().__init__()
        used = list(stage_channels) if multi_scale else [stage_channels[0]]
        self.embed_dim = stage_channels[0]
        self.align = nn.ModuleList(nn.Conv2d(width, self.embed_dim, 1) for width in used)
        self.reduce = nn.Conv2d(self.embed_dim * len(used), channels, 1)

    def forward(self, stages: Sequence[Tensor]) -> Tensor:
        """Aggregate the stages at the first one's size.

        Args:
            stages: Feature maps, the finest first, each half as fine as the one before, shapes
                (B, C_i, H_i, W_i).

        Returns:
            The map at a quarter of the image's resolution, shape (B, channels, H / 4, W / 4), in
            memory with the channels last.
        """
        size = stages[0].shape[2:]
        parts = torch.split(self.reduce.weight.flatten(1), self.embed_dim, dim=1)
        small = []
        for number, (align, part) in enumerate(zip(self.align, parts, strict=True)):
            weight, bias = align.parameters()  # (embed_dim, C_i, 1, 1) and (embed_dim,)
            values = functional.linear(
                stages[number].permute(0, 2, 3, 1), part @ weight.flatten(1), part @ bias
            )  # (B, H_i, W_i, channels)
            fine = enlarge(values.permute(0, 3, 1, 2), 2**number, size)
            small.append(fine.permute(0, 2, 3, 1))  # (B, H / 4, W / 4, channels)
        _, bias = self.reduce.parameters()
        coarse = torch.stack(small).sum(dim=0) + bias  # (B, H / 4, W / 4, channels)
        return coarse.permute(0, 3, 1, 2)


class ColorBackbone(nn.Module):
    """From colour to the dense colour feature map.

    Args:
        config: Size of the Swin Transformer.
        channels: Channels of the dense map.
        multi_scale: Aggregate all stages (True) or use the first alone.
    """

    def __init__(
        self, config: BackboneConfig, channels: int = 32, multi_scale: bool = True
    ) -> None:
        super().__init__()
        self.config = config
        self.swin = build_swin(config)
        self.aggregation = FeatureAggregation(config.channels, channels, multi_scale)
        self.register_buffer("mean", torch.tensor(IMAGENET_MEAN)[:, None, None], persistent=False)
        self.register_buffer("std", torch.tensor(IMAGENET_STD)[:, None, None], persistent=False)
        self.mean: Tensor
        self.std: Tensor

    def forward(self, color: Tensor) -> Tensor:
        """Compute the dense map.

        Args:
            color: sRGB in 0..1, shape (B, 3, H, W).

        Returns:
            Features, shape (B, channels, H, W).
        """
        if self.config.normalize_color:
            color = (color - self.mean) / self.std
        stages = self.swin(color).feature_maps  # each (B, C_i, H / s_i, W / s_i)
        coarse = self.aggregation(stages)  # (B, channels, H / 4, W / 4)
        return enlarge(coarse, self.config.patch, color.shape[2:])
