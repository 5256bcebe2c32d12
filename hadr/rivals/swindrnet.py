"""SwinDRNet, the rival that has two Swin Transformers and no hand.

One encoder sees colour, the other measured depth as a picture. At each of their stages a window of
one asks the same window of the other (cross-attention). Two UPerNet heads read what comes out: one
draws a first depth image, the other decides pixel by pixel which share of the answer is that image
and which share is the measured depth. The object's mask is not shown to the network.

Where description and published code differ:

* The code computes the cross-attention, but with windows that are not shifted it goes on with the
  attention's input. Here its result is used, as described.
* The code does not set missing depth apart: it enters the mix as 0 m. The confidence has to learn
  that it can't be trusted, and until then the answer is drawn towards 0. Here missing depth has no
  share; `mix_missing` is the published mix.
* The depth head starts at 0 m there. The normals of a surface at 0 m have no direction, and their
  loss no bounded gradient; so here it starts at `start_m`.
* Padding beside the image is attended to there (not at 224x224, where there is none); not here.

Source: Dai et al. 2022, "Domain Randomization-Enhanced Depth Simulation and Restoration for
Perceiving and Grasping Specular and Transparent Objects"; Xiao et al. 2018, "Unified Perceptual
Parsing for Scene Understanding" (the heads).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import torch
from torch import Tensor, nn

from hadr.models.backbone import BackboneConfig, build_swin, enlarge, imagenet_normal
from hadr.models.blocks.cross_fusion import CrossFusion
from hadr.models.blocks.efficientnet_lite import EfficientNetLite0, LiteConfig
from hadr.models.blocks.pyramid_head import PyramidHead
from hadr.models.config import NetworkConfig
from hadr.models.network_input import HADRInput, ImageOutput, float_color
from hadr.models.window import WindowConfig, through_window
from hadr.records.provenance import IF_CHANGED

PUBLISHED_ENCODER = BackboneConfig(normalize_color=False)
"""Swin-T on colours in 0..1."""


@dataclass(frozen=True)
class SwinDRNetConfig(NetworkConfig):
    """What the network consists of; the defaults are the published size, 160 M weights.

    Of these, 55 M are in the two Swin-T, 20 M in the fusion (26 C^2 for a stage of C channels) and
    85 M in the two heads: 512 channels throughout, on 3 C channels a stage (fused, colour, depth).

    Args:
        backbone: Size of each encoder. The published one loads ImageNet weights into both and
            hands on 0..1 colours; depth enters in metres in any case.
        channels: Channels inside of the heads.
        pools: Cells a side of the pooling pyramid over the coarsest stage.
        fusion_heads: Attention heads of the fusion.
        dropout: Probability with which a channel is left out before a head's last layer.
        mix_missing: Missing depth takes part in the mix as 0 m, as published; False gives it no
            share.
        start_m: Depth in metres around which the untrained depth head answers; 0 is published.
        view: Look at a window around hand and glass; None looks at the whole picture.
        lite: An EfficientNet-Lite0 sees colour in the Swin Transformer's place, with as many
            stages; 1x1 convolutions bring its maps to the stages' channels.

    Raises:
        ValueError: The EfficientNet-Lite0 has another number of stages.
    """

    hand: ClassVar[str] = "none"

    backbone: BackboneConfig = PUBLISHED_ENCODER
    channels: int = 512
    pools: tuple[int, ...] = (1, 2, 3, 6)
    fusion_heads: int = 1
    dropout: float = 0.1
    mix_missing: bool = False
    start_m: float = 0.5
    view: WindowConfig | None = field(default=None, metadata=IF_CHANGED)
    lite: LiteConfig | None = field(default=None, metadata=IF_CHANGED)

    def __post_init__(self) -> None:
        if self.lite and self.lite.stages != len(self.backbone.depths):
            raise ValueError(
                f"lite must have {len(self.backbone.depths)} stages as the Swin Transformer of "
                f"depth has, got {self.lite.stages}"
            )


@dataclass(frozen=True)
class SwinDRNetOutput(ImageOutput):
    """Restored depth.

    Attributes:
        initial: The depth head's image, before measured depth is mixed in, shape (B, H, W).
        share: Share of `initial` in `image`, 0..1, shape (B, H, W); measured depth has the rest.
            The paper calls it confidence, but it is no measure of certainty: where measured depth
            is missing, predicted depth gets the whole share, however poor.
    """

    initial: Tensor
    share: Tensor


class SwinDRNet(nn.Module):
    """The whole network.

    Raises:
        OSError: Published weights are named and can't be had.
        ValueError: They are of another size than the configuration says.
    """

    def __init__(self, config: SwinDRNetConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or SwinDRNetConfig()
        stages = config.backbone.channels
        if config.lite:
            self.lite = EfficientNetLite0(config.lite)
            self.align = nn.ModuleList(
                nn.Conv2d(own, channels, 1)
                for own, channels in zip(config.lite.channels, stages, strict=True)
            )
        else:
            self.color_swin = build_swin(config.backbone)
        self.depth_swin = build_swin(config.backbone)
        if config.backbone.pretrained is None:
            # As torch does: without a bias flat patches of all depths look alike.
            for swin in [self.depth_swin] if config.lite else [self.color_swin, self.depth_swin]:
                patches: Any = swin.get_submodule("swin.embeddings.patch_embeddings.projection")
                patches.reset_parameters()
        self.fusions = nn.ModuleList(
            CrossFusion(channels, config.fusion_heads, config.backbone.window)
            for channels in stages
        )
        widths = [3 * channels for channels in stages]
        self.depth_head = PyramidHead(widths, config.channels, 1, config.pools, config.dropout)
        self.confidence_head = PyramidHead(widths, config.channels, 2, config.pools, config.dropout)
        nn.init.constant_(self.depth_head.last.bias, config.start_m)  # type: ignore[arg-type]

    @through_window
    def forward(self, inputs: HADRInput) -> SwinDRNetOutput:
        """Restore the depth of masked pixels; frames may be of any size."""
        raw = inputs.depth  # (B, H, W)
        size, patch = raw.shape[1:], self.config.backbone.patch
        color = float_color(inputs.color)  # (B, 3, H, W)
        measured = self.depth_swin(raw.unsqueeze(1).expand(-1, 3, -1, -1)).feature_maps
        if self.config.lite:
            seen = [
                align(values)[:, :, : other.shape[2], : other.shape[3]]
                for align, values, other in zip(self.align, self.lite(color), measured, strict=True)
            ]  # each (B, C_i, H_i, W_i)
        else:
            normal = self.config.backbone.normalize_color
            seen = self.color_swin(imagenet_normal(color) if normal else color).feature_maps
        stages = [
            torch.cat((fuse(one, other), one, other), dim=1)
            for fuse, one, other in zip(self.fusions, seen, measured, strict=True)
        ]  # each (B, 3 C_i, H_i, W_i)
        initial = enlarge(self.depth_head(stages), patch, size)[:, 0]  # (B, H, W)
        trust = enlarge(self.confidence_head(stages), patch, size)  # (B, 2, H, W)
        share = trust.softmax(dim=1)[:, 1]  # (B, H, W)
        if not self.config.mix_missing:
            share = torch.where(raw > 0, share, torch.ones_like(share))
        image = (1 - share) * raw + share * initial
        restored = inputs.mask & (image > 0)
        return SwinDRNetOutput(
            depth=image * restored, restored=restored, image=image, initial=initial, share=share
        )
