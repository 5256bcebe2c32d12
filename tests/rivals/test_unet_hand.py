from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor, nn

from hadr.rivals.unet_hand import UNetHand, UNetHandConfig

SMALL = UNetHandConfig(width=8, levels=3)


@pytest.fixture(scope="module")
def network() -> UNetHand:
    torch.manual_seed(0)
    return UNetHand(SMALL).eval()


def test_it_has_the_trials_number_of_weights() -> None:
    count = sum(values.numel() for values in UNetHand().parameters())
    assert count == pytest.approx(2.8e6, rel=0.02)


def test_without_an_answer_of_its_own_it_gives_the_hands_depth_in_the_mask(noise_frames) -> None:
    network = UNetHand(SMALL).eval()
    torch.nn.init.zeros_(network.head.weight)
    torch.nn.init.zeros_(network.head.bias)
    inputs = noise_frames(hand=True)
    output = network(inputs)
    hand = inputs.keypoints[:, :, 2].median(dim=1).values
    torch.testing.assert_close(output.depth, hand[:, None, None] * inputs.mask)
    assert torch.equal(output.restored, inputs.mask)


class _Coarser(nn.Module):
    """Hands the first channel of the coarser level on, and nothing of the finer one."""

    def forward(self, both: Tensor) -> Tensor:
        return both[:, :1]


@pytest.mark.parametrize("height", [72, 90])
def test_a_spot_stays_in_its_place_where_levels_have_an_odd_height(height, noise_frames):
    network = UNetHand(replace(SMALL, levels=4)).eval()
    for level in range(4):
        network.down[level] = nn.Identity()
    network.up = nn.ModuleList(_Coarser() for _ in range(3))
    network.head = nn.Conv2d(1, 4, 1, bias=False)
    nn.init.ones_(network.head.weight)
    inputs = replace(noise_frames(height, 64, hand=True), color=torch.zeros(2, 3, height, 64))
    for row in (24, height // 2, height - 22):
        inputs.color[:] = 0
        inputs.color[:, 0, row & ~1, 32] = 1
        everywhere = replace(inputs, mask=torch.ones_like(inputs.mask))
        answer = network(everywhere).depth[0, :, 32]
        peak = (answer > answer.max() - 1e-6).nonzero().double().mean().item()
        assert peak == pytest.approx((row // 16 + 0.5) * 16 - 0.5, abs=1), row


def test_it_does_not_look_at_depth_behind_the_mask(network: UNetHand, noise_frames) -> None:
    inputs = noise_frames(hand=True)
    inside = torch.where(inputs.mask, 0.9, inputs.depth)
    assert torch.equal(network(inputs).depth, network(replace(inputs, depth=inside)).depth)
    outside = torch.where(inputs.mask, inputs.depth, 0.6)
    assert not torch.equal(network(inputs).depth, network(replace(inputs, depth=outside)).depth)


def test_everything_farther_off_is_restored_farther_off(network: UNetHand, noise_frames) -> None:
    inputs = noise_frames(hand=True)
    away = torch.tensor([0, 0, 0.25])
    moved = replace(inputs, depth=inputs.depth + 0.25, keypoints=inputs.keypoints + away)
    torch.testing.assert_close(
        network(moved).depth, network(inputs).depth + 0.25 * inputs.mask, atol=2e-5, rtol=0
    )


def test_depth_before_the_camera_only_is_restored(noise_frames) -> None:
    network = UNetHand(SMALL).eval()
    torch.nn.init.zeros_(network.head.weight)
    torch.nn.init.constant_(network.head.bias, -6.0)  # 0.6 m nearer than the hand
    output = network(noise_frames(hand=True))
    assert output.restored.flatten(1).sum(dim=1).tolist() == [0, 80]
    assert output.depth[0].abs().max() == 0
    assert output.depth[1].max().item() > 0


def test_a_frame_without_a_hand_and_an_odd_size_are_told(network: UNetHand, noise_frames) -> None:
    inputs = noise_frames(hand=True)
    with pytest.raises(ValueError, match="frame 0 of the batch has no hand"):
        network(replace(inputs, keypoints=torch.zeros(2, 21, 3)))
    with pytest.raises(ValueError, match="must be even, got 17 x 32"):
        network(noise_frames(height=17, hand=True))
