"""HADR-plus: a successor of HADR that looks at the glass from the hand.

What it keeps: a ray has candidates, a network says with which probability the ray ends at each of
them and where exactly, and the hand guides both. What it changes, each by a switch:

* The candidates need no occupied voxel: the network places `candidates` surfaces along every ray
  relative to the hand's depth, such as the near wall of a glass and, through its mouth, the far
  one. HADR's voxels must hold a measured point, so a ray on which none does is lost, and a wall
  behind the glass competes with it.
* It looks at a crop in which a pixel has the same size in metres in every frame (`metric_crop`).
* Mask, depth relative to the hand's (`hand_depth`) and the keypoints with their depth
  (`keypoint_maps`) are pictures beside the colour, so that a wide neighbourhood of each ray is
  seen and not a box of 8x8 pixels.
* The keypoints in metres are also given as a vector (`hand_vector`), beside a coarse view of the
  whole crop, where the network decides what concerns the frame as a whole; from there one plane a
  frame is added to all candidates (`plane`): where the object is and how it leans.
* Each candidate has a scale: together they are a distribution over depth, a mixture of Laplace
  distributions, that the loss fits and the confidence is read from.

The network between is a plain U-Net.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch import Tensor, nn
from torch.nn import functional

from hadr.hand import FINGERS
from hadr.models.blocks.crop_unet import CropUNet, layer
from hadr.models.blocks.efficientnet_lite import EfficientNetLite0, LiteConfig
from hadr.models.config import NetworkConfig
from hadr.models.hand.crop import HandCrop, hand_crop, keypoint_maps, relative_depth
from hadr.models.network_input import DepthOutput, HADRInput, float_color, masked_rays
from hadr.records.provenance import IF_CHANGED

GROUPS: tuple[tuple[int, ...], ...] = ((0,), *FINGERS.values())
"""Keypoints that share a map: the wrist, and each finger."""
UNITS = (0.03, 0.4, 0.4)
"""Units of the guessed plane: metres of depth, and metres of depth a metre across and down."""
DEPTH_M = 0.1
"""Unit of the network's depths, metres."""
LOG_SCALE, LOG_SCALES = -3.5, (-7.0, -1.0)
"""Where the logarithm of a candidate's scale starts (3 cm), and its range (1 mm to 37 cm)."""
NEAR_M = 0.2
"""Measured depth farther than this from the hand's is cut off in the depth picture."""


@dataclass(frozen=True)
class HADRPlusConfig(NetworkConfig):
    """What the network consists of.

    Args:
        crop: Side of the crop in pixels; divisible by 32.
        pixel_m: Metres that a crop pixel spans at the hand's depth.
        width: Channels at a quarter of the crop's resolution; twice and three times as many below.
        blocks: Residual blocks at each of the three resolutions.
        candidates: Surfaces that are placed along each ray; 1 predicts the depth directly.
        metric_crop: Crops have one size in metres; off, they have one size in pixels, that of a
            hand at 0.7 m.
        hand_depth: Depth relative to the hand's is seen.
        keypoint_maps: Keypoints with their relative depth are seen.
        color: Colour is seen.
        hand_vector: The keypoints are given as a vector, too.
        plane: Candidates are relative to a plane that is guessed from the whole crop.
        lite: An EfficientNet-Lite0 looks at the colour too, and its maps join the U-Net's.

    Raises:
        ValueError: The crop is not divisible.
    """

    crop: int = 64
    pixel_m: float = 0.0036
    width: int = 64
    blocks: int = 2
    candidates: int = 2
    metric_crop: bool = True
    hand_depth: bool = True
    keypoint_maps: bool = True
    color: bool = True
    hand_vector: bool = True
    plane: bool = True
    lite: LiteConfig | None = field(default=None, metadata=IF_CHANGED)

    def __post_init__(self) -> None:
        if self.crop < 32 or self.crop % 32:
            raise ValueError(f"crop must be a positive multiple of 32, got {self.crop}")


