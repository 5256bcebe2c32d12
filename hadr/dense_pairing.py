"""Ray-voxel pairs by their definition: every ray against every voxel, by the slab test.

What `hadr.ray_voxels.ray_voxel_pairs` must give, written plainly; its tests and the benchmark
compare with it. Time and memory grow with the product of rays and voxels.
"""

from __future__ import annotations

import torch
from torch import Tensor

from hadr.ray_voxels import SHORTEST_PAIR_M, OccupiedVoxels, RayVoxelPairs, VoxelGrid


def dense_ray_voxel_pairs(
    directions: Tensor, ray_frame: Tensor, occupied: OccupiedVoxels, grid: VoxelGrid
) -> RayVoxelPairs:
    """Pair each ray with the occupied voxels of its frame that it crosses, by trying them all.

    Args:
        directions: Unit directions of rays from the camera's centre, camera frame, shape (R, 3).
        ray_frame: Index of each ray's frame, shape (R,), long.
        occupied: The occupied voxels of all frames, V of them.
        grid: The grid with which `occupied` was made.

    Returns:
        The pairs as `hadr.ray_voxels.ray_voxel_pairs` gives them: by ray, then from near to far.
    """
    n_rays, n_voxels = len(directions), len(occupied)
    t_in = directions.new_zeros(n_rays, n_voxels)
    t_out = directions.new_full((n_rays, n_voxels), torch.inf)
    half = grid.voxel_size / 2
    for axis in range(3):
        along = directions[:, axis : axis + 1]  # (R, 1)
        center = occupied.center[:, axis]  # (V,)
        first, second = (center - half) / along, (center + half) / along  # (R, V)
        beside = (center.abs() > half).expand_as(first)  # of a ray parallel to the slab
        near = torch.where(along == 0, torch.where(beside, torch.inf, 0), first.minimum(second))
        far = torch.where(along == 0, torch.inf, first.maximum(second))
        t_in, t_out = t_in.maximum(near), t_out.minimum(far)
    same_frame = ray_frame[:, None] == occupied.frame
    ray, voxel = (same_frame & (t_out - t_in > SHORTEST_PAIR_M)).nonzero(as_tuple=True)
    t_in, t_out = t_in[ray, voxel], t_out[ray, voxel]
    order = torch.argsort(t_in, stable=True)
    order = order[torch.argsort(ray[order], stable=True)]
    return RayVoxelPairs(ray[order], voxel[order], t_in[order], t_out[order], n_rays)
