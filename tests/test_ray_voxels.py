"""Grid, occupied voxels, ray-voxel pairs and segment operations."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

from hadr.ray_voxels import (
    SHORTEST_PAIR_M,
    OccupiedVoxels,
    RayVoxelPairs,
    VoxelGrid,
    occupied_voxels,
    pair_of_true_point,
    ray_voxel_pairs,
    segment_argmax,
    segment_log_softmax,
    segment_max,
    segment_softmax,
    select_points,
)

GRID = VoxelGrid()


def occupy(
    cells: list[tuple[int, int, int]],
    frames: list[int] | None = None,
    n_frames: int = 1,
    grid: VoxelGrid = GRID,
    dtype: torch.dtype = torch.float64,
) -> OccupiedVoxels:
    """One point in the centre of each given cell."""
    center = grid.center_of(torch.tensor(cells, dtype=torch.long).reshape(-1, 3), dtype)
    frame = torch.tensor(frames if frames is not None else [0] * len(cells), dtype=torch.long)
    return occupied_voxels(center, frame, grid, n_frames)


def unit(vectors: list[list[float]] | Tensor, dtype: torch.dtype = torch.float64) -> Tensor:
    vectors = torch.as_tensor(vectors, dtype=dtype)
    return vectors / vectors.norm(dim=1, keepdim=True)


def zeros(n: int) -> Tensor:
    return torch.zeros(n, dtype=torch.long)


def slab_test(direction: list[float], low: list[float], high: list[float]) -> tuple[float, float]:
    """Textbook slab test of one ray from the origin with one box, in plain Python floats."""
    t_in, t_out = 0.0, math.inf
    for d, a, b in zip(direction, low, high, strict=True):
        if d == 0:
            if not a <= 0 < b:
                return math.inf, -math.inf
            continue
        near, far = sorted((a / d, b / d))
        t_in, t_out = max(t_in, near), min(t_out, far)
    return t_in, t_out


def pairs_by_brute_force(
    directions: Tensor, ray_frame: Tensor, occupied: OccupiedVoxels, grid: VoxelGrid
) -> dict[tuple[int, int], tuple[float, float]]:
    found = {}
    half = grid.voxel_size / 2
    for ray, direction in enumerate(directions.double().tolist()):
        for voxel in range(len(occupied)):
            if int(occupied.frame[voxel]) != int(ray_frame[ray]):
                continue
            cell = occupied.cell[voxel].tolist()
            center = [
                o + (c + 0.5) * grid.voxel_size for o, c in zip(grid.origin, cell, strict=True)
            ]
            t_in, t_out = slab_test(
                direction, [c - half for c in center], [c + half for c in center]
            )
            if t_out - t_in > SHORTEST_PAIR_M:
                found[ray, voxel] = (t_in, t_out)
    return found


def as_dict(pairs: RayVoxelPairs) -> dict[tuple[int, int], tuple[float, float]]:
    keys = zip(pairs.ray.tolist(), pairs.voxel.tolist(), strict=True)
    values = zip(pairs.t_in.tolist(), pairs.t_out.tolist(), strict=True)
    result = dict(zip(keys, values, strict=True))
    assert len(result) == len(pairs), "a pair occurs twice"
    return result


def assert_same_pairs(
    pairs: RayVoxelPairs, expected: dict[tuple[int, int], tuple[float, float]], tolerance: float
) -> None:
    got = as_dict(pairs)
    assert got.keys() == expected.keys()
    for key, distances in expected.items():
        assert got[key] == pytest.approx(distances, abs=tolerance)


def assert_sorted(pairs: RayVoxelPairs) -> None:
    same_ray = pairs.ray[1:] == pairs.ray[:-1]
    assert (pairs.ray[1:] >= pairs.ray[:-1]).all()
    assert (pairs.t_in[1:] >= pairs.t_in[:-1])[same_ray].all()
    assert (pairs.t_out > pairs.t_in).all()
    assert (pairs.t_in >= 0).all()


def test_default_grid_is_the_papers() -> None:
    assert GRID.voxel_size == 0.25
    assert GRID.origin == (-1.125, -1.125, -0.125)
    assert GRID.shape == (9, 9, 9)


def test_cell_of_known_points() -> None:
    points = torch.tensor(
        [
            [0.0, 0.0, 0.0],  # the camera: middle of cell (4, 4, 0)
            [-1.125, -1.125, -0.125],  # lower corner of the grid
            [0.125, 0.0, 0.125],  # on two faces: the upper cell has them
            [1.1249, -1.12, 2.1249],
            [1.125, 0.0, 1.0],  # upper face of the grid: outside
            [0.0, -1.126, 1.0],
            [float("nan"), 0.0, 1.0],
            [0.0, 0.0, float("inf")],
        ]
    )
    outside = [-1, -1, -1]
    expected = [[4, 4, 0], [0, 0, 0], [5, 4, 1], [8, 0, 8], outside, outside, outside, outside]
    assert GRID.cell_of(points).tolist() == expected


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"cells": 0}, "cells must be at least 1, got 0"),
        ({"upper": (1.0, 1.0, 1.0)}, "must span a cube"),
        ({"lower": (1.0, 1.0, 2.0), "upper": (-1.0, -1.0, 0.0)}, "must span a cube"),
    ],
)
def test_bad_grids_are_refused(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        VoxelGrid(**arguments)  # type: ignore[arg-type]


def test_occupied_voxels_by_hand() -> None:
    nan = float("nan")
    points = torch.tensor(
        [
            [0.0, 0.0, 1.0],  # frame 1, cell (4, 4, 4)
            [0.05, -0.05, 1.02],  # frame 0, the same cell, another voxel
            [0.3, 0.0, 1.0],  # frame 1, cell (5, 4, 4)
            [0.1, 0.1, 0.9],  # frame 1, cell (4, 4, 4) again
            [5.0, 0.0, 1.0],  # outside
            [nan, nan, nan],
        ]
    )
    occupied = occupied_voxels(points, torch.tensor([1, 0, 1, 1, 0, 1]), GRID, n_frames=3)
    assert len(occupied) == 3
    assert occupied.frame.tolist() == [0, 1, 1]
    assert occupied.cell.tolist() == [[4, 4, 4], [4, 4, 4], [5, 4, 4]]
    assert occupied.center.tolist() == [[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.25, 0.0, 1.0]]
    assert occupied.point_voxel.tolist() == [1, 0, 2, 1, -1, -1]
    assert occupied.n_frames == 3


def test_no_points_occupy_no_voxels() -> None:
    occupied = occupied_voxels(torch.zeros(0, 3), zeros(0), GRID, n_frames=2)
    assert len(occupied) == 0
    pairs = ray_voxel_pairs(unit([[0, 0, 1]]), zeros(1), occupied, GRID)
    assert len(pairs) == 0
    assert pairs.candidates().tolist() == [0]


def test_slanted_ray_by_hand() -> None:
    # Direction (3, 0, 4) / 5: at distance t the ray is at x = 0.6 t, z = 0.8 t.
    # Cell (7, 4, 4): x in [0.625, 0.875] -> t in [1.041667, 1.458333]; z in [0.875, 1.125]
    # -> t in [1.09375, 1.40625]; both -> [1.09375, 1.40625].
    # Cell (6, 4, 3): x in [0.375, 0.625] -> [0.625, 1.041667]; z in [0.625, 0.875] ->
    # [0.78125, 1.09375]; both -> [0.78125, 1.041667].
    # Cell (6, 4, 4) is passed diagonally: z enters at 1.09375, x has left at 1.041667.
    occupied = occupy([(6, 4, 3), (6, 4, 4), (7, 4, 4)])
    pairs = ray_voxel_pairs(unit([[3, 0, 4]]), zeros(1), occupied, GRID)
    assert occupied.cell[pairs.voxel].tolist() == [[6, 4, 3], [7, 4, 4]]
    assert pairs.t_in.tolist() == pytest.approx([0.78125, 1.09375], abs=1e-12)
    assert pairs.t_out.tolist() == pytest.approx([1.0416666666667, 1.40625], abs=1e-12)


def test_ray_through_edges_and_corners_has_no_empty_pairs() -> None:
    # The direction (1, 1, 1) meets x, y and z planes at once, again and again: every crossing is
    # a corner where up to seven cells are touched and only one is passed.
    everything = [(x, y, z) for x in range(9) for y in range(9) for z in range(9)]
    for dtype in (torch.float64, torch.float32):
        occupied = occupy(everything, dtype=dtype)
        directions = unit([[1, 1, 1], [1, -1, 1], [-1, -1, 1]], dtype)
        pairs = ray_voxel_pairs(directions, zeros(3), occupied, GRID)
        assert pairs.candidates().tolist() == [5, 5, 5]
        length = torch.tensor([0.125, 0.25, 0.25, 0.25, 0.25], dtype=dtype).repeat(3) * math.sqrt(3)
        torch.testing.assert_close(pairs.t_out - pairs.t_in, length)


def test_bad_directions_get_no_pair() -> None:
    everything = [(x, y, z) for x in range(9) for y in range(9) for z in range(9)]
    nan = float("nan")
    bad = [[nan, nan, nan], [nan, 0.0, 1.0], [0.0, 0.0, nan], [0.0, 0.0, 0.0]]
    directions = torch.tensor([*bad, [0.0, 0.0, 1.0]])
    pairs = ray_voxel_pairs(directions, zeros(5), occupy(everything, dtype=torch.float32), GRID)
    assert pairs.candidates().tolist() == [0, 0, 0, 0, 9]


def test_camera_outside_of_the_grid_and_on_a_plane() -> None:
    # Lower corner (0.9, -0.1, -0.1): the camera is outside in x. Cells are 0.2 m.
    outside = VoxelGrid((1.0, 0.0, 0.0), (1.4, 0.4, 0.4), cells=2)
    cells = [(x, y, z) for x in range(3) for y in range(3) for z in range(3)]
    occupied = occupy(cells, grid=outside)
    directions = unit([[1, 0, 0], [-1, 0, 0], [5, 1, 1]])
    pairs = ray_voxel_pairs(directions, zeros(3), occupied, outside)
    assert pairs.t_in[pairs.ray == 0].tolist() == pytest.approx([0.9, 1.1, 1.3])
    assert pairs.candidates()[1] == 0
    expected = pairs_by_brute_force(directions, zeros(3), occupied, outside)
    assert_same_pairs(pairs, expected, 1e-12)
    # Lower corner (-0.5, -0.5, -0.5), cells of 0.5 m: the camera is a corner of eight cells.
    corner = VoxelGrid((-0.25, -0.25, -0.25), (0.75, 0.75, 0.75), cells=2)
    occupied = occupy([(0, 0, 0), (1, 1, 1), (2, 2, 2)], grid=corner)
    pairs = ray_voxel_pairs(unit([[1, 1, 1], [-1, -1, -1]]), zeros(2), occupied, corner)
    assert occupied.cell[pairs.voxel].tolist() == [[1, 1, 1], [2, 2, 2], [0, 0, 0]]
    edge = math.sqrt(3) / 2
    assert pairs.t_in.tolist() == pytest.approx([0.0, edge, 0.0], abs=1e-12)
    assert pairs.t_out.tolist() == pytest.approx([edge, 2 * edge, edge])


def test_rounding_of_a_plane_through_the_camera_gives_no_negative_distance() -> None:
    # Plane 3 of this grid should be z = 0 and comes out as +1.1e-16.
    grid = VoxelGrid((-0.8125,) * 3, (0.4875,) * 3, cells=4)
    assert grid.origin[2] + 3 * grid.voxel_size > 0
    occupied = occupy([(2, 2, 2), (3, 3, 3)], grid=grid)
    pairs = ray_voxel_pairs(unit([[-1, -1, -1], [1, 1, 1]]), zeros(2), occupied, grid)
    assert occupied.cell[pairs.voxel].tolist() == [[2, 2, 2], [3, 3, 3]]
    assert pairs.t_in.tolist() == [0.0, 0.0]
    assert pairs.t_out.tolist() == pytest.approx([0.325 * math.sqrt(3)] * 2)


def random_scene(seed: int, n_rays: int, n_points: int, dtype: torch.dtype, n_frames: int = 2):
    generator = torch.Generator().manual_seed(seed)
    scale = torch.tensor([2.3, 2.3, 2.3], dtype=torch.float64)
    points = torch.rand(n_points, 3, generator=generator, dtype=torch.float64) * scale
    points = (points + torch.tensor([-1.15, -1.15, -0.15])).to(dtype)
    frame = torch.randint(0, n_frames, (n_points,), generator=generator)
    directions = unit(torch.randn(n_rays, 3, generator=generator, dtype=torch.float64), dtype)
    ray_frame = torch.randint(0, n_frames, (n_rays,), generator=generator)
    return directions, ray_frame, occupied_voxels(points, frame, GRID, n_frames)


@pytest.mark.parametrize(
    ("dtype", "tolerance"), [(torch.float64, 1e-9), (torch.float32, 1e-5)], ids=["64", "32"]
)
def test_random_rays_agree_with_a_slab_test_loop(dtype: torch.dtype, tolerance: float) -> None:
    directions, ray_frame, occupied = random_scene(0, 300, 400, dtype)
    pairs = ray_voxel_pairs(directions, ray_frame, occupied, GRID)
    assert len(pairs) > 500
    assert pairs.t_in.dtype == dtype
    assert_sorted(pairs)
    expected = pairs_by_brute_force(directions, ray_frame, occupied, GRID)
    assert_same_pairs(pairs, expected, tolerance)


@settings(max_examples=40)
@given(
    seed=st.integers(0, 2**31),
    component=st.sampled_from([0.0, -0.0, 1.0, -1.0, 1e-12, -1e-300, 0.5]),
    axis=st.integers(0, 2),
)
def test_awkward_rays_agree_with_a_slab_test_loop(seed: int, component: float, axis: int) -> None:
    directions, ray_frame, occupied = random_scene(seed, 6, 60, torch.float64)
    directions[:, axis] = component
    directions = unit(directions)
    pairs = ray_voxel_pairs(directions, ray_frame, occupied, GRID)
    assert_sorted(pairs)
    expected = pairs_by_brute_force(directions, ray_frame, occupied, GRID)
    assert_same_pairs(pairs, expected, 1e-9)


class LargestTensor(TorchDispatchMode):
    """Records the largest number of elements of any tensor made inside of the block."""

    elements = 0

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):  # type: ignore[no-untyped-def]
        result = func(*args, **(kwargs or {}))
        made = result if isinstance(result, (tuple, list)) else (result,)
        sizes = [x.numel() for x in made if isinstance(x, Tensor)]
        self.elements = max([self.elements, *sizes])
        return result


def test_memory_is_linear_in_rays_and_free_of_the_voxels() -> None:
    directions, ray_frame, full = random_scene(2, 20_000, 40_000, torch.float32)
    assert len(full) == 2 * 9**3  # every cell of both frames
    _, _, sparse = random_scene(2, 1, 60, torch.float32)
    largest = []
    for occupied in (full, sparse):
        with LargestTensor() as recorded:
            pairs = ray_voxel_pairs(directions, ray_frame, occupied, GRID)
        largest.append(recorded.elements)
        assert len(pairs) > 0
    # At most 5 + 5 + 9 planes lie ahead of a ray that starts in cell (4, 4, 0). A matrix of rays
    # and voxels would have 1458 columns.
    assert largest[1] <= 19 * 20_000
    # With every cell occupied each stretch is a pair, and (ray, column) of all pairs stand side by
    # side for a moment.
    assert largest[0] <= 2 * 19 * 20_000


@settings(max_examples=25)
@given(seed=st.integers(0, 2**31))
def test_true_pair_brackets_the_true_distance_where_that_is_known(seed: int) -> None:
    directions, ray_frame, occupied = random_scene(seed, 50, 400, torch.float64)
    generator = torch.Generator().manual_seed(seed)
    distance = torch.rand(50, generator=generator, dtype=torch.float64) * 1.2
    distance[::7] = torch.nan  # unknown
    points = directions * distance[:, None]
    pairs = ray_voxel_pairs(directions, ray_frame, occupied, GRID)
    row = pair_of_true_point(pairs, occupied, points, GRID)
    for ray in range(50):
        covering = (
            (pairs.ray == ray) & (pairs.t_in <= distance[ray]) & (distance[ray] < pairs.t_out)
        ).nonzero()
        assert row[ray] == (int(covering) if len(covering) else -1)


def test_select_points_skips_missing_depth() -> None:
    depth = torch.tensor([[[0.0, 1.0], [float("nan"), 2.0]], [[0.0, 0.0], [-1.0, float("inf")]]])
    assert select_points(depth, 10).tolist() == [[0, 0, 1], [0, 1, 1]]


def test_select_points_spreads_evenly_over_each_frame() -> None:
    depth = torch.ones(2, 10, 10)
    depth[1, 5:] = 0
    chosen = select_points(depth, 25)
    assert (chosen[:, 0] == 0).sum() == 25
    assert (chosen[:, 0] == 1).sum() == 25
    order = chosen[:25, 1] * 10 + chosen[:25, 2]
    assert order.tolist() == list(range(0, 100, 4))
    assert (chosen[25:, 1] * 10 + chosen[25:, 2]).tolist() == list(range(0, 50, 2))


def test_select_points_handles_no_frames_and_refuses_zero() -> None:
    assert select_points(torch.zeros(0, 4, 4), 3).shape == (0, 3)
    assert select_points(torch.zeros(2, 4, 4), 3).shape == (0, 3)
    with pytest.raises(ValueError, match="maximum must be at least 1, got 0"):
        select_points(torch.ones(1, 2, 2), 0)


def test_segment_softmax_survives_large_logits() -> None:
    logits = torch.tensor([1e4, 1e4 - 1.0, -1e30, -1e30, -3e38, 3e38])
    got = segment_softmax(logits, torch.tensor([0, 0, 1, 1, 2, 2]), 3)
    high = 1 / (1 + math.exp(-1))
    assert got.tolist() == pytest.approx([high, 1 - high, 0.5, 0.5, 0.0, 1.0])


@settings(max_examples=30)
@given(seed=st.integers(0, 2**31), n=st.integers(1, 6), p=st.integers(1, 20))
def test_segment_softmax_and_argmax_agree_with_torch_per_segment(seed: int, n: int, p: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    segment = torch.randint(0, n, (p,), generator=generator)
    logits = torch.randn(p, generator=generator, dtype=torch.float64) * 5
    softmax = segment_softmax(logits, segment, n)
    argmax = segment_argmax(logits, segment, n)
    for k in range(n):
        rows = (segment == k).nonzero().squeeze(1)
        if len(rows) == 0:
            assert argmax[k] == -1
            continue
        torch.testing.assert_close(softmax[rows], torch.softmax(logits[rows], 0))
        assert argmax[k] == rows[logits[rows].argmax()]


def test_the_logarithm_of_a_vanishing_probability_is_exact() -> None:
    logits = torch.tensor([1000.0, 0.0, 3.0])
    segment = torch.tensor([0, 0, 2])
    assert segment_softmax(logits, segment, 3).tolist() == [1.0, 0.0, 1.0]
    assert segment_log_softmax(logits, segment, 3).tolist() == [0.0, -1000.0, 0.0]


def test_segment_argmax_takes_the_first_of_equals() -> None:
    values = torch.tensor([1.0, 7.0, 7.0, -2.0, -2.0, -9.0])
    segment = torch.tensor([1, 1, 1, 3, 3, 0])
    assert segment_argmax(values, segment, 5).tolist() == [5, 1, -1, 3, -1]


def test_segment_argmax_of_nothing() -> None:
    assert segment_argmax(torch.zeros(0), zeros(0), 3).tolist() == [-1, -1, -1]
    assert segment_softmax(torch.zeros(0), zeros(0), 3).shape == (0,)


def test_segment_max_by_hand() -> None:
    values = torch.tensor([[1.0, -5.0], [3.0, -7.0], [-2.0, -2.0]])
    got = segment_max(values, torch.tensor([2, 2, 0]), 4)
    assert got.tolist() == [[-2.0, -2.0], [0.0, 0.0], [3.0, -5.0], [0.0, 0.0]]
