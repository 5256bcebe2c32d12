from __future__ import annotations

import math

import pytest
import torch

from hadr.models.hadr_input import HADRInput
from hadr.models.hand.prior import hand_depth, keypoint_maps, relative_depth


def given(depths: list[list[float]]) -> HADRInput:
    """Frames of 4x6 pixels whose keypoints have these z-depths."""
    count = len(depths)
    keypoints = torch.zeros(count, 21, 3)
    keypoints[..., 2] = torch.tensor(depths)
    return HADRInput(
        color=torch.zeros(count, 3, 4, 6),
        depth=torch.zeros(count, 4, 6),
        mask=torch.zeros(count, 4, 6, dtype=torch.bool),
        intrinsics=torch.ones(count, 4),
        keypoints=keypoints,
        keypoints_uv=torch.zeros(count, 21, 2),
    )


def test_the_hands_depth_is_the_middle_keypoints() -> None:
    # ten at 0.5, the middle one at 0.62, ten at 9: the mean would be 4.6
    assert hand_depth(given([[0.5] * 10 + [0.62] + [9.0] * 10])).tolist() == pytest.approx([0.62])


@pytest.mark.parametrize("absent", [0.0, -0.3, math.nan])
def test_a_frame_without_a_hand_is_named(absent: float) -> None:
    inputs = given([[0.5] * 21, [absent] * 21])
    with pytest.raises(ValueError, match=r"frame 1 of the batch has no hand.* is (0|-0\.3|nan) m"):
        hand_depth(inputs)


def test_relative_depth_is_in_units_of_its_reach_and_missing_depth_is_no_depth() -> None:
    depth = torch.tensor([[[0.7, 0.65, 2.0, 0.0]]])
    pictures = relative_depth(depth, torch.tensor([0.6]), reach=0.2)
    assert pictures[0, 0, 0].tolist() == pytest.approx([0.5, 0.25, 1.0, 0.0], abs=1e-6)
    assert pictures[0, 1, 0].tolist() == [1, 1, 0, 0]


def test_a_keypoint_is_a_gaussian_of_its_group_and_its_height_beside_it() -> None:
    uv = torch.full((1, 21, 2), -100.0)  # all but two are far outside
    uv[0, 0] = torch.tensor([2.0, 1.0])
    uv[0, 5] = torch.tensor([7.0, 3.0])
    height = torch.zeros(1, 21)
    height[0, 0], height[0, 5] = -0.5, 2.0
    groups = ((0,), tuple(range(1, 21)))
    maps = keypoint_maps(uv, height, (6, 9), radius=1.5, groups=groups)
    assert maps.shape == (1, 4, 6, 9)
    assert maps[0, 0, 1, 2].item() == pytest.approx(1)
    assert maps[0, 0, 3, 2].item() == pytest.approx(math.exp(-4 / 4.5), abs=1e-6)
    assert maps[0, 0, 1, 4].item() == pytest.approx(math.exp(-4 / 4.5), abs=1e-6)
    assert maps[0, 1, 3, 7].item() == pytest.approx(1)
    assert maps[0, 1, 1, 2].item() == pytest.approx(math.exp(-29 / 4.5), abs=1e-6)
    torch.testing.assert_close(maps[0, 2], -0.5 * maps[0, 0])
    torch.testing.assert_close(maps[0, 3], 2.0 * maps[0, 1])
