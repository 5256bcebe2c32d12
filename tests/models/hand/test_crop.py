import math

import pytest
import torch

from hadr.models.hand.crop import hand_crop, hand_depth, keypoint_maps, relative_depth
from hadr.models.network_input import HADRInput


def frames(depth_m=(0.5, 1.0), size=(144, 256)):
    """Frames whose hand is at these depths; the mask is a box of 20x10 pixels."""
    count, (height, width) = len(depth_m), size
    mask = torch.zeros(count, height, width, dtype=torch.bool)
    mask[:, 40:60, 100:110] = True
    keypoints = torch.zeros(count, 21, 3)
    keypoints[:, :, 2] = torch.tensor(depth_m)[:, None]
    keypoints[:, 0, 2] += 0.3  # one far point does not move the median
    return HADRInput(
        color=torch.zeros(count, 3, height, width),
        depth=torch.ones(count, height, width),
        mask=mask,
        intrinsics=torch.tensor([[200.0, 100.0, 127.5, 71.5]]).repeat(count, 1),
        keypoints=keypoints,
        keypoints_uv=torch.full((count, 21, 2), 50.0),
    )


def test_a_pixel_spans_so_many_metres_at_the_hand():
    crop = hand_crop(frames(), 32, 0.01)
    assert crop.prior.tolist() == pytest.approx([0.5, 1.0])
    # 0.01 m at 0.5 m are 200 * 0.01 / 0.5 = 4 columns and 2 rows; at 1 m half of that.
    assert crop.step.flatten().tolist() == pytest.approx([4.0, 2.0, 2.0, 1.0])
    assert crop.center.tolist() == [[104.5, 49.5], [104.5, 49.5]]


def test_images_are_cut_where_the_crop_says():
    inputs = frames()
    crop = hand_crop(inputs, 33, 0.005)
    rows, columns = torch.meshgrid(torch.arange(144.0), torch.arange(256.0), indexing="ij")
    cut = crop.sample(torch.stack((columns, rows)).expand(2, 2, 144, 256), "bilinear")
    middle = 16
    assert cut[0, :, middle, middle].tolist() == pytest.approx([104.5, 49.5])
    assert cut[0, :, middle, middle + 3].tolist() == pytest.approx([104.5 + 3 * 2.0, 49.5])
    assert cut[1, :, middle - 5, middle].tolist() == pytest.approx([104.5, 49.5 - 5 * 0.5])


def test_looking_up_is_the_inverse_of_cutting():
    crop = hand_crop(frames(), 64, 0.005)
    ramp = torch.arange(64.0)
    maps = torch.stack((ramp.expand(64, 64), ramp[:, None].expand(64, 64))).expand(2, 2, 64, 64)
    rays = torch.tensor([[0, 49, 104], [0, 52, 120], [1, 40, 101]])
    found = crop.look_up(maps, rays)
    # crop pixel = (pixel - centre) / step + 31.5
    assert found[0].tolist() == pytest.approx([31.5 - 0.5 / 2, 31.5 - 0.5 / 1])
    assert found[1].tolist() == pytest.approx([31.5 + 15.5 / 2, 31.5 + 2.5 / 1])
    assert found[2].tolist() == pytest.approx([31.5 - 3.5 / 1, 31.5 - 9.5 / 0.5])
    placed = crop.place(rays[:, [2, 1]].float(), rays[:, 0])
    assert torch.allclose(found, placed)


def test_rays_outside_of_the_crop_take_its_border():
    crop = hand_crop(frames((0.5,)), 32, 0.001)
    maps = torch.arange(32.0).expand(1, 1, 32, 32)
    rays = torch.tensor([[0, 49, 0], [0, 49, 255]])
    assert crop.look_up(maps, rays).flatten().tolist() == pytest.approx([0.0, 31.0])


def test_a_crop_is_spread_over_the_pixels_of_its_frame():
    crop = hand_crop(frames(), 32, 0.001)
    ramp = torch.arange(32.0)
    maps = torch.stack((ramp.expand(32, 32), ramp[:, None].expand(32, 32))).expand(2, 2, 32, 32)
    found, within = crop.spread(maps, (144, 256))
    frame, row, column = torch.meshgrid(*map(torch.arange, (2, 144, 256)), indexing="ij")
    rays = torch.stack((frame, row, column), dim=-1).reshape(-1, 3)
    assert torch.allclose(
        found.permute(0, 2, 3, 1).reshape(-1, 2), crop.look_up(maps, rays), atol=1e-4
    )
    # steps of 0.4 columns and 0.2 rows at 0.5 m, half as much at 1 m, around (104.5, 49.5)
    assert within.sum(dim=(1, 2)).tolist() == [12 * 6, 6 * 4]


def test_an_empty_mask_centres_the_crop():
    inputs = frames((0.5,))
    inputs.mask[:] = False
    assert hand_crop(inputs, 32, 0.01).center.tolist() == [[127.5, 71.5]]


def given(depths: list[list[float]]) -> HADRInput:
    """Frames of 4x6 pixels whose keypoints have these z-depths."""
    inputs = frames([0.0] * len(depths), (4, 6))
    inputs.keypoints[..., 2] = torch.tensor(depths)
    return inputs


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
