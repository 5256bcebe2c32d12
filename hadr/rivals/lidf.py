"""LIDF with its refinement: HADR without the hand, and a second stage along the ray.

**First stage.** It is `HADR` with three differences: the colour network is a dilated ResNet of
stride 8 (`DilatedResNet`); a point enters its voxel as its position relative to the centre and its
RGB; there is no hand. A pair's embedding is 128 (ray) + 128 (voxel) + 51 + 51 + 27 (positions,
direction) = 385.

**Refinement.** The first stage is frozen. Its answer on each ray is added, with the pixel's
colour, to the points of the voxel in which it lies: the occupied voxel there, or that of the ray's
chosen pair where there is none. An encoder of its own looks at the voxels again, and an offset
decoder of its own, given 128 (ray) + 27 (direction) + 128 (voxel) + 51 (the answer's position) =
334 numbers, moves the answer along its ray by -0.2 to 0.2 m. This is done twice with the same
weights; gradients flow through both. The answers of all rays of a frame enter the voxels at once,
so the rays of a frame influence each other here.

**Stages.** `stage` is a part of the state: 1 until the refinement begins to learn, and as long the
network answers with its first stage alone. `set_stage` changes it; the training does so by the
epoch (`hadr.training.tasks.lidf`). In stage 2 no gradient reaches the first stage and it stays
in evaluation mode whatever `train` asks for, so its weights and running statistics do not move.

**Checked in the published code:** all sizes above, stride and dilations, ImageNet's mean and
deviation taken off the colours everywhere, 2 iterations, the range of 0.2 m, the end voxel, and
how ends are perturbed in training. **Different here:** what the ledger's rows 3 and 10 say of HADR
(points are spread in raster order, not within 8x8 blocks; rays without a candidate are not
restored); ROI boxes at the border, as in `RayFeatures`; decoders start as HADR's do, and the
refinement starts as the identity, where the published one starts near -0.2 m; a move is cut off at
0.2 m exactly, with the leaky clamp's gradient, where the published one leaks a little; the
published training keeps the frozen stage's batch normalisation in training mode, and ends with a
third part on the worst tenth of the rays at a rate of 1e-4, which is left out. **Not checked:**
whether the paper's own figures include that third part, and nothing was compared with the
published weights.

Source: Zhu et al. 2021, "RGB-D Local Implicit Function for Depth Completion of Transparent
Objects", and its published code for the numbers.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar

import torch
from torch import Tensor, nn

from hadr.models.backbone import enlarge, imagenet_normal
from hadr.models.blocks.efficientnet_lite import LiteConfig
from hadr.models.blocks.resnet import UNetConfig, build_resnet
from hadr.models.config import NetworkConfig
from hadr.models.decoders import OffsetDecoder, encode_position
from hadr.models.hadr import HADR, POSITION_LEVELS, HADRConfig, HADROutput, Seen
from hadr.models.network_input import HADRInput, float_color
from hadr.models.ray_features import features_at
from hadr.models.voxel_features import VoxelFeatures
from hadr.models.window import WindowConfig, through_window
from hadr.ray_voxels import OccupiedVoxels, VoxelGrid, voxels_at
from hadr.records.provenance import IF_CHANGED

STRIDE = 8
"""Pixels from one cell of the colour network's map to the next."""
DILATIONS = {2: 2, 3: 4}
"""Dilation of its stages that do not halve, by their number from 0."""


@dataclass(frozen=True)
class DilatedResNetConfig(NetworkConfig):
    """Size of the colour network; the defaults are ResNet-34's.

    Args:
        depths: Residual blocks of each stage.
        widths: Channels of each stage; the first convolution has as many as the first stage.
        pretrained: Name of published ImageNet weights, such as "microsoft/resnet-34"; None starts
            from random weights, as the published network does.
    """

    depths: tuple[int, ...] = (3, 4, 6, 3)
    widths: tuple[int, ...] = (64, 128, 256, 512)
    pretrained: str | None = None


class DilatedResNet(nn.Module):
    """From colour to a dense feature map of so many channels.

    The stages of a ResNet halve the resolution: strides 4, 8, 16, 32. Here the last two do not;
    their 3x3 kernels reach two and four times as far instead (dilation 2 and 4). A 1x1 convolution
    takes the last stage to the wanted channels, and a bilinear resize to the image.

    A cell of the map is centred on the picture's pixel (8 i, 8 j), the resize takes it to be
    centred on (8 i + 3.5, 8 j + 3.5): the published network has the same fixed shift, which it can
    learn.
    """

    def __init__(self, config: DilatedResNetConfig, channels: int = 32) -> None:
        super().__init__()
        size = UNetConfig(config.depths, config.widths, pretrained=config.pretrained)
        self.resnet = build_resnet(size, 3)
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


