"""Voxel grid, occupied voxels, and the pairs of a camera ray with the voxels that it crosses.

Everything lives in the camera frame (OpenCV: x right, y down, z forward; metres), in which each
ray starts at the origin. Several frames of a batch are packed into flat tensors with an index that
says to which frame a row belongs; rays and voxels of different frames never meet.

Source: paper, "Ray-Voxel Implicit Neural Representation" and equation 1; ledger, rows 3, 5 and 10.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

SHORTEST_PAIR_M = 1e-6
"""A ray that stays in a voxel for less than this many metres only grazes it: no pair."""


@dataclass(frozen=True)
class VoxelGrid:
    """Cubic cells in the camera frame, with half a cell of margin around the bounds.

    The paper's "8^3 voxels" are bounds of 2 m cut into 8 cells of 0.25 m; half a cell of margin on
    every side makes them 9 cells a side (ledger, row 3). A cell contains its lower faces and not
    its upper ones, so that each point lies in exactly one cell.

    Args:
        lower: Lower bound (x, y, z) in metres, camera frame.
        upper: Upper bound (x, y, z) in metres, camera frame; the same extent along each axis.
        cells: Number of cells along one side, before the margin is added.

    Raises:
        ValueError: `cells` is not positive, or the bounds do not span a cube.
    """

    lower: tuple[float, float, float] = (-1.0, -1.0, 0.0)
    upper: tuple[float, float, float] = (1.0, 1.0, 2.0)
    cells: int = 8

    def __post_init__(self) -> None:
        if self.cells < 1:
            raise ValueError(f"cells must be at least 1, got {self.cells}")
        extent = [high - low for low, high in zip(self.lower, self.upper, strict=True)]
        if min(extent) <= 0 or max(extent) - min(extent) > 1e-9 * max(extent):
            raise ValueError(
                f"bounds must span a cube, got lower {self.lower} and upper {self.upper} "
                f"with extents {extent}"
            )

    @property
    def voxel_size(self) -> float:
        """Side of one cell in metres."""
        return (self.upper[0] - self.lower[0]) / self.cells

    @property
    def origin(self) -> tuple[float, float, float]:
        """Lower corner of cell (0, 0, 0), margin included, in metres, camera frame."""
        half = self.voxel_size / 2
        return (self.lower[0] - half, self.lower[1] - half, self.lower[2] - half)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of cells along x, y and z, margin included."""
        return (self.cells + 1,) * 3

    def cell_of(self, points: Tensor) -> Tensor:
        """Find the cell along x, y, z in which each point (N, 3), metres, lies: long (N, 3).

        A point outside of the grid or with a NaN gets a row of -1.
        """
        scaled = (points - points.new_tensor(self.origin)) / self.voxel_size
        inside = ((scaled >= 0) & (scaled < self.cells + 1)).all(dim=-1, keepdim=True)
        return torch.where(inside, scaled, -1.0).floor().long()

    def center_of(self, cells: Tensor, dtype: torch.dtype = torch.float32) -> Tensor:
        """Give the centres of cells (V, 3), long, in metres: (V, 3) of the type."""
        origin = torch.tensor(self.origin, dtype=dtype, device=cells.device)
        return origin + (cells.to(dtype) + 0.5) * self.voxel_size


@dataclass(frozen=True)
class OccupiedVoxels:
    """The voxels of all frames that hold at least one valid point, packed.

    Attributes:
        frame: Index of the frame of each voxel, shape (V,), long; ascending.
        cell: Cell of each voxel in the grid, shape (V, 3), long.
        center: Centre of each voxel in metres, camera frame, shape (V, 3).
        point_voxel: For each point that was given, the row of its voxel, shape (N,), long; -1
            where the point is NaN or outside of the grid.
        n_frames: Number of frames in the batch, those without any voxel included.
    """

    frame: Tensor
    cell: Tensor
    center: Tensor
    point_voxel: Tensor
    n_frames: int

    def __len__(self) -> int:
        """Give the number of occupied voxels in all frames."""
        return int(self.frame.shape[0])


@dataclass(frozen=True)
class RayVoxelPairs:
    """Each ray with each occupied voxel of its frame that it crosses, packed.

    Sorted by ray and, along a ray, from near to far. Distances are metres along the unit ray, not
    z-depth: z = distance * direction_z.

    Attributes:
        ray: Index of the pair's ray, shape (P,), long; ascending.
        voxel: Row of the pair's voxel in `OccupiedVoxels`, shape (P,), long.
        t_in: Distance at which the ray enters the voxel, shape (P,); 0 where the camera is inside.
        t_out: Distance at which the ray leaves the voxel, shape (P,); larger than `t_in`.
        n_rays: Number of rays, those without any pair included.
    """

    ray: Tensor
    voxel: Tensor
    t_in: Tensor
    t_out: Tensor
    n_rays: int

    def __len__(self) -> int:
        """Give the number of pairs."""
        return int(self.ray.shape[0])

    def candidates(self) -> Tensor:
        """Count the pairs of each ray: long (n_rays,); 0 marks a ray that cannot be restored."""
        return torch.bincount(self.ray, minlength=self.n_rays)


