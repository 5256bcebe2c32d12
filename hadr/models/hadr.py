"""HADR: the restored depth of each pixel from its ray, the voxels it crosses, and the hand.

The steps of `HADR.forward`: colour to a dense feature map; corrupted depth to points to occupied
voxels; masked pixels to rays, and rays to pairs with the voxels that they cross; for each pair the
probability that its ray ends there; for the most probable pair of each ray the offset between
entering the voxel and the surface.

Source: paper, section III-B and equations 1 and 2; ledger, rows 3 to 7, 10 and 11.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import torch
from torch import Tensor, nn
from torch.nn import functional

from hadr import ray_voxels
from hadr.hand import absolute_hand_feature, relative_hand_feature
from hadr.models.backbone import BackboneConfig, ColorBackbone
from hadr.models.blocks.efficientnet_lite import LiteConfig
from hadr.models.config import NetworkConfig
from hadr.models.decoders import OffsetDecoder, PairDecoder, encode_position, leaky_clamp
from hadr.models.network_input import DepthOutput, HADRInput, float_color, masked_rays, ray_points
from hadr.models.ray_features import RayFeatures, features_at
from hadr.models.voxel_features import VoxelFeatures
from hadr.models.window import WindowConfig, through_window
from hadr.records.provenance import IF_CHANGED

HandFeature = Literal["none", "2d", "xy", "3d"]
POSITION_LEVELS = 8
DIRECTION_LEVELS = 4


@dataclass(frozen=True)
class HADRConfig(NetworkConfig):
    """What the network consists of; the defaults are the paper's full model.

    Args:
        hand: "3d" is the paper's hand feature (126 numbers: keypoints in the wrist frame, and
            relative to the voxel); "2d" the ablation with the keypoints' pixels divided by the
            image's width and height (42); "xy" what the published code calls 2D, x and y of the
            keypoints in metres, from the wrist and from the voxel (84; ledger, row 34); "none" the
            ablation without.
        wrist_rotation: Turn the absolute hand feature into the wrist frame (ledger, row 7).
        aggregation: Aggregate all scales of the backbone, or use the finest alone.
        point_fusion: Fuse the dense colour feature with the points, or use their raw colour.
        backbone: Size of the Swin Transformer.
        grid: The voxel grid.
        feature_channels: Channels of the dense colour feature.
        voxel_width: Length of a voxel's feature.
        decoder_widths: Hidden layers of both decoders.
        offset_steps: How often the offset decoder runs.
        max_points: Most points of one frame that enter the voxels.
        clamp_probability: End the probability head in the leaky clamp as the published code does.
            It caps a ray's best probability near e / (e + K - 1) for K voxels, so it is off.
        view: Look at a window around hand and glass; None looks at the whole picture.
        lite: An EfficientNet-Lite0 in the Swin Transformer's place.
        voxel_relu: End the voxel encoder's two layers on voxels in a ReLU, as the published code
            does and the networks of preset `mini` don't (ledger, row 28).

    Raises:
        ValueError: `hand` is unknown.
    """

    hand: HandFeature = "3d"
    wrist_rotation: bool = True
    aggregation: bool = True
    point_fusion: bool = True
    backbone: BackboneConfig = field(default_factory=BackboneConfig)
    grid: ray_voxels.VoxelGrid = field(default_factory=ray_voxels.VoxelGrid)
    feature_channels: int = 32
    voxel_width: int = 128
    decoder_widths: tuple[int, ...] = (256, 128, 64)
    offset_steps: int = 2
    max_points: int = 10_000
    clamp_probability: bool = False
    view: WindowConfig | None = field(default=None, metadata=IF_CHANGED)
    lite: LiteConfig | None = field(default=None, metadata=IF_CHANGED)
    voxel_relu: bool = field(default=False, metadata=IF_CHANGED)

    def __post_init__(self) -> None:
        if self.hand not in get_args(HandFeature):
            raise ValueError(f"hand must be one of {get_args(HandFeature)}, got {self.hand!r}")

    @property
    def hand_width(self) -> int:
        """Length of the hand feature."""
        return {"none": 0, "2d": 42, "xy": 84, "3d": 126}[self.hand]

    @property
    def parts(self) -> tuple[int, int, int]:
        """Widths of what a pair's embedding takes from its ray, its voxel and itself."""
        ray = 4 * self.feature_channels + 3 * (1 + 2 * DIRECTION_LEVELS)
        voxel = self.voxel_width + self.hand_width
        return ray, voxel, 2 * 3 * (1 + 2 * POSITION_LEVELS)


