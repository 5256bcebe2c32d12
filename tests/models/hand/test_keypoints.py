"""The keypoint network around its maps: crops, truth in and out, mirrored hands, errors."""

import torch
from torch import nn

from hadr.models.blocks.resnet import UNetConfig
from hadr.models.hand.keypoints import (
    HandKeypointConfig,
    HandKeypointNet,
    hand_cube,
    predict_keypoints,
)
from hadr.models.hand.weighted_regression import JointMaps, maps_of_joints
from hadr.models.network_input import HADRInput

SMALL = HandKeypointConfig(
    UNetConfig((1, 1, 1, 1), widths=(4, 4, 8, 8), decoder=(8, 8, 8, 8)), crop=48
)


def frames(count: int = 2) -> tuple[HADRInput, torch.Tensor]:
    """A bumpy hand beside a held object before a wall, with keypoints around its middle."""
    generator = torch.Generator().manual_seed(3)
    hand = torch.zeros(count, 90, 160, dtype=torch.bool)
    held = torch.zeros_like(hand)
    hand[:, 20:70, 70:110] = True
    held[:, 20:70, 60:70] = True
    depth = torch.full((count, 90, 160), 0.9)
    depth[hand] = 0.6 + 0.05 * torch.rand(int(hand.sum()), generator=generator)
    depth[held] = 0
    keypoints = 0.12 * (torch.rand(count, 21, 3, generator=generator) - 0.5)
    keypoints += torch.tensor([0.03, 0.0, 0.63])
    inputs = HADRInput(
        color=torch.zeros(count, 3, 90, 160),
        depth=depth,
        mask=held,
        intrinsics=torch.tensor([[140.0, 150.0, 79.5, 44.5]]).repeat(count, 1),
        keypoints=torch.zeros(count, 21, 3),
        keypoints_uv=torch.zeros(count, 21, 2),
    )
    return inputs, keypoints


def hand_of(inputs: HADRInput) -> torch.Tensor:
    return (inputs.depth > 0.1) & (inputs.depth < 0.7)


class Oracle(nn.Module):
    """Knows the joints of the frames and gives their perfect maps."""

    config = SMALL

    def __init__(self, inputs: HADRInput, keypoints: torch.Tensor) -> None:
        super().__init__()
        self.inputs, self.keypoints = inputs, keypoints

    def forward(self, crop: torch.Tensor) -> JointMaps:
        cube = hand_cube(SMALL, self.inputs, hand_of(self.inputs))
        points, valid = cube.points(crop, 2)
        return maps_of_joints(cube.into(self.keypoints), points, valid, SMALL.reach)


def test_perfect_maps_give_the_keypoints_back_in_metres() -> None:
    inputs, keypoints = frames()
    found = predict_keypoints(Oracle(inputs, keypoints), inputs, hand_of(inputs))
    torch.testing.assert_close(found, keypoints, atol=1e-5, rtol=0)


def test_what_is_not_hand_has_no_say() -> None:
    torch.manual_seed(0)
    inputs, _ = frames()
    model = HandKeypointNet(SMALL).eval()
    hand = hand_of(inputs)
    before = predict_keypoints(model, inputs, hand)
    inputs.depth[~hand & ~inputs.mask] = 0.66
    torch.testing.assert_close(predict_keypoints(model, inputs, hand), before)
    inputs.depth[:, 40:50, 80:100] += 0.04
    assert (predict_keypoints(model, inputs, hand) - before).abs().max() > 1e-4


def test_every_weight_gets_a_gradient() -> None:
    torch.manual_seed(0)
    model = HandKeypointNet(SMALL)
    maps = model(torch.rand(2, 1, 48, 48) * 2 - 1)
    assert maps.offset.shape == (2, 21, 3, 24, 24)
    assert maps.heat.shape == maps.weight.shape == (2, 21, 24, 24)
    (maps.offset.sum() + maps.heat.square().sum() + maps.weight.square().sum()).backward()
    for name, weight in model.named_parameters():
        assert weight.grad is not None, name
        assert torch.isfinite(weight.grad).all(), name
    assert model.head.weight.grad.view(21, 5, -1).abs().sum(dim=2).min() > 0