def occupied_voxels(
    points: Tensor, point_frame: Tensor, grid: VoxelGrid, n_frames: int
) -> OccupiedVoxels:
    """Find the voxels that hold at least one point.

    Args:
        points: Metres, shape (N, 3); those with a NaN or outside of the grid are left out.
        point_frame: Index of each point's frame, shape (N,), long, in [0, n_frames).
        grid: The voxel grid, the same for all frames.
        n_frames: Number of frames in the batch.

    Returns:
        The occupied voxels, sorted by frame and then by cell (x slowest, z fastest).
    """
    cell = grid.cell_of(points)
    inside = cell[:, 0] >= 0
    side_x, side_y, side_z = grid.shape
    key = ((point_frame * side_x + cell[:, 0]) * side_y + cell[:, 1]) * side_z + cell[:, 2]

    seen = torch.zeros(n_frames * side_x * side_y * side_z, dtype=torch.bool, device=points.device)
    seen[key[inside]] = True
    row_of_key = seen.cumsum(0) - 1  # right where `seen`, and read only there
    point_voxel = torch.where(inside, row_of_key[key.clamp(min=0)], -1)

    found = seen.nonzero().squeeze(1)
    voxel_cell = torch.stack(
        (found // (side_y * side_z) % side_x, found // side_z % side_y, found % side_z), dim=1
    )
    return OccupiedVoxels(
        frame=found // (side_x * side_y * side_z),
        cell=voxel_cell,
        center=grid.center_of(voxel_cell, points.dtype),
        point_voxel=point_voxel,
        n_frames=n_frames,
    )


def ray_voxel_pairs(
    directions: Tensor, ray_frame: Tensor, occupied: OccupiedVoxels, grid: VoxelGrid
) -> RayVoxelPairs:
    """Pair each ray with the occupied voxels of its frame that it crosses.

    A ray walks through the grid from one plane between cells to the next. Its crossings with the
    planes ahead of it, sorted by distance, cut it into stretches of one cell each; a table says
    which cells are occupied. Memory is linear in the rays and does not depend on the number of
    voxels: about 20 stretches a ray on the default grid.

    Args:
        directions: Unit directions of the rays, shape (R, 3). One with a NaN, or with length zero,
            gets no pair.
        ray_frame: Index of each ray's frame, shape (R,), long.
        occupied: The occupied voxels of all frames.
        grid: The grid with which `occupied` was made.

    Returns:
        The pairs, sorted by ray and then by entering distance. A voxel in which the ray stays for
        less than `SHORTEST_PAIR_M` is left out.
    """
    n_rays = int(directions.shape[0])
    side = grid.cells + 1
    padded = side + 2  # a border of cells that are never occupied: indices -1 and `side`
    strides = (padded * padded, padded, 1)

    table = torch.full(
        (occupied.n_frames, padded**3), -1, dtype=torch.long, device=directions.device
    )
    occupied_key = sum((occupied.cell[:, a] + 1) * strides[a] for a in range(3))
    table[occupied.frame, occupied_key] = torch.arange(len(occupied), device=directions.device)

    start_key = 0
    distances, steps = [], []
    for axis in range(3):
        # Cell of the camera's centre along this axis; -1 or `side` where it is outside of the grid.
        start = math.floor(-grid.origin[axis] / grid.voxel_size)
        start = max(-1, min(side, start))
        start_key += (start + 1) * strides[axis]

        # Planes are numbered 0..side. Upward the ray meets start + 1, start + 2, ...; downward it
        # meets start, start - 1, ... The n-th column holds the n-th plane that lies ahead.
        n_ahead = max(side - start, start + 1)
        count = torch.arange(n_ahead, device=directions.device)
        along = directions[:, axis : axis + 1]  # (rays, 1)
        plane = torch.where(along > 0, start + 1 + count, start - count)  # (rays, n_ahead)
        there = (plane >= 0) & (plane <= side) & (along != 0)
        coordinate = grid.origin[axis] + plane.to(directions.dtype) * grid.voxel_size
        distances.append(torch.where(there, (coordinate / along).clamp(min=0.0), torch.inf))
        steps.append((torch.sign(along) * strides[axis]).nan_to_num(0.0).long().expand_as(plane))

    crossing, order = torch.sort(torch.cat(distances, dim=1), dim=1)  # (rays, ~19)
    step = torch.cat(steps, dim=1).gather(1, order)
    first = torch.full((n_rays, 1), start_key, dtype=torch.long, device=directions.device)
    key = torch.cat((first, step[:, :-1]), dim=1).cumsum(dim=1)  # cell before each crossing
    t_out = crossing
    t_in = torch.cat((crossing.new_zeros(n_rays, 1), crossing[:, :-1]), dim=1)

    stays = (t_out - t_in > SHORTEST_PAIR_M) & torch.isfinite(t_out)
    stays &= torch.isfinite(directions).all(dim=1, keepdim=True)
    voxel = table[ray_frame.unsqueeze(1), torch.where(stays, key, 0)]  # key 0 is in the border
    ray, column = (voxel >= 0).nonzero(as_tuple=True)
    return RayVoxelPairs(
        ray=ray,
        voxel=voxel[ray, column],
        t_in=t_in[ray, column],
        t_out=t_out[ray, column],
        n_rays=n_rays,
    )


def voxels_at(
    points: Tensor, point_frame: Tensor, occupied: OccupiedVoxels, grid: VoxelGrid
) -> Tensor:
    """Find the occupied voxel in which each point (N, 3), metres, of a frame (N,) lies.

    Gives the voxel's row, (N,), long; -1 where the point's cell is not occupied in its frame.
    """
    shape = (occupied.n_frames, *grid.shape)
    table = torch.full(shape, -1, dtype=torch.long, device=points.device)
    table[occupied.frame, *occupied.cell.unbind(1)] = torch.arange(
        len(occupied), device=points.device
    )
    cell = grid.cell_of(points)
    found = table[point_frame, *cell.clamp(min=0).unbind(1)]
    return torch.where(cell[:, 0] >= 0, found, -1)


def pair_of_true_point(
    pairs: RayVoxelPairs, occupied: OccupiedVoxels, true_points: Tensor, grid: VoxelGrid
) -> Tensor:
    """Find, for each ray, the pair whose voxel holds the ray's true surface point.

    From the pairs of R rays, the voxels that they were made with, and the true points in metres,
    (R, 3), NaN = unknown, to the row of each true pair, (R,), long; -1 where no candidate holds it.
    """
    true_cell = grid.cell_of(true_points)
    same = (occupied.cell[pairs.voxel] == true_cell[pairs.ray]).all(dim=1)
    row = same.nonzero().squeeze(1)
    result = torch.full((pairs.n_rays,), -1, dtype=torch.long, device=true_points.device)
    result[pairs.ray[row]] = row  # a ray crosses a cell once: no row is written twice
    return result


def select_points(depth: Tensor, maximum: int) -> Tensor:
    """Pick valid pixels for the point cloud, at most so many a frame, evenly in raster order.

    From z-depth in metres, (B, H, W); 0, negative, NaN or infinite = missing. Gives rows (frame,
    row, column), (N, 3), long, sorted; ValueError for a maximum below 1.
    """
    if maximum < 1:
        raise ValueError(f"maximum must be at least 1, got {maximum}")
    chosen = []
    for frame, image in enumerate(depth):
        pixel = (torch.isfinite(image) & (image > 0)).nonzero()
        if len(pixel) > maximum:
            spread = torch.arange(maximum, device=depth.device) * len(pixel) // maximum
            pixel = pixel[spread]
        chosen.append(torch.nn.functional.pad(pixel, (1, 0), value=frame))
    return torch.cat(chosen) if chosen else depth.new_zeros((0, 3), dtype=torch.long)


def segment_max(values: Tensor, segment: Tensor, n: int) -> Tensor:
    """Take the maximum of the rows (N, C) of each segment (N,), in any order, channel by channel.

    Gives (n, C); 0 for a segment without a row.
    """
    result = values.new_zeros(n, values.shape[1])
    index = segment.unsqueeze(1).expand_as(values)
    return result.scatter_reduce(0, index, values, reduce="amax", include_self=False)


def segment_log_softmax(logits: Tensor, segment: Tensor, n: int) -> Tensor:
    """Turn the logits (P,) of each segment into logarithms of probabilities that sum to one.

    The largest logit of a segment is subtracted first, so that large logits do not overflow; and a
    row of which the probability rounds to zero still has its logarithm and a gradient. Segments as
    in `segment_max`.
    """
    below = logits - segment_max(logits.detach().unsqueeze(1), segment, n).squeeze(1)[segment]
    total = below.new_zeros(n).index_add(0, segment, below.exp())
    return below - total[segment].log()


def segment_softmax(logits: Tensor, segment: Tensor, n: int) -> Tensor:
    """The probabilities themselves; see `segment_log_softmax`."""
    return segment_log_softmax(logits, segment, n).exp()


def segment_argmax(values: Tensor, segment: Tensor, n: int) -> Tensor:
    """Find the row with the largest value (P,) of each segment; of equal ones, the first.

    Returns:
        Row of the largest value, shape (n,), long; -1 for a segment without a row.
    """
    largest = segment_max(values.detach().unsqueeze(1), segment, n).squeeze(1)
    row = (values == largest[segment]).nonzero().squeeze(1)
    none = len(values)
    first = torch.full((n,), none, dtype=torch.long, device=values.device)
    first = first.scatter_reduce(0, segment[row], row, reduce="amin")
    return torch.where(first == none, -1, first)