@dataclass(frozen=True)
class HADROutput(DepthOutput):
    """Restored depth, and per ray and pair what the losses need.

    Attributes:
        rays: Rows (frame, row, column) of the rays' pixels, shape (R, 3), long.
        points: Predicted point of each ray in metres, camera frame, shape (R, 3); zeros where
            there is none.
        chosen: Row of the chosen pair of each ray, shape (R,), long; -1 where there is none.
        pairs: The ray-voxel pairs.
        occupied: The occupied voxels.
        logits: Score of each pair, shape (P,).
        probability: Softmax of the scores over each ray's pairs, shape (P,).
        offset: Offset of each ray's chosen pair in 0..1 of the voxel's diagonal, shape (R,).
        clamped: Where the offset lies at an end of its voxel, or beyond: the network wanted another
            answer than it may give, shape (B, H, W), bool.
    """

    rays: Tensor
    points: Tensor
    chosen: Tensor
    pairs: ray_voxels.RayVoxelPairs
    occupied: ray_voxels.OccupiedVoxels
    logits: Tensor
    probability: Tensor
    offset: Tensor
    clamped: Tensor


@dataclass(frozen=True)
class Seen:
    """What the network computed on the way, for a stage that comes after it.

    Attributes:
        points: Measured points that entered the voxels, metres, camera frame, shape (N, 3).
        color: What the voxels took of their colour: RGB (N, 3), or with point fusion the dense
            feature (N, feature_channels).
        directions: Unit direction of each ray, camera frame, shape (R, 3).
        in_ray: Embedding of each ray, shape (R, parts[0]).
    """

    points: Tensor
    color: Tensor
    directions: Tensor
    in_ray: Tensor


