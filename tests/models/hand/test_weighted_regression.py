"""Adaptive weighting regression on cases computed by hand."""

import pytest
import torch

from hadr.models.hand.weighted_regression import JointMaps, joints_of_maps, maps_of_joints


def points_at(*rows: tuple[float, float, float]) -> torch.Tensor:
    """One frame whose only row of pixels sees these points: (1, 3, 1, n)."""
    return torch.tensor(rows).T[None, :, None, :]


def test_maps_of_one_joint_by_hand() -> None:
    points = points_at((0.0, 0.0, 0.0), (0.3, 0.0, 0.4), (0.6, 0.0, 0.0), (0.0, 0.0, 0.1))
    valid = torch.tensor([[[True, True, True, False]]])
    maps = maps_of_joints(torch.zeros(1, 1, 3), points, valid, reach=0.55)
    torch.testing.assert_close(maps.heat[0, 0, 0], torch.tensor([1.0, 0.05 / 0.55, 0.0, 0.0]))
    wanted = torch.tensor([[0, 0, 0], [-0.6, 0, -0.8], [0, 0, 0], [0, 0, 0]])
    torch.testing.assert_close(maps.offset[0, 0, :, 0].T, wanted)


def test_joints_are_the_softmax_of_thirty_times_the_heat() -> None:
    points = points_at((0.0, 0.0, 0.0), (0.5, 0.0, 0.0))
    maps = JointMaps(
        offset=torch.zeros(1, 1, 3, 1, 2),
        heat=torch.tensor([[[[0.1, 0.0]]]]),
        weight=torch.zeros(1, 1, 1, 2),
    )
    joint = joints_of_maps(maps, points, torch.ones(1, 1, 2, dtype=torch.bool), 1.0)
    share = 1 / (1 + torch.e**3)  # of the second pixel
    torch.testing.assert_close(joint, torch.tensor([[[0.5 * share, 0.0, 0.0]]]))


def test_weight_is_added_to_the_logit_and_the_step_is_reach_times_one_minus_heat() -> None:
    points = points_at((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    maps = JointMaps(
        offset=torch.tensor([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]).T[None, None, :, None],
        heat=torch.tensor([[[[0.75, 0.75]]]]),
        weight=torch.tensor([[[[0.0, 1.0]]]]),
    )
    joint = joints_of_maps(maps, points, torch.ones(1, 1, 2, dtype=torch.bool), 0.8)
    second = torch.e / (1 + torch.e)
    wanted = torch.tensor([[[second, 0.2 * (1 - second), 0.2 * second]]])
    torch.testing.assert_close(joint, wanted)


def test_invalid_pixels_have_no_say_not_even_nan() -> None:
    points = points_at((0.1, 0.2, 0.3), (float("nan"), 9.0, 9.0))
    maps = JointMaps(
        torch.zeros(1, 1, 3, 1, 2), torch.full((1, 1, 1, 2), 1.0), torch.zeros(1, 1, 1, 2)
    )
    joint = joints_of_maps(maps, points, torch.tensor([[[True, False]]]), 1.0)
    torch.testing.assert_close(joint, torch.tensor([[[0.1, 0.2, 0.3]]]))


def test_a_crop_without_valid_pixel_is_named() -> None:
    maps = JointMaps(torch.zeros(2, 1, 3, 1, 2), torch.zeros(2, 1, 1, 2), torch.zeros(2, 1, 1, 2))
    valid = torch.tensor([[[True, False]], [[False, False]]])
    with pytest.raises(ValueError, match="crop 1 of the batch has no valid pixel"):
        joints_of_maps(maps, torch.zeros(2, 3, 1, 2), valid, 1.0)


def test_gradients_reach_offset_heat_and_weight() -> None:
    generator = torch.Generator().manual_seed(1)
    values = [torch.rand(s, generator=generator, requires_grad=True)
              for s in ((1, 2, 3, 4, 4), (1, 2, 4, 4), (1, 2, 4, 4))]  # fmt: skip
    points = torch.rand(1, 3, 4, 4, generator=generator)
    valid = torch.ones(1, 4, 4, dtype=torch.bool)
    valid[0, 0] = False
    joints_of_maps(JointMaps(*values), points, valid, 1.0).square().sum().backward()
    for value in values:
        assert value.grad is not None
        assert torch.isfinite(value.grad).all()
        assert (value.grad[..., 1:, :] != 0).all()
        assert (value.grad[..., 0, :] == 0).all()
