"""Voxel encoder: invariance, pooling and hand-set weights."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor, nn

from hadr.models.voxel_features import VoxelFeatures


def cloud(
    n_points: int = 200, n_voxels: int = 7, channels: int = 32, seed: int = 0
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    generator = torch.Generator().manual_seed(seed)
    centers = torch.randn(n_voxels, 3, generator=generator)
    voxel = torch.randint(0, n_voxels, (n_points,), generator=generator)
    voxel[:n_voxels] = torch.arange(n_voxels)
    points = centers[voxel] + (torch.rand(n_points, 3, generator=generator) - 0.5) * 0.25
    color = torch.randn(n_points, channels, generator=generator)
    return points, color, voxel, centers


def encoder(point_fusion: bool = True) -> VoxelFeatures:
    torch.manual_seed(1)
    return VoxelFeatures(point_fusion=point_fusion).eval()


@pytest.mark.parametrize(("point_fusion", "channels"), [(True, 32), (False, 3)])
def test_shape_and_permutation_invariance(point_fusion: bool, channels: int) -> None:
    points, color, voxel, centers = cloud(channels=channels)
    model = encoder(point_fusion)
    expected = model(points, color, voxel, centers)
    assert expected.shape == (7, 128)
    order = torch.randperm(200, generator=torch.Generator().manual_seed(5))
    got = model(points[order], color[order], voxel[order], centers)
    torch.testing.assert_close(got, expected)


def test_points_outside_of_the_voxels_are_left_out() -> None:
    points, color, voxel, centers = cloud()
    model = encoder()
    expected = model(points[20:], color[20:], voxel[20:], centers)
    marked = voxel.clone()
    marked[:20] = -1
    lost = points.clone()
    lost[:20] = float("nan")
    torch.testing.assert_close(model(lost, color, marked, centers), expected)


def test_max_pooling_by_hand() -> None:
    # All layers but the first copy their first input to their first output, and the first passes
    # x relative to the centre, so that the result is the largest positive x in the voxel.
    model = encoder()
    with torch.no_grad():
        for layer in model.modules():
            if isinstance(layer, nn.Linear):
                layer.weight.zero_()
                layer.weight[0, 0] = 1
                if layer.bias is not None:
                    layer.bias.zero_()
        model.mix_voxel.weight.zero_()
    points = torch.tensor(
        [[1.02, 5.0, 0.0], [1.07, 0.0, 0.0], [0.93, 9.0, 9.0], [2.0, 0.0, 0.0], [1.9, 0.0, 0.0]]
    )
    centers = torch.tensor([[1.0, 0.0, 0.0], [2.1, 0.0, 0.0], [1.88, 0.0, 0.0]])
    voxel = torch.tensor([0, 0, 0, 1, 2])
    got = model(points, torch.zeros(5, 32), voxel, centers)
    # relative x: 0.02, 0.07, -0.07 | -0.1 (cut to 0 by ReLU) | 0.02
    assert got[:, 0].tolist() == pytest.approx([0.07, 0.0, 0.02], abs=1e-6)
    assert (got[:, 1:] == 0).all()

    # Now only the way through the voxel's vector is open: each point gets the voxel's maximum.
    with torch.no_grad():
        model.mix_point.weight.zero_()
        model.mix_voxel.weight[0, 0] = 10
    got = model(points, torch.zeros(5, 32), voxel, centers)
    assert got[:, 0].tolist() == pytest.approx([0.7, 0.0, 0.2], abs=1e-5)


def test_widths_are_the_papers() -> None:
    shapes = {name: tuple(p.shape) for name, p in encoder().named_parameters() if p.dim() == 2}
    assert shapes == {
        "embed_position.weight": (16, 3),
        "embed_color.weight": (16, 32),
        "lift.weight": (64, 32),
        "first_voxel.weight": (64, 64),
        "mix_point.weight": (128, 64),
        "mix_voxel.weight": (128, 64),
        "mix.weight": (128, 128),
        "last_voxel.weight": (128, 128),
    }


def test_no_points_and_no_voxels() -> None:
    model = encoder()
    none = torch.zeros(0, dtype=torch.long)
    assert model(torch.zeros(0, 3), torch.zeros(0, 32), none, torch.zeros(0, 3)).shape == (0, 128)
    outside = torch.full((4,), -1)
    only_outside = model(torch.zeros(4, 3), torch.zeros(4, 32), outside, torch.zeros(0, 3))
    assert only_outside.shape == (0, 128)


def test_colour_learns() -> None:
    points, color, voxel, centers = cloud()
    color.requires_grad_()
    encoder()(points, color, voxel, centers).square().sum().backward()
    assert color.grad is not None
    assert color.grad.abs().sum() > 0