@dataclass(frozen=True)
class LIDFConfig(NetworkConfig):
    """What the network consists of; the defaults are the published size.

    Args:
        backbone: Size of the dilated ResNet.
        grid: The voxel grid.
        normalize_color: Subtract ImageNet's mean and divide by its standard deviation.
        feature_channels: Channels of the dense colour feature.
        voxel_width: Length of a voxel's feature, in both stages.
        decoder_widths: Hidden layers of all decoders.
        offset_steps: How often an offset decoder runs.
        max_points: Most measured points of one frame that enter the voxels.
        refine: Have the second stage.
        refine_iterations: How often it moves the answers.
        refine_range_m: Longest move along the ray in one iteration, metres.
        first_share: Share of a training's epochs in which the first stage learns alone.
        perturb_probability: Chance that the ends of a training batch are perturbed before the
            refinement, 0..1.
        view: Look at a window around hand and glass; None looks at the whole picture.
        lite: An EfficientNet-Lite0, as HADR's, in the dilated ResNet's place.
        voxel_relu: End the voxel encoders' layers on voxels in a ReLU (ledger, row 28).

    Raises:
        ValueError: `lite`, which normalises colours itself, together with `normalize_color`.
    """

    hand: ClassVar[str] = "none"
    backbone: DilatedResNetConfig = field(default_factory=DilatedResNetConfig)
    grid: VoxelGrid = field(default_factory=VoxelGrid)
    normalize_color: bool = True
    feature_channels: int = 32
    voxel_width: int = 128
    decoder_widths: tuple[int, ...] = (256, 128, 64)
    offset_steps: int = 2
    max_points: int = 10_000
    refine: bool = True
    refine_iterations: int = 2
    refine_range_m: float = 0.2
    first_share: float = 2 / 3
    perturb_probability: float = 0.8
    view: WindowConfig | None = field(default=None, metadata=IF_CHANGED)
    lite: LiteConfig | None = field(default=None, metadata=IF_CHANGED)
    voxel_relu: bool = field(default=False, metadata=IF_CHANGED)

    def __post_init__(self) -> None:
        if self.lite and self.normalize_color:
            raise ValueError(
                "lite normalises colours itself: normalize_color must be False with it, got True"
            )

    @property
    def first_stage(self) -> HADRConfig:
        """The first stage as `HADR` takes it; its Swin Transformer is not used."""
        return HADRConfig(
            hand="none",
            point_fusion=False,
            grid=self.grid,
            feature_channels=self.feature_channels,
            voxel_width=self.voxel_width,
            decoder_widths=self.decoder_widths,
            offset_steps=self.offset_steps,
            max_points=self.max_points,
            voxel_relu=self.voxel_relu,
            lite=self.lite,
        )


@dataclass(frozen=True)
class LIDFOutput(HADROutput):
    """What `HADROutput` holds, with `depth`, `restored`, `points`, `clamped` of the last stage.

    All else (`chosen`, `pairs`, `logits`, `probability`, `offset`) is of the first
    stage. Where it was refined, `points` may lie outside of the chosen pair's voxel, and those
    with a longest move are `clamped`.

    Attributes:
        first_points: The first stage's point of each ray, not perturbed, in metres, camera frame,
            shape (R, 3); zeros where there is none.
        moves: How far each iteration of the refinement moved each point along its ray, metres,
            shape (R, iterations); no column where it did not run.
    """

    first_points: Tensor
    moves: Tensor


class Refinement(nn.Module):
    """Move points along their rays, seeing what lies around them."""

    def __init__(self, config: LIDFConfig) -> None:
        super().__init__()
        self.config = config
        self.voxel_features = VoxelFeatures(
            point_fusion=False, width=config.voxel_width, voxel_relu=config.voxel_relu
        )
        parts = (*config.first_stage.parts[:2], 3 * (1 + 2 * POSITION_LEVELS))  # ray, voxel, answer
        self.offset_decoder = OffsetDecoder(parts, config.decoder_widths, config.offset_steps)
        # It starts as the identity: an offset of 0.5, which is no move, whatever it sees.
        last = self.offset_decoder.decoder.rest[-1]
        no_move = (0.5 - OffsetDecoder.start) / config.offset_steps
        nn.init.zeros_(last.weight)  # type: ignore[arg-type]
        nn.init.constant_(last.bias, no_move)  # type: ignore[arg-type]

    def forward(
        self,
        distance: Tensor,
        color: Tensor,
        frame: Tensor,
        end: Tensor,
        seen: Seen,
        occupied: OccupiedVoxels,
    ) -> Tensor:
        """Compute the moves of R rays in each iteration, metres along the ray, (R, iterations).

        From each answer's distance along the ray, metres, (R,), the colour at its pixel, (R, 3),
        its frame, (R,), and `end`, the row of the voxel that counts as the answer's where it lies
        in no occupied one, (R,); what the first stage saw on these rays; and the occupied voxels.
        """
        config = self.config
        own = torch.arange(len(distance), device=distance.device)
        moves = []
        for _ in range(config.refine_iterations):
            answers = distance[:, None] * seen.directions  # (rays, 3)
            found = voxels_at(answers.detach(), frame, occupied, config.grid)
            voxel = torch.where(found >= 0, found, end)  # (rays,)
            # Measured points of voxels in which no answer lies change nothing: leave them out.
            wanted = torch.zeros(len(occupied) + 1, dtype=torch.bool, device=voxel.device)
            wanted[voxel] = True
            kept = wanted[occupied.point_voxel].nonzero().squeeze(1)  # row -1 is never wanted
            in_voxel = self.voxel_features(
                torch.cat((seen.points.index_select(0, kept), answers)),
                torch.cat((seen.color.index_select(0, kept), color)),
                torch.cat((occupied.point_voxel.index_select(0, kept), voxel)),
                occupied.center,
            )  # (voxels, 128)
            position = encode_position(answers, POSITION_LEVELS)  # (rays, 51)
            offset = self.offset_decoder(seen.in_ray, in_voxel, position, own, voxel)  # (rays,)
            # Cut off at the ends, but with the slope that the leaky clamp has there.
            offset = offset.detach().clamp(0, 1) + (offset - offset.detach())
            moves.append(config.refine_range_m * (2 * offset - 1))
            distance = distance + moves[-1]
        return torch.stack(moves, dim=1)


