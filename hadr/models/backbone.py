"""The colour backbone: a Swin Transformer and the aggregation of its scales into one dense map.

Stage i of a Swin Transformer has stride 4 * 2^(i-1) and embed_dim * 2^(i-1) channels. (The paper
prints H/4i x W/4i x iC, which is not what a Swin Transformer gives: ledger, row 11.)

Source: paper, "Ray and Voxel Feature Extraction"; Liu et al. 2021, "Swin Transformer". The Swin
Transformer itself is that of the `transformers` package, in plain torch.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from hadr.models.blocks.efficientnet_lite import EfficientNetLite0, LiteConfig
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
        pretrained: Name of published weights, e.g. "microsoft/swin-tiny-patch4-window7-224", which
            are fetched once over the network; None starts from random weights.
        patch: Side of a token of the first stage, pixels; 2 keeps more of a small picture.

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


def imagenet_normal(color: Tensor) -> Tensor:
    """Take ImageNet's mean off sRGB in 0..1, (B, 3, H, W), and divide by its deviation."""
    mean, std = (color.new_tensor(c)[:, None, None] for c in (IMAGENET_MEAN, IMAGENET_STD))
    return (color - mean) / std


def load_published(kind: Any, name: str, **options: Any) -> Any:
    """Load a network of `transformers` with published weights; OSError if they can't be had.

    Only safetensors are read, of a name of the hub: ValueError for a folder.
    """
    # What it tries in vain is one sentence in the end.
    logging.getLogger("huggingface_hub").setLevel(logging.ERROR)
    if Path(name).exists():
        raise ValueError(f"{name!r} is a file or folder, expected a name of the public hub")
    try:
        return kind.from_pretrained(name, use_safetensors=True, **options)
    except (OSError, RuntimeError) as error:
        raise OSError(
            f"the weights {name!r} are not in the local cache and could not be fetched; connect to "
            "the network once, or leave `pretrained` out to start from random weights "
            f"({type(error).__name__})"
        ) from error


def build_swin(config: BackboneConfig) -> nn.Module:
    """Build a module that turns colour (B, 3, H, W) into one feature map a stage; takes seconds.

    OSError where the named weights can't be had, ValueError where they are of another size.
    """
    if config.pretrained is None:
        return random_swin(config)  # type: ignore[no-any-return]
    from transformers import SwinBackbone

    chosen = {"out_features": _stages(config), "drop_path_rate": config.drop_path}
    swin: nn.Module = load_published(SwinBackbone, config.pretrained, **chosen)
    own: Any = swin.config
    found = (own.embed_dim, tuple(own.depths), own.window_size, own.patch_size)
    wanted = (config.embed_dim, config.depths, config.window, config.patch)
    if found != wanted:
        raise ValueError(
            f"{config.pretrained!r} has embed_dim, depths, window and patch {found}, but "
            f"{wanted} is configured"
        )
    return swin


def random_swin(config: Any, **more: Any) -> Any:
    """Build a Swin Transformer with random weights, of a size, and with more for `SwinConfig`."""
    from transformers import SwinBackbone, SwinConfig

    size = SwinConfig(
        embed_dim=config.embed_dim,
        patch_size=config.patch,
        depths=list(config.depths),
        num_heads=list(config.heads),
        window_size=config.window,
        drop_path_rate=config.drop_path,
        out_features=_stages(config),
        **more,
    )
    return SwinBackbone(size)


def _stages(config: Any) -> list[str]:
    return [f"stage{number + 1}" for number in range(len(config.depths))]


def enlarge(features: Tensor, factor: int, size: Sequence[int]) -> Tensor:
    """Resize (B, C, h, w) bilinearly by a whole factor, then cut off what lies beyond the picture.

    A picture's height need not be a whole number of cells: the last one may reach beyond its end.
    A map is enlarged by the side of its cells and then cut to `size` (height, width), never
    squeezed into the picture.
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
        """Aggregate the stages, finest first, each (B, C_i, H_i, W_i) and half as fine as before.

        Returns:
            The map at the first stage's size, shape (B, channels, H / 4, W / 4), in memory with the
            channels last.
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
    """From sRGB in 0..1 (B, 3, H, W) to the dense colour feature map (B, channels, H, W).

    Args:
        config: Size of the encoder.
        channels: Channels of the dense map.
        multi_scale: Aggregate all stages (True) or use the first alone.
    """

    def __init__(
        self, config: BackboneConfig | LiteConfig, channels: int = 32, multi_scale: bool = True
    ) -> None:
        super().__init__()
        self.config = config
        if isinstance(config, LiteConfig):
            self.lite, self.patch = EfficientNetLite0(config), 4
        else:
            self.swin, self.patch = build_swin(config), config.patch
        self.aggregation = FeatureAggregation(config.channels, channels, multi_scale)

    def forward(self, color: Tensor) -> Tensor:
        """Compute the dense map."""
        if isinstance(self.config, LiteConfig):
            stages = self.lite(color)  # each (B, C_i, H / s_i, W / s_i)
        else:
            seen = imagenet_normal(color) if self.config.normalize_color else color
            stages = self.swin(seen).feature_maps  # each (B, C_i, H / s_i, W / s_i)
        coarse = self.aggregation(stages)  # (B, channels, H / 4, W / 4)
        return enlarge(coarse, self.patch, color.shape[2:])