@dataclass(frozen=True)
class HADRPlusOutput(DepthOutput):
    """Restored depth, and what the loss needs; M candidates on each of R rays.

    Attributes:
        confidence: Probability that the depth is right to 2 cm as the network sees it, shape
            (B, H, W), 0..1; 0 where not restored.
        rays: Rows (frame, row, column) of the rays' pixels, shape (R, 3), long.
        candidate: z-depth of each candidate in metres, shape (R, M).
        logits: Score of each candidate, shape (R, M).
        log_scale: Logarithm of each candidate's expected absolute error in metres, shape (R, M).
        plane: z-depth of the plane guessed from the whole crop in metres, shape (R,); None
            without it.
    """

    confidence: Tensor
    rays: Tensor
    candidate: Tensor
    logits: Tensor
    log_scale: Tensor
    plane: Tensor | None = None

    @property
    def spread(self) -> Tensor:
        """Standard deviation of the predicted distribution of depth in metres, (B, H, W).

        That of a mixture of Laplace distributions, whose variances are 2 scale^2; 0 where nothing
        was restored.
        """
        share = self.logits.softmax(dim=1)
        mean = (share * self.candidate).sum(dim=1, keepdim=True)
        square = (self.candidate - mean) ** 2 + 2 * (2 * self.log_scale).exp()
        values = (share * square).sum(dim=1).sqrt()  # (rays,)
        image = torch.zeros_like(self.depth)
        return image.index_put(tuple(self.rays.unbind(dim=1)), values) * self.restored


class _Head(nn.Sequential):
    def __init__(self, channels: int, out: int) -> None:
        super().__init__(layer(channels, channels), nn.Conv2d(channels, out, 1))


def _share_within(width: float, offset: Tensor, scale: Tensor) -> Tensor:
    """Probability of a Laplace distribution, centred at `offset`, between -width and width."""
    return _laplace_below((width - offset) / scale) - _laplace_below((-width - offset) / scale)


def _laplace_below(value: Tensor) -> Tensor:
    """Cumulative distribution of the Laplace distribution of scale 1."""
    half = 0.5 * torch.exp(-value.abs())
    return torch.where(value < 0, half, 1 - half)


def plane_picture(plane: Tensor, pixel: Tensor, size: int) -> Tensor:
    """Depths (B, size, size) of planes (B, 3) in `UNITS`; a pixel spans `pixel` (B, 2) metres."""
    offset = torch.arange(size, device=plane.device, dtype=plane.dtype) - (size - 1) / 2
    across = (plane[:, 1] * pixel[:, 0])[:, None] * offset  # (B, size)
    down = (plane[:, 2] * pixel[:, 1])[:, None] * offset  # (B, size)
    return plane[:, 0, None, None] + down[:, :, None] + across[:, None, :]


