"""A walk along one ray, cell by cell: the cells that it crosses, occupied or not, and its stay."""

from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from torch import Tensor

from hadr.camera import FloatArray
from hadr.figures.method.rays import draw_slabs, draw_walk
from hadr.figures.panels import COLORS
from hadr.ray_voxels import OccupiedVoxels, VoxelGrid, occupied_voxels, ray_voxel_pairs

_ABOVE = np.eye(3)
_BESIDE = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # up, aside, away


@dataclass(frozen=True)
class VoxelWalk:
    """All cells of the grid that one ray crosses, from near to far.

    Attributes:
        direction: Unit vector, camera frame, shape (3,).
        cells: Indices along x, y, z, shape (K, 3).
        centers: Their centres, camera frame, metres, shape (K, 3).
        t_in: Where the ray enters them, metres along it, shape (K,).
        t_out: Where it leaves them, shape (K,).
        candidate: For each cell its number among the ray's candidates, shape (K,); -1 = empty.
        size: Side of a cell in metres.
    """

    direction: FloatArray
    cells: FloatArray
    centers: FloatArray
    t_in: FloatArray
    t_out: FloatArray
    candidate: FloatArray
    size: float

    def __len__(self) -> int:
        """Give the number of cells."""
        return len(self.t_in)

    def cell_at(self, distance: float) -> int:
        """Give the row of the cell in which the ray is at a distance in metres; -1 = in none."""
        inside = (self.t_in <= distance) & (distance < self.t_out)
        return int(inside.argmax()) if inside.any() else -1


def voxel_walk(direction: Tensor, occupied: OccupiedVoxels, grid: VoxelGrid) -> VoxelWalk:
    """All cells on the way of a ray, a unit vector (3,), through the grid, empty ones too."""
    ray = direction.detach().double()
    all_cells = torch.cartesian_prod(*(torch.arange(n) for n in grid.shape))
    points = grid.center_of(all_cells, torch.float64)
    every = occupied_voxels(points, torch.zeros(len(points), dtype=torch.long), grid, n_frames=1)
    pairs = ray_voxel_pairs(ray[None], torch.zeros(1, dtype=torch.long), every, grid)
    crossed = every.cell[pairs.voxel]
    held = (crossed[:, None] == occupied.cell[None]).all(dim=2).any(dim=1).numpy()
    return VoxelWalk(
        direction=ray.numpy(),
        cells=crossed.numpy(),
        centers=grid.center_of(crossed, torch.float64).numpy(),
        t_in=pairs.t_in.numpy(),
        t_out=pairs.t_out.numpy(),
        candidate=np.where(held, held.cumsum() - 1, -1),
        size=grid.voxel_size,
    )


def walk_picture(walk: VoxelWalk, probability: FloatArray, truth: float, place: int) -> Figure:
    """Draw one place of a walk: the ray from above, the cell's slabs, the candidates' shares."""
    figure: Figure = plt.figure(figsize=(9, 3.9), layout="none")  # all alike, and drawn faster
    figure.subplots_adjust(0.085, 0.13, 0.885, 0.92, 0.32, 0.5)  # numbers stand at the right
    panels = [["above", "slabs"], ["beside", "shares"]]
    axes: dict[str, Axes] = figure.subplot_mosaic(panels, width_ratios=(1.5, 1))
    _draw_view(axes["above"], walk, _ABOVE, truth, place)
    axes["above"].set(ylabel="from above:\nx (m)", xlabel="")
    _draw_view(axes["beside"], walk, _BESIDE, truth, place)
    axes["beside"].set(ylabel="from the side:\n−y (m)")
    _draw_slabs(axes["slabs"], walk, place)
    mine = int(walk.candidate[place])
    numbers = range(1, len(probability) + 1)
    ink = [COLORS["voxel" if k - 1 == mine else "background"] for k in numbers]
    bars = axes["shares"].bar(numbers, 100 * probability, color=ink)
    axes["shares"].bar_label(bars, fmt="%.0f %%")
    axes["shares"].set(xlabel="candidate", ylabel="share (%)", ylim=(0, 120), xticks=numbers)
    kind = f"candidate {mine + 1}" if mine >= 0 else "empty, so no candidate"
    if walk.cell_at(truth) == place:
        kind += "; the glass is in here"
    cell = "({}, {}, {})".format(*walk.cells[place])
    axes["above"].set_title(f"cell {cell}: {kind}", loc="left")
    return figure


def _draw_slabs(ax: Axes, walk: VoxelWalk, place: int) -> None:
    planes = np.stack((walk.centers[place] - walk.size / 2, walk.centers[place] + walk.size / 2))
    with np.errstate(divide="ignore"):
        crossings = planes / walk.direction
    end = float(walk.t_out.max())
    draw_slabs(ax, crossings.min(axis=0).clip(min=0), crossings.max(axis=0).clip(max=end))
    ax.set(xlim=(-0.25, end + 0.25))
    ax.set_title(f"in at {walk.t_in[place]:.3f} m, out at {walk.t_out[place]:.3f} m")


def _draw_view(ax: Axes, walk: VoxelWalk, view: FloatArray, truth: float, place: int) -> None:
    """Draw the walk along the second axis of a view, the first one upwards."""
    held, half = walk.candidate >= 0, walk.size / 2
    centers, ray = walk.centers @ view.T, view @ walk.direction
    for up, _, z in centers[~held]:
        corner = (z - half, up - half)
        ax.add_patch(Rectangle(corner, walk.size, walk.size, fill=False, ec="#b0b0b0", ls=":"))
    middle = (walk.t_in[place] + walk.t_out[place]) / 2
    part = (centers[held], walk.t_in[held], walk.t_out[held])
    draw_walk(ax, ray, *part, walk.size, reached=middle, truth=truth, numbers=False)
    up, _, z = centers[place]
    corner = (z - half, up - half)
    ax.add_patch(Rectangle(corner, walk.size, walk.size, fill=False, ec="black", lw=2.2, zorder=3))
    for t, face in ((walk.t_in[place], COLORS["ray"]), (walk.t_out[place], "white")):
        ax.plot(t * ray[2], t * ray[0], "o", ms=7, mfc=face, mec=COLORS["ray"], mew=1.6, zorder=6)
    ax.set_aspect("equal", adjustable="box")
    low, high = centers.min(axis=0) - half - 0.05, centers.max(axis=0) + half + 0.05
    ax.set(xlim=(low[2], high[2]), ylim=(low[0], high[0]))