class LIDF(nn.Module):
    """The whole network."""

    def __init__(self, config: LIDFConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or LIDFConfig()
        self.first = HADR(
            config.first_stage,
            None if config.lite else DilatedResNet(config.backbone, config.feature_channels),
        )
        self.refinement = Refinement(config) if config.refine else None
        self.register_buffer("stage", torch.tensor(1))
        self.stage: Tensor

    @property
    def refines(self) -> bool:
        """Whether the refinement is at work: stage 2."""
        return self.refinement is not None and int(self.stage) == 2

    def set_stage(self, stage: int) -> None:
        """Go to stage 1, the first stage alone, or 2, the refinement with that frozen."""
        self.stage.fill_(stage)
        self.train(self.training)

    def train(self, mode: bool = True) -> LIDF:
        """Set the training mode; a frozen first stage stays in evaluation mode."""
        super().train(mode)
        if self.refines:
            self.first.eval()
        return self

    @through_window
    def forward(
        self,
        inputs: HADRInput,
        *,
        rays: Tensor | None = None,
        true_depth: Tensor | None = None,
        perturbation_m: float = 0.0,
    ) -> LIDFOutput:
        """Restore the depth of masked pixels as `HADR.forward`; the hand is not looked at.

        Before they are refined, the first stage's points are moved away along their rays by
        `perturbation_m`, metres; without refinement it does nothing.
        """
        picture = float_color(inputs.color)  # (B, 3, H, W)
        if self.config.normalize_color:
            picture = imagenet_normal(picture)
        frozen = self.refines
        with torch.set_grad_enabled(torch.is_grad_enabled() and not frozen):
            first, seen = self.first.restore(
                replace(inputs, color=picture), rays=rays, true_depth=true_depth
            )
        values = {f.name: getattr(first, f.name) for f in fields(HADROutput)}
        if self.refinement is None or not frozen:
            none = first.points.new_zeros(len(first.rays), 0)
            return LIDFOutput(**values, first_points=first.points, moves=none)

        ray = (first.chosen >= 0).nonzero().squeeze(1)  # rays with a candidate
        pixel = first.rays.index_select(0, ray)
        end = first.pairs.voxel.index_select(0, first.chosen.index_select(0, ray))
        directions, in_ray = (x.index_select(0, ray) for x in (seen.directions, seen.in_ray))
        start = first.points.index_select(0, ray).norm(dim=1) + perturbation_m
        moves = self.refinement(
            start,
            features_at(picture, pixel),
            pixel[:, 0],
            end,
            replace(seen, directions=directions, in_ray=in_ray),
            first.occupied,
        )  # (rays with a candidate, iterations)
        found = (start + moves.sum(dim=1))[:, None] * directions

        where = tuple(pixel.unbind(dim=1))
        in_front = (found[:, 2] > 0).to(found.dtype)
        blank = torch.zeros_like(first.depth)
        longest = moves.detach().abs() >= self.config.refine_range_m * (1 - 1e-6)
        values |= {
            "depth": blank.index_put(where, found[:, 2] * in_front),
            "restored": blank.index_put(where, in_front) > 0,
            "points": torch.zeros_like(first.points).index_copy(0, ray, found),
            "clamped": torch.zeros_like(first.restored).index_put(where, longest.any(dim=1)),
        }
        moved = moves.new_zeros(len(first.rays), moves.shape[1]).index_copy(0, ray, moves)
        return LIDFOutput(**values, first_points=first.points, moves=moved)
