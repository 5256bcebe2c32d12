"""The walk through the grid finds the pairs that trying all of them finds."""

import pytest
import torch
from torch.nn import functional

from hadr.dense_pairing import dense_ray_voxel_pairs
from hadr.ray_voxels import VoxelGrid, occupied_voxels, ray_voxel_pairs


@pytest.mark.parametrize("cells", [2, 8, 15])
@pytest.mark.parametrize("frames", [1, 3])
def test_both_formulations_give_the_same_pairs(cells: int, frames: int) -> None:
    generator = torch.Generator().manual_seed(10 * cells + frames)
    grid = VoxelGrid(cells=cells)
    points = torch.rand(300, 3, generator=generator, dtype=torch.float64) * 2 - torch.tensor(
        [1, 1, 0]
    )
    occupied = occupied_voxels(points, torch.arange(300) * frames // 300, grid, frames)
    rays = torch.randn(400, 3, generator=generator, dtype=torch.float64)
    rays = functional.normalize(rays + torch.tensor([0.0, 0.0, 1.5]), dim=1)
    frame = torch.arange(400) * frames // 400
    fast = ray_voxel_pairs(rays, frame, occupied, grid)
    dense = dense_ray_voxel_pairs(rays, frame, occupied, grid)
    assert len(dense) > 150
    assert torch.equal(fast.ray, dense.ray)
    assert torch.equal(fast.voxel, dense.voxel)
    assert torch.allclose(fast.t_in, dense.t_in, rtol=0, atol=1e-12)
    assert torch.allclose(fast.t_out, dense.t_out, rtol=0, atol=1e-12)
    assert fast.n_rays == dense.n_rays == 400


def test_rays_along_the_axes() -> None:
    grid = VoxelGrid()
    points = torch.tensor([[0.0, 0.0, 0.5], [0.0, 0.0, 1.0], [0.5, 0.0, 0.0], [0.5, 0.5, 0.5]])
    occupied = occupied_voxels(points, torch.zeros(4, dtype=torch.long), grid, 1)
    rays = torch.tensor([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    frame = torch.zeros(3, dtype=torch.long)
    dense = dense_ray_voxel_pairs(rays, frame, occupied, grid)
    fast = ray_voxel_pairs(rays, frame, occupied, grid)
    # Voxels of 0.25 m around multiples of 0.25 m; sorted by x, y, z.
    assert dense.ray.tolist() == [0, 0, 1]
    assert dense.voxel.tolist() == [0, 1, 2]
    assert dense.t_in.tolist() == [0.375, 0.875, 0.375]
    assert dense.t_out.tolist() == [0.625, 1.125, 0.625]
    assert torch.equal(dense.voxel, fast.voxel)
    assert torch.equal(dense.t_in, fast.t_in)
