"""Time and memory of ray-voxel pairing against trying every ray with every voxel.

    python benchmarks/speed/pairing.py [--json results/speed/pairing.json]

For 1, 8 and 32 frames: the rays and the voxels are those of the committed sample frames at
224x224, repeated.
"""

from __future__ import annotations

from typing import Any

import torch
from measuring import arguments, interleaved, peak_tensor_bytes, sample_frames
from torch import Tensor
from torch.nn import functional

from hadr.models.network_input import masked_rays, ray_points
from hadr.ray_voxels import (
    SHORTEST_PAIR_M,
    OccupiedVoxels,
    RayVoxelPairs,
    VoxelGrid,
    occupied_voxels,
    ray_voxel_pairs,
    select_points,
)
from hadr.records.provenance import provenance
from hadr.records.result_file import write_sealed


def dense_ray_voxel_pairs(
    directions: Tensor, ray_frame: Tensor, occupied: OccupiedVoxels, grid: VoxelGrid
) -> RayVoxelPairs:
    """What `ray_voxel_pairs` gives, by its definition: every ray against every voxel."""
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


METHODS = {"walk": ray_voxel_pairs, "dense": dense_ray_voxel_pairs}
BATCHES = (1, 8, 32)
MOST_DENSE = 3_000_000_000
"""Bytes: larger dense formulations are left out, and said to be."""
Case = tuple[Tensor, Tensor, OccupiedVoxels, VoxelGrid]


def case(batch: int) -> Case:
    """Rays, their frames, voxels and grid."""
    grid = VoxelGrid(cells=8)
    frames = sample_frames()
    inputs = frames.take([number % len(frames) for number in range(batch)]).inputs
    pixels = select_points(inputs.depth, 10_000)
    depth = inputs.depth[pixels[:, 0], pixels[:, 1], pixels[:, 2]]
    points = ray_points(pixels, depth, inputs.intrinsics)
    occupied = occupied_voxels(points, pixels[:, 0], grid, batch)
    rays = masked_rays(inputs.mask)
    directions = ray_points(rays, torch.ones(len(rays)), inputs.intrinsics)
    return functional.normalize(directions, dim=1), rays[:, 0].contiguous(), occupied, grid


def row(batch: int, turns: int) -> dict[str, Any]:
    """Time and memory of both methods on one case."""
    one = case(batch)
    n_rays, n_voxels = len(one[0]), len(one[2])
    names = ["walk"] + ["dense"] * (n_rays * n_voxels * 40 < MOST_DENSE)
    times = interleaved({n: lambda n=n: METHODS[n](*one) for n in names}, turns, 3.0)
    pairs = METHODS["walk"](*one)
    result: dict[str, Any] = {
        "frames": batch,
        "cells": one[3].cells,
        "rays": n_rays,
        "voxels": n_voxels,
        "pairs": len(pairs),
    }
    for name in names:
        result[name] = dict(times[name])
        result[name]["tensor_bytes"] = peak_tensor_bytes(lambda n=name: METHODS[n](*one))
    if "dense" in names:
        assert torch.equal(METHODS["dense"](*one).voxel, pairs.voxel)
    return result


def main() -> None:
    args = arguments(__doc__, turns=30, threads=1).parse_args()
    torch.set_num_threads(args.threads)
    by_batch = [row(batch, args.turns) for batch in BATCHES]
    content = {
        "what": "Pairing rays with the voxels they cross: the walk through the grid, and every ray "
        "tried with every voxel of the batch; memory: most bytes that torch's tensors held at once",
        "threads": args.threads,
        "by_batch": by_batch,
        "provenance": provenance(),
    }
    for r in by_batch:
        texts = [
            f"{n} {r[n]['cpu_min_ms']:.2f} ms {r[n]['tensor_bytes'] / 1e6:.1f} MB"
            for n in METHODS
            if n in r
        ]
        print(f"{r['frames']} frames, {r['rays']} rays, {r['voxels']} voxels: {'; '.join(texts)}")
    if args.json:
        write_sealed(args.json, content)


if __name__ == "__main__":
    main()