class HADR(nn.Module):
    """The whole network.

    Args:
        config: What it consists of.
        backbone: Another colour network instead of the configuration's: a module that turns colour
            (B, 3, H, W) into a map (B, feature_channels, H, W).
    """

    def __init__(self, config: HADRConfig | None = None, backbone: nn.Module | None = None) -> None:
        super().__init__()
        self.config = config = config or HADRConfig()
        self.backbone: Any = backbone or ColorBackbone(
            config.lite or config.backbone, config.feature_channels, multi_scale=config.aggregation
        )
        self.ray_features = RayFeatures()
        self.voxel_features = VoxelFeatures(
            config.point_fusion, config.feature_channels, config.voxel_width, config.voxel_relu
        )
        self.probability_decoder = PairDecoder(config.parts, config.decoder_widths)
        self.offset_decoder = OffsetDecoder(
            config.parts, config.decoder_widths, config.offset_steps
        )

    @through_window
    def forward(
        self, inputs: HADRInput, *, rays: Tensor | None = None, true_depth: Tensor | None = None
    ) -> HADROutput:
        """Restore the depth of masked pixels.

        Of all, or of the `rays`, rows (frame, row, column), (R, 3) long. With true depth, metres,
        (B, H, W), 0 = unknown, each ray takes the voxel in which its true point lies, if that is a
        candidate, instead of the most probable one: how the first epochs of training go.
        """
        return self.restore(inputs, rays=rays, true_depth=true_depth)[0]

    def restore(
        self, inputs: HADRInput, *, rays: Tensor | None = None, true_depth: Tensor | None = None
    ) -> tuple[HADROutput, Seen]:
        """Do as `forward`, and give what a second stage needs too."""
        grid = self.config.grid
        picture = float_color(inputs.color)  # (B, 3, H, W)
        dense = self.backbone(picture)  # (B, 32, H, W)

        pixels = ray_voxels.select_points(inputs.depth, self.config.max_points)  # (points, 3)
        away = inputs.depth[*pixels.unbind(dim=1)]  # (points,)
        points = ray_points(pixels, away, inputs.intrinsics)  # (points, 3)
        occupied = ray_voxels.occupied_voxels(points, pixels[:, 0], grid, len(inputs))
        color = features_at(dense if self.config.point_fusion else picture, pixels)
        voxel = self.voxel_features(
            points, color, occupied.point_voxel, occupied.center
        )  # (voxels, 128)

        rays = masked_rays(inputs.mask) if rays is None else rays  # (rays, 3)
        unit_depth = points.new_ones(len(rays))
        directions = functional.normalize(
            ray_points(rays, unit_depth, inputs.intrinsics), dim=1
        )  # (rays, 3)
        pairs = ray_voxels.ray_voxel_pairs(directions, rays[:, 0], occupied, grid)

        in_ray = torch.cat(
            (self.ray_features(dense, rays), encode_position(directions, DIRECTION_LEVELS)), dim=1
        )  # (rays, 155)
        in_voxel = torch.cat((voxel, self._hand_feature(inputs, occupied)), dim=1)  # (voxels, 254)

        along = directions.index_select(0, pairs.ray)  # (pairs, 3)
        enter, leave = along * pairs.t_in[:, None], along * pairs.t_out[:, None]
        in_pair = torch.cat(
            (encode_position(enter, POSITION_LEVELS), encode_position(leave, POSITION_LEVELS)),
            dim=1,
        )  # (pairs, 102)

        first = self.probability_decoder.begin(in_ray, in_voxel, in_pair, pairs.ray, pairs.voxel)
        logits = self.probability_decoder.finish(first)  # (pairs,)
        if self.config.clamp_probability:
            logits = leaky_clamp(logits)
        probability = ray_voxels.segment_softmax(logits, pairs.ray, pairs.n_rays)  # (pairs,)
        chosen = ray_voxels.segment_argmax(probability.detach(), pairs.ray, pairs.n_rays)  # (rays,)
        if true_depth is not None:
            away = true_depth[*rays.unbind(dim=1)]  # (rays,)
            true_points = ray_points(rays, away, inputs.intrinsics)
            true_pair = ray_voxels.pair_of_true_point(pairs, occupied, true_points, grid)
            chosen = torch.where(true_pair >= 0, true_pair, chosen)

        # Only the chosen pair of a ray needs an offset: the loss sees no other.
        ray = (chosen >= 0).nonzero().squeeze(1)  # rays with a candidate
        pair = chosen.index_select(0, ray)
        offset = self.offset_decoder(
            in_ray, in_voxel, in_pair.index_select(0, pair), ray, pairs.voxel.index_select(0, pair)
        )  # (rays with a candidate,)
        distance = pairs.t_in.index_select(0, pair) + offset * math.sqrt(3) * grid.voxel_size
        found = distance[:, None] * directions.index_select(0, ray)  # (rays with a candidate, 3)

        frame, row, column = rays.index_select(0, ray).unbind(dim=1)
        where = (frame, row, column)
        in_front = (found[:, 2] > 0).to(found.dtype)
        blank = torch.zeros_like(inputs.depth)
        cut = ((offset <= 0) | (offset >= 1)).to(blank.dtype)
        output = HADROutput(
            depth=blank.index_put(where, found[:, 2] * in_front),
            restored=blank.index_put(where, in_front) > 0,
            rays=rays,
            points=found.new_zeros(len(rays), 3).index_copy(0, ray, found),
            chosen=chosen,
            pairs=pairs,
            occupied=occupied,
            logits=logits,
            probability=probability,
            offset=offset.new_zeros(len(rays)).index_copy(0, ray, offset),
            clamped=blank.index_put(where, cut) > 0,
        )
        return output, Seen(points, color, directions, in_ray)

    def _hand_feature(self, inputs: HADRInput, occupied: ray_voxels.OccupiedVoxels) -> Tensor:
        """Give each voxel its hand feature: (voxels, `hand_width`)."""
        if self.config.hand == "none":
            return occupied.center.new_zeros(len(occupied), 0)
        if self.config.hand == "2d":
            height, width = inputs.color.shape[2:]
            size = inputs.keypoints_uv.new_tensor([width, height])
            uv = ((inputs.keypoints_uv + 0.5) / size).flatten(1)  # (B, 42)
            return uv.index_select(0, occupied.frame)
        whole = self.config.hand == "3d"
        absolute = absolute_hand_feature(
            inputs.keypoints, wrist_rotation=whole and self.config.wrist_rotation
        )  # (B, 63)
        keypoints = inputs.keypoints.index_select(0, occupied.frame)
        relative = relative_hand_feature(keypoints, occupied.center)  # (voxels, 63)
        feature = torch.cat((absolute.index_select(0, occupied.frame), relative), dim=1)
        return feature if whole else feature.reshape(-1, 42, 3)[..., :2].flatten(1)