class HADRPlus(nn.Module):
    """The whole network."""

    channels = 3 + 1 + 2 + 2 * len(GROUPS) + 2
    given = 21 * 3 + 2

    def __init__(self, config: HADRPlusConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or HADRPlusConfig()
        if config.lite:
            self.lite = EfficientNetLite0(config.lite)
        further = config.lite.channels if config.lite else ()
        self.unet = CropUNet(self.channels, config.width, config.blocks, self.given, 3, further)
        # Of each candidate: depth, score and scale at every fourth ray, and at each of the 16 rays
        # between them a step in depth and in score.
        count = config.candidates
        self.coarse = _Head(config.width, 3 * count)
        self.fine = _Head(config.width, 2 * 16 * count)
        start = torch.linspace(-0.3, 0.3, count) if count > 1 else torch.zeros(1)
        self.start: Tensor
        self.register_buffer("start", start)

    def forward(self, inputs: HADRInput) -> HADRPlusOutput:
        """Restore the depth of masked pixels.

        Raises:
            ValueError: A frame has no hand.
        """
        config, crop, count = self.config, self.crop(inputs), self.config.candidates
        seen, known = self.pictures(inputs, crop), self.keypoints(inputs, crop)
        maps = self.lite(seen[:, :3] + 0.5) if config.lite else []
        values, whole = self.unet(seen, known, maps)  # (B, width, S/4, S/4), (B, 3)
        coarse = functional.interpolate(
            self.coarse(values), scale_factor=4, mode="bilinear", align_corners=False
        ).float()  # (B, 3 M, S, S)
        fine = functional.pixel_shuffle(self.fine(values), 4).float()  # (B, 2 M, S, S)
        maps = coarse + torch.cat((fine, torch.zeros_like(coarse[:, :count])), dim=1)

        rays = masked_rays(inputs.mask)  # (rays, 3)
        relative, logits, scale = crop.look_up(maps, rays).chunk(3, dim=1)  # (rays, M) each
        base = crop.prior.index_select(0, rays[:, 0])  # (rays,)
        guessed = None
        if config.plane:
            lying = whole.float() * whole.new_tensor(UNITS, dtype=torch.float32)  # (B, 3)
            pixel_m = crop.step * crop.prior[:, None] / inputs.intrinsics[:, :2]  # (B, 2)
            picture = plane_picture(lying, pixel_m, crop.size)  # (B, S, S)
            guessed = base = base + crop.look_up(picture.unsqueeze(1), rays)[:, 0]  # (rays,)
        candidate = base[:, None] + DEPTH_M * (relative + self.start)  # (rays, M)
        log_scale = (scale + LOG_SCALE).clamp(*LOG_SCALES)  # (rays, M)

        chosen = logits.argmax(dim=1, keepdim=True)  # (rays, 1)
        depth = candidate.gather(1, chosen)  # (rays, 1)
        right = _share_within(0.02, candidate - depth, log_scale.exp())  # (rays, M)
        sure = (logits.softmax(dim=1) * right).sum(dim=1)  # (rays,)
        depth = depth[:, 0]
        in_front = (depth > 0).to(depth.dtype)
        where = rays.unbind(dim=1)
        blank = torch.zeros_like(inputs.depth)
        return HADRPlusOutput(
            depth=blank.index_put(where, depth * in_front),
            confidence=blank.index_put(where, sure * in_front),
            restored=blank.index_put(where, in_front) > 0,
            rays=rays,
            candidate=candidate,
            logits=logits,
            log_scale=log_scale,
            plane=guessed,
        )

    def crop(self, inputs: HADRInput) -> HandCrop:
        """Lay the crops: of one size in metres, or of that of a hand at 0.7 m."""
        crop = hand_crop(inputs, self.config.crop, self.config.pixel_m)
        if self.config.metric_crop:
            return crop
        step = self.config.pixel_m * inputs.intrinsics[:, :2] / 0.7
        return HandCrop(crop.center, step, crop.prior, crop.size)

    def keypoints(self, inputs: HADRInput, crop: HandCrop) -> Tensor:
        """Give the keypoints as a vector: (B, given).

        Metres across and down from the crop's centre at the hand's depth, and relative depth; and
        the direction of the crop's centre.
        """
        focal, middle = inputs.intrinsics[:, :2], inputs.intrinsics[:, 2:]
        away = (inputs.keypoints_uv - crop.center[:, None]) / focal[:, None]  # (B, 21, 2)
        height = inputs.keypoints[:, :, 2:] - crop.prior[:, None, None]  # (B, 21, 1)
        points = torch.cat((away * crop.prior[:, None, None], height), dim=2)  # (B, 21, 3)
        known = torch.cat(
            (points.flatten(1) / DEPTH_M, 3 * (crop.center - middle) / focal), dim=1
        )  # (B, 65)
        return known * self.config.hand_vector

    def pictures(self, inputs: HADRInput, crop: HandCrop) -> Tensor:
        """Make what the U-Net sees: (B, channels, S, S).

        Colour; mask; depth relative to the hand's, cut off at `NEAR_M`, and where it is within;
        of wrist and fingers a blob at each keypoint and its relative depth; direction of the ray.
        """
        config, size = self.config, crop.size
        color = float_color(inputs.color)  # (B, 3, H, W)
        mask = inputs.mask.unsqueeze(1).to(color.dtype)
        seen = crop.sample(torch.cat((color, mask), dim=1), "bilinear")  # (B, 4, S, S)
        measured = crop.sample((inputs.depth * ~inputs.mask).unsqueeze(1))  # (B, 1, S, S)
        depth = relative_depth(measured[:, 0], crop.prior, NEAR_M)  # (B, 2, S, S)
        frames = torch.arange(len(inputs), device=color.device).repeat_interleave(21)
        at = crop.place(inputs.keypoints_uv.flatten(0, 1), frames).view(-1, 21, 2)
        height = (inputs.keypoints[:, :, 2] - crop.prior[:, None]) / DEPTH_M  # (B, 21)
        hand = keypoint_maps(at, height, (size, size), 2.5, GROUPS)  # (B, 12, S, S)
        middle = (crop.center - inputs.intrinsics[:, 2:]) / inputs.intrinsics[:, :2]  # (B, 2)
        ray = middle[:, :, None, None].expand(-1, -1, size, size)
        return torch.cat(
            (
                (seen[:, :3] - 0.5) * config.color,
                seen[:, 3:],
                depth * config.hand_depth,
                hand * config.keypoint_maps,
                ray,
            ),
            dim=1,
        )
