from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from hadr.models.hadr import HADROutput
from hadr.models.network_input import masked_rays, ray_points
from hadr.ray_voxels import VoxelGrid, occupied_voxels, ray_voxel_pairs, segment_softmax
from hadr.training.losses import (
    CODED,
    LIDF_WEIGHTS,
    PRINTED,
    LossTerms,
    LossWeights,
    depth_loss,
    hadr_losses,
    mean_of,
    normals,
    normals_loss,
    probability_loss,
)

GRID = VoxelGrid()


def test_weights_as_printed_and_as_coded() -> None:
    assert LossWeights(200.0, 10.0, 0.5, "xyz") == PRINTED
    assert LossWeights(200.0, 0.5, 10.0, "xyz") == CODED
    assert LossWeights(100.0, 0.5, 10.0, "xyz") == LIDF_WEIGHTS
    terms = LossTerms(*(torch.tensor(x) for x in (0.02, 0.3, 0.1, 0.0, 0.0)))
    assert terms.total(PRINTED).item() == pytest.approx(4.0 + 3.0 + 0.05)
    assert terms.total(CODED).item() == pytest.approx(4.0 + 0.15 + 1.0)


def test_depth_loss_over_xyz_and_over_z() -> None:
    points = torch.tensor([[0.1, 0.0, 0.5], [0.0, 0.2, 0.7]])
    truth = torch.tensor([[0.0, 0.0, 0.6], [0.0, 0.0, 0.4]])
    assert depth_loss(points, truth).item() == pytest.approx((0.1 + 0.1 + 0.2 + 0.3) / 6)
    assert depth_loss(points, truth, "z").item() == pytest.approx(0.2)
    assert depth_loss(points[:0], truth[:0]).item() == 0.0


def test_cross_entropy_of_three_rays() -> None:
    # Ray 0 says 0.25 for its true voxel, ray 1 says 0.5, ray 2's true voxel is no candidate.
    log_probability = torch.tensor([0.25, 0.75, 0.5, 0.5, 1.0]).log()
    loss = probability_loss(log_probability, torch.tensor([0, 3, -1]))
    assert loss.item() == pytest.approx((math.log(4) + math.log(2)) / 2)
    assert probability_loss(log_probability, torch.tensor([-1, -1])).item() == 0.0


def plane(slope: float) -> torch.Tensor:
    """An organised cloud of the plane z = slope * x, with the rows along y."""
    y, x = torch.meshgrid(torch.arange(4.0) * 0.01, torch.arange(5.0) * 0.01, indexing="ij")
    return torch.stack((x, y, slope * x), dim=-1)[None]


def test_normals_of_a_tilted_plane() -> None:
    found = normals(plane(1.0))
    assert found.shape == (1, 3, 4, 3)
    expected = torch.tensor([-1.0, 0.0, 1.0]) / math.sqrt(2)
    torch.testing.assert_close(found, expected.expand_as(found))


def test_normals_loss_is_half_of_one_minus_cosine_over_whole_triangles() -> None:
    everywhere = torch.ones(1, 4, 5, dtype=torch.bool)
    tilted = normals_loss(plane(1.0), plane(0.0), everywhere)
    assert tilted.item() == pytest.approx((1 - math.cos(math.pi / 4)) / 2, abs=1e-6)
    assert normals_loss(plane(0.3), plane(0.3), everywhere).item() == pytest.approx(0, abs=1e-6)
    # Spoil one point: the three triangles that use it must not count once it is invalid.
    spoiled = plane(0.3)
    spoiled[0, 1, 2] = 7.0
    assert normals_loss(spoiled, plane(0.3), everywhere) > 0.05
    holed = everywhere.clone()
    holed[0, 1, 2] = False
    assert normals_loss(spoiled, plane(0.3), holed).item() == pytest.approx(0, abs=1e-6)
    assert normals_loss(plane(1.0), plane(0.0), ~everywhere).item() == 0.0


INTRINSICS = torch.tensor([[100.0, 100.0, 1.5, 1.5]])
BLOCK = torch.tensor([[0, 1, 1], [0, 1, 2], [0, 2, 1], [0, 2, 2]])
"""Rays of a 2x2 block in the middle of a 4x4 image."""


def output_with(points: torch.Tensor, rays: torch.Tensor = BLOCK) -> HADROutput:
    """Of each ray the point and two voxels, at 0.5 m and 1 m, of which the first is chosen."""
    count, image = len(rays), torch.zeros(1, 4, 4)
    occupied = occupied_voxels(
        torch.tensor([[0.0, 0.0, 0.5], [0.0, 0.0, 1.0]]), torch.zeros(2, dtype=torch.long), GRID, 1
    )
    along = ray_points(rays, torch.ones(count), INTRINSICS)
    directions = torch.nn.functional.normalize(along, dim=1)
    pairs = ray_voxel_pairs(directions, rays[:, 0], occupied, GRID)
    assert pairs.ray.tolist() == [ray for ray in range(count) for _ in range(2)]
    probability = torch.tensor([0.8, 0.2] * count)
    return HADROutput(
        depth=image,
        restored=image > 0,
        clamped=image > 0,
        rays=rays,
        points=points,
        chosen=torch.arange(0, 2 * count, 2),
        pairs=pairs,
        occupied=occupied,
        logits=probability.log(),
        probability=probability,
        offset=torch.zeros(count),
    )


