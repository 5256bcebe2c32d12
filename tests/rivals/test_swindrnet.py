from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import nn

from hadr.models.backbone import IMAGENET_MEAN, IMAGENET_STD, BackboneConfig
from hadr.rivals.swindrnet import SwinDRNet, SwinDRNetConfig

SMALL = SwinDRNetConfig(
    backbone=BackboneConfig(
        embed_dim=8, depths=(1, 1, 1, 1), heads=(1, 2, 2, 2), normalize_color=False
    ),
    channels=8,
)


@pytest.fixture(scope="module")
def network() -> SwinDRNet:
    torch.manual_seed(0)
    return SwinDRNet(SMALL).eval()


def steady(config: SwinDRNetConfig = SMALL, depth: float | None = None) -> SwinDRNet:
    """A network with the same answer everywhere: three quarters for predicted depth."""
    network = SwinDRNet(config).eval()
    nn.init.zeros_(network.depth_head.last.weight)
    nn.init.zeros_(network.confidence_head.last.weight)
    network.confidence_head.last.bias.data = torch.tensor([1.0, 3.0]).log()  # odds 1 : 3
    if depth is not None:
        nn.init.constant_(network.depth_head.last.bias, depth)
    return network


def weights(module: nn.Module) -> int:
    return sum(values.numel() for values in module.parameters())


def test_it_has_the_published_number_of_weights() -> None:
    with torch.device("meta"):
        network = SwinDRNet()
    assert weights(network) == pytest.approx(160e6, rel=0.005)
    heads = weights(network.depth_head) + weights(network.confidence_head)
    assert heads == pytest.approx(85e6, rel=0.01)
    assert weights(network.color_swin) == weights(network.depth_swin) == 27_522_234


def test_measured_and_predicted_depth_are_mixed_and_missing_depth_has_no_share(noise_frames):
    inputs = noise_frames(36, 64)
    output = steady()(inputs)
    torch.testing.assert_close(output.initial, torch.full_like(inputs.depth, 0.5))
    there = inputs.depth > 0
    mixed = 0.25 * inputs.depth + 0.75 * 0.5
    torch.testing.assert_close(output.image, torch.where(there, mixed, 0.5))
    torch.testing.assert_close(output.share, torch.where(there, 0.75, 1.0))
    torch.testing.assert_close(output.depth, output.image * inputs.mask)
    assert torch.equal(output.restored, inputs.mask)


def test_the_published_mix_is_drawn_to_0_where_depth_is_missing(noise_frames) -> None:
    inputs = noise_frames(36, 64)
    output = steady(replace(SMALL, mix_missing=True, start_m=0.8))(inputs)
    torch.testing.assert_close(output.share, torch.full_like(inputs.depth, 0.75))
    torch.testing.assert_close(output.image, 0.25 * inputs.depth + 0.75 * 0.8)
    assert output.image[0, 10, 12].item() == pytest.approx(0.6)


def test_depth_behind_the_camera_is_not_restored(noise_frames) -> None:
    inputs = noise_frames(36, 64)
    output = steady(depth=-0.02)(inputs)
    expected = inputs.mask & (inputs.depth > 0)
    assert torch.equal(output.restored, expected)
    assert torch.equal(output.depth > 0, expected)
    assert output.depth.min() == 0


def test_it_looks_at_colour_and_depth_but_at_neither_mask_nor_hand(network, noise_frames):
    inputs = noise_frames(36, 64)
    initial = network(inputs).initial
    for other in (
        replace(inputs, color=inputs.color.flip(3)),
        replace(inputs, depth=inputs.depth + 0.2),
        replace(inputs, depth=torch.where(inputs.mask, 0, inputs.depth)),
    ):
        assert (network(other).initial - initial).abs().max() > 1e-6
    hand = replace(inputs, keypoints=inputs.keypoints + 0.5, keypoints_uv=inputs.keypoints_uv + 9)
    assert torch.equal(network(hand).initial, initial)
    whole = replace(inputs, mask=torch.ones_like(inputs.mask))
    assert torch.equal(network(whole).image, network(inputs).image)


def test_fresh_encoders_tell_a_near_plane_from_a_far_one(network: SwinDRNet) -> None:
    near, far = (torch.full((1, 3, 36, 64), depth) for depth in (0.5, 0.8))
    first = [network.depth_swin(plane).feature_maps[0] for plane in (near, far)]
    assert (first[1] - first[0]).abs().mean() > 0.02


def test_colour_is_normalised_where_asked(noise_frames) -> None:
    torch.manual_seed(0)
    plain = SwinDRNet(SMALL).eval()
    encoder = replace(SMALL.backbone, normalize_color=True)
    normal = SwinDRNet(replace(SMALL, backbone=encoder)).eval()
    normal.load_state_dict(plain.state_dict())
    inputs = noise_frames(36, 64)
    mean, std = (torch.tensor(v)[:, None, None] for v in (IMAGENET_MEAN, IMAGENET_STD))
    shifted = replace(inputs, color=(inputs.color - mean) / std)
    torch.testing.assert_close(normal(inputs).initial, plain(shifted).initial)


def test_it_learns_from_a_batch_of_one_and_no_weight_is_idle(noise_frames) -> None:
    torch.manual_seed(0)
    network = SwinDRNet(replace(SMALL, dropout=0.0)).train()
    output = network(noise_frames(72, 128, count=1))
    (output.image * torch.randn_like(output.image)).sum().backward()
    idle = [name for name, weight in network.named_parameters() if weight.grad is None]
    assert all(".swin.layernorm." in name for name in idle)  # the backbone has its own instead
