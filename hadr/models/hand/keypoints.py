"""The hand-keypoint network: from the corrupted depth around the hand to its 21 keypoints.

A U-Net with a ResNet-18 encoder looks at the depth in a cube around the hand and gives dense maps;
adaptive weighting regression (`hadr.models.hand.weighted_regression`) turns them into keypoints.
Where the cube lies follows from the hand's mask alone (`hadr.models.hand.cube.hand_center`): no
truth is needed. What is not hand is blanked first, so the network sees neither the background nor
what a camera measures through the glass.

Source: paper, "Hand feature", and reference section 2; Huang et al. 2020, "AWR".
"""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch import Tensor, nn

from hadr.models.blocks.resnet import ResNetUNet, UNetConfig
from hadr.models.config import NetworkConfig
from hadr.models.hand.cube import HandCube, hand_center
from hadr.models.hand.weighted_regression import JointMaps, joints_of_maps
from hadr.models.network_input import HADRInput

KEYPOINTS = 21
MAP_STRIDE = 2
"""Pixels of the crop from one feature of the maps to the next."""


@dataclass(frozen=True)
class HandKeypointConfig(NetworkConfig):
    """The keypoint network; the defaults are ResNet-18's on crops of 128 pixels.

    Args:
        unet: Size of the U-Net, and the name of its encoder's published weights if any.
        crop: Side of the crop in pixels.
        cube_m: Side of the cube in metres.
        reach: The regression's k: from this distance on a pixel's heat is 0; 1 is half of the
            cube's side.
    """

    unet: UNetConfig = field(default_factory=UNetConfig)
    crop: int = 128
    cube_m: float = 0.3
    reach: float = 1.0


class HandKeypointNet(nn.Module):
    """From a depth crop to the dense maps of 21 joints."""

    def __init__(self, config: HandKeypointConfig) -> None:
        super().__init__()
        self.config = config
        self.unet = ResNetUNet(config.unet, 1)
        self.head = nn.Conv2d(config.unet.decoder[-1], KEYPOINTS * 5, 1)

    def forward(self, crop: Tensor) -> JointMaps:
        """Compute the maps, of half of the crop's size rounded up, of crops (B, 1, S, S).

        A crop is depth in the cube, -1..1, 1 = nothing.
        """
        values = self.head(self.unet(crop))  # (B, 105, h, w)
        batch, _, height, width = values.shape
        maps = values.view(batch, KEYPOINTS, 5, height, width)
        return JointMaps(offset=maps[:, :, :3], heat=maps[:, :, 3], weight=maps[:, :, 4])


def hand_cube(config: HandKeypointConfig, inputs: HADRInput, hand: Tensor) -> HandCube:
    """Lay the cube around each frame's hand, by its mask (B, H, W) and the object's."""
    center = hand_center(inputs.depth, hand, inputs.mask, inputs.intrinsics)
    return HandCube(center, inputs.intrinsics, config.cube_m, config.crop)


def keypoints_where_seen(model: HandKeypointNet, inputs: HADRInput, hand: Tensor) -> Tensor:
    """Find keypoints as `predict_keypoints` in those frames that show enough of a hand.

    Zeros, which mean "unknown", where no depth was measured on a hand, or so little that none of it
    is left in the crop.
    """
    found = inputs.depth.new_zeros(len(inputs), 21, 3)
    there = (hand & (inputs.depth > 0)).flatten(1).any(dim=1).nonzero().squeeze(1)
    if len(there):
        *_, valid = _crop(model.config, inputs.take(there), hand[there])
        there = there[valid.flatten(1).any(dim=1)]
    if len(there):
        found[there] = predict_keypoints(model, inputs.take(there), hand[there])
    return found


def predict_keypoints(model: HandKeypointNet, inputs: HADRInput, hand: Tensor) -> Tensor:
    """Find the hands' keypoints in whole frames: metres, camera frame, (B, 21, 3).

    Depth, intrinsics and the object's mask are looked at, and the pixels of hand and arm, (B, H, W)
    bool, true or predicted, or a detector's box. ValueError for a frame that shows no hand.
    """
    cube, crop, points, valid = _crop(model.config, inputs, hand)
    with torch.no_grad():
        joints = joints_of_maps(model(crop), points, valid, model.config.reach)  # (B, 21, 3)
    return cube.out_of(joints)


def _crop(
    config: HandKeypointConfig, inputs: HADRInput, hand: Tensor
) -> tuple[HandCube, Tensor, Tensor, Tensor]:
    """The cubes, what is seen in them, (B, 1, S, S), and its points, (B, 3, h, w), and where."""
    cube = hand_cube(config, inputs, hand)
    crop = cube.crop(torch.where(hand, inputs.depth, torch.zeros_like(inputs.depth)))
    return cube, crop, *cube.points(crop, MAP_STRIDE)