def true_points(z: float) -> torch.Tensor:
    half = 0.5 / 100 * z
    signs = torch.tensor([[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]])
    return torch.cat((signs * half, torch.full((4, 1), z)), dim=1)


def test_all_terms_of_a_perfect_answer_in_the_near_voxel() -> None:
    depth = torch.full((1, 4, 4), 0.5)
    terms = hadr_losses(output_with(true_points(0.5)), depth, INTRINSICS, GRID)
    assert terms.depth.item() == pytest.approx(0, abs=1e-7)
    assert terms.probability.item() == pytest.approx(-math.log(0.8))
    assert terms.normals.item() == pytest.approx(0, abs=1e-6)
    assert terms.voxel_accuracy.item() == 1.0
    assert terms.without_true_voxel.item() == 0.0


def test_all_terms_where_the_truth_lies_in_the_other_voxel() -> None:
    depth = torch.full((1, 4, 4), 1.0)
    depth[0, 2, 2] = 3.0  # in no candidate
    depth[0, 1, 1] = 0.0  # unknown: does not count at all
    output = output_with(true_points(0.5))
    terms = hadr_losses(output, depth, INTRINSICS, GRID, depth_over="z")
    assert terms.depth.item() == pytest.approx((0.5 + 0.5 + 2.5) / 3)
    assert terms.probability.item() == pytest.approx(-math.log(0.2))
    assert terms.voxel_accuracy.item() == 0.0
    assert terms.without_true_voxel.item() == pytest.approx(1 / 3)
    assert terms.normals.item() == 0.0  # no whole triangle is left


@pytest.mark.parametrize(("rows", "columns", "stride"), [(3, 5, 1), (5, 9, 2)])
def test_the_normals_of_an_answer_tilted_by_45_degrees(rows, columns, stride) -> None:
    depth = torch.full((1, rows, columns), 0.5)
    rays = masked_rays(depth > 0, stride)
    points = ray_points(rays, torch.full((len(rays),), 0.5), INTRINSICS)
    points[:, 2] += points[:, 0]
    output = output_with(points, rays)
    terms = hadr_losses(output, depth, INTRINSICS, GRID, ray_stride=stride)
    assert terms.normals.item() == pytest.approx((1 - math.cos(math.pi / 4)) / 2, abs=1e-5)


def test_the_worst_choice_has_the_gradient_of_a_log_softmax_over_each_ray() -> None:
    depth = torch.full((1, 4, 4), 1.0)  # the truth lies in each ray's second voxel
    values = [100.0, 0.0, 0.0, 100.0, -50.0, 50.0, 1.0, -99.0]
    logits = torch.tensor(values, requires_grad=True)
    output = replace(
        output_with(true_points(0.5)),
        logits=logits,
        probability=segment_softmax(logits, torch.arange(8) // 2, 4),
    )
    hadr_losses(output, depth, INTRINSICS, GRID).probability.backward()
    exact = torch.tensor(values, dtype=torch.float64, requires_grad=True)
    expected = -torch.stack([torch.log_softmax(ray, dim=0)[1] for ray in exact.split(2)]).mean()
    expected.backward()
    assert logits.grad is not None
    assert logits.grad[1].item() == -0.25  # one of four rays, certain of the wrong voxel
    torch.testing.assert_close(logits.grad.double(), exact.grad, rtol=1e-6, atol=1e-12)


def test_a_ray_without_candidate_counts_in_no_term() -> None:
    depth = torch.full((1, 4, 4), 0.5)
    output = output_with(true_points(0.5) * torch.tensor([[1.0], [1.0], [1.0], [0.0]]))
    lost = HADROutput(**{**vars(output), "chosen": torch.tensor([0, 2, 4, -1])})
    terms = hadr_losses(lost, depth, INTRINSICS, GRID)
    assert terms.depth.item() == pytest.approx(0, abs=1e-7)
    assert terms.normals.item() == pytest.approx(0, abs=1e-6)


def test_a_mean_of_nothing_is_zero_and_has_no_gradient() -> None:
    total = torch.tensor(6.0, requires_grad=True)
    mean = mean_of(total, torch.tensor(4))
    assert mean.item() == 1.5
    mean.backward()
    assert total.grad is not None
    assert total.grad.item() == 0.25
    empty = mean_of((total * 0).sum(), 0)
    empty.backward()
    assert (empty.item(), total.grad.item()) == (0.0, 0.25)
