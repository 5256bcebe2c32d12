"""Figures of rays: the slabs of a voxel, walks along one ray, a strip of rays.

The figures from above show the camera frame's z to the right and its x upward.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import ipywidgets as widgets
import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import torch
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from torch import Tensor

from hadr.camera import BoolArray, FloatArray
from hadr.figures.panels import COLORS, live_figure, show_color
from hadr.figures.rows import name_rows
from hadr.ray_voxels import (
    OccupiedVoxels,
    RayVoxelPairs,
    VoxelGrid,
    occupied_voxels,
    ray_voxel_pairs,
)


def draw_walk(
    ax: Any,
    direction: npt.ArrayLike,
    cells: npt.ArrayLike,
    t_in: npt.ArrayLike,
    t_out: npt.ArrayLike,
    size: float,
    *,
    reached: float | None = None,
    truth: float | None = None,
    numbers: bool = True,
) -> None:
    """Draw one ray, a unit vector (3,), and its candidate voxels from above: z to the right, x up.

    All is in the camera frame and metres: the voxels' centres, (K, 3), their size, and where the
    ray enters and leaves them, (K,). The candidate in which the walk is when it has reached so far
    gets a stronger colour; None is the whole ray. The true surface is drawn where it is given, and
    `numbers` are the distances beside the crossings.
    """
    d = np.asarray(direction, dtype=float)
    centers, starts, ends = (np.asarray(a, dtype=float) for a in (cells, t_in, t_out))
    far = float(ends.max()) + 0.12
    for k, center in enumerate(centers):
        here = reached is not None and starts[k] <= reached < ends[k]
        corner, fill = center[[2, 0]] - size / 2, to_rgba(COLORS["voxel"], 0.55 if here else 0.16)
        ax.add_patch(Rectangle(corner, size, size, fc=fill, ec=COLORS["voxel"], lw=1.2))
    ax.plot([0, far * d[2]], [0, far * d[0]], color=COLORS["raw"], lw=1, ls=(0, (4, 3)))
    stop = far if reached is None else reached
    ax.plot([0, stop * d[2]], [0, stop * d[0]], color=COLORS["ray"], lw=2.2)
    ax.plot(0, 0, marker="s", color="black", ms=7)
    side = np.array([-d[0], d[2]]) / np.hypot(d[0], d[2])
    for k in range(len(starts)):
        for t, sign, face in ((starts[k], 1, COLORS["ray"]), (ends[k], -1, "white")):
            if t > stop + 1e-9:
                continue
            at = np.array([t * d[2], t * d[0]])
            ax.plot(*at, "o", ms=6, mfc=face, mec=COLORS["ray"], mew=1.4, zorder=4)
            if numbers:
                box = {"fc": "white", "ec": "none", "alpha": 0.8, "pad": 0.6}
                ax.annotate(f"{t:.3f}", at, at + sign * side * 0.055, ha="center", va="center",
                            fontsize=9, bbox=box)  # fmt: skip
    if truth is not None:
        ax.plot(truth * d[2], truth * d[0], "*", ms=14, color=COLORS["truth"], zorder=5)
    ax.set_aspect("equal", adjustable="datalim")
    ax.set(xlabel="z (m)", ylabel="x (m)")


def draw_missed(ax: Axes, center: npt.ArrayLike, size: float, text: str) -> None:
    """Add a voxel that the ray misses, a dotted square and a text, to a walk from above."""
    x, _, z = np.asarray(center, dtype=float)
    corner, color = (z - size / 2, x - size / 2), COLORS["raw"]
    ax.add_patch(Rectangle(corner, size, size, fill=False, ec=color, ls=":"))
    below, line = (z, x - size / 2), {"arrowstyle": "-", "color": color}
    ax.annotate(text, below, (z, below[1] - 0.215), ha="center", fontsize=9, arrowprops=line)


def draw_slabs(ax: Axes, near: npt.ArrayLike, far: npt.ArrayLike) -> None:
    """Draw the stay, near to far (3,) metres, in a voxel's slabs as bars, and what they share."""
    starts, ends = (np.asarray(a, dtype=float) for a in (near, far))
    starts, ends = np.append(starts, starts.max()), np.append(ends, ends.min())
    limited = np.isfinite(starts) & np.isfinite(ends)
    low, high = starts[limited].min() - 0.15, ends[limited].max() + 0.15
    names = ["x slab", "y slab", "z slab", "all three"]
    for row, (start, end) in enumerate(zip(starts.clip(low), ends.clip(max=high), strict=True)):
        alpha = 1.0 if row == len(names) - 1 else 0.4
        ax.barh(row, end - start, left=start, color=COLORS["voxel"], alpha=alpha)
        text = f"{start:.3f} to {end:.3f}" if limited[row] else "no limit"
        ax.text(1.02, row, text, va="center", fontsize=9, transform=ax.get_yaxis_transform())
    ax.set(xlim=(low, high), xlabel="distance along the ray (m)")
    ax.set_yticks(range(len(names)), names)
    ax.invert_yaxis()


def stages_figure(
    direction: npt.ArrayLike,
    cells: npt.ArrayLike,
    t_in: npt.ArrayLike,
    t_out: npt.ArrayLike,
    size: float,
    truth: float,
) -> Figure:
    """Draw four moments of a walk: before the first candidate, in it, at the surface, past all."""
    first, last = float(np.asarray(t_in)[0]), float(np.asarray(t_out)[-1])
    stops = {
        "nothing yet": first / 2,
        "first candidate": first + 0.03,
        "the true surface": truth,
        "past the last one": last + 0.05,
    }
    fig: Figure
    fig, axes = plt.subplots(2, 2, figsize=(9, 4.4))
    for ax, (title, t) in zip(axes.flat, stops.items(), strict=True):
        draw_walk(ax, direction, cells, t_in, t_out, size, reached=t, truth=truth, numbers=False)
        ax.set_title(f"{title}: t = {t:.2f} m")
    return fig


def show_pixels(ax: Axes, color: npt.NDArray[Any], mask: BoolArray, uv: npt.ArrayLike) -> None:
    """Show the part of an image around a mask, with some pixels (column, row) marked."""
    show_color(ax, color)
    ax.plot(*np.asarray(uv).T, "o", ms=5, mfc="white", mec=COLORS["ray"])
    _zoom_to(ax, mask)


def show_labels(
    ax: Axes,
    color: npt.NDArray[Any],
    mask: BoolArray,
    values: npt.ArrayLike,
    names: Sequence[str] | None = None,
) -> None:
    """Paint the pixels of a mask by a whole number each, over the faded image around it."""
    painted = np.full(mask.shape, np.nan)
    painted[mask] = values
    first, last = int(np.nanmin(painted)), int(np.nanmax(painted))
    map_name = "viridis" if names is None else "Set2"
    cmap = plt.get_cmap(map_name, last - first + 1)
    show_color(ax, color // 2 + 127)
    drawn = ax.imshow(painted, cmap=cmap, vmin=first - 0.5, vmax=last + 0.5)
    bar = ax.figure.colorbar(drawn, ax=ax, ticks=range(first, last + 1), shrink=0.8)
    if names is not None:
        bar.set_ticklabels(list(names)[first : last + 1])
    _zoom_to(ax, mask)


def _zoom_to(ax: Axes, mask: BoolArray) -> None:
    rows, columns = np.nonzero(mask)
    ax.set(xlim=(columns.min() - 15, columns.max() + 15), ylim=(rows.max() + 15, rows.min() - 15))


def draw_strip(
    ax: Any,
    pairs: RayVoxelPairs,
    occupied: OccupiedVoxels,
    true_distance: npt.ArrayLike,
    rays: npt.ArrayLike,
) -> None:
    """Draw some rays as rows: a bar for each candidate voxel, a star for the true surface."""
    truth = np.asarray(true_distance, dtype=float)
    chosen = np.asarray(rays, dtype=int)
    shades = ("#CC79A7", "#E3B3CC", "#A9527F")
    for row, ray in enumerate(chosen):
        for p in (pairs.ray == int(ray)).nonzero().squeeze(1).tolist():
            voxel = int(pairs.voxel[p])
            shade = shades[int(occupied.cell[voxel].sum()) % 3]
            start, end = float(pairs.t_in[p]), float(pairs.t_out[p])
            ax.barh(row, end - start, left=start, height=0.82, color=shade, ec="white", lw=0.8)
        ax.plot(truth[ray], row, "*", color=COLORS["truth"], ms=9)
    name_rows(ax, [str(ray) for ray in chosen])
    ax.set(xlabel="distance along the ray (m)", ylabel="ray")


_ABOVE = np.eye(3)
_BESIDE = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # up, aside, away


@dataclass(frozen=True)
class VoxelWalk:
    """All cells of the grid that one ray, a unit vector (3,), crosses, from near to far.

    Their indices along x, y, z, (K, 3), their centres, camera frame, (K, 3), where the ray enters
    and leaves them, (K,), their numbers among the ray's candidates, (K,), where -1 is empty, and
    their size; metres.
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
    figure.subplots_adjust(0.105, 0.13, 0.885, 0.92, 0.32, 0.5)  # numbers stand at the right
    panels = [["above", "slabs"], ["beside", "shares"]]
    axes: dict[str, Axes] = figure.subplot_mosaic(panels, width_ratios=(1.5, 1))
    _draw_view(axes["above"], walk, _ABOVE, truth, place)
    axes["above"].set(ylabel="from above:\nx (m)", xlabel="")
    _draw_view(axes["beside"], walk, _BESIDE, truth, place)
    axes["beside"].set(ylabel="from the side:\n−y (m)")
    _draw_cell_slabs(axes["slabs"], walk, place)
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


def _draw_cell_slabs(ax: Axes, walk: VoxelWalk, place: int) -> None:
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


def walk_along_ray(
    directions: Tensor,
    pairs: RayVoxelPairs,
    occupied: OccupiedVoxels,
    true_distance: Tensor,
    grid: VoxelGrid,
) -> Any:
    """Choose a ray and how far to walk along it through its candidate voxels."""
    rays = sorted(set(pairs.ray.tolist()))

    def draw(ray: int, distance: float) -> None:
        mine = (pairs.ray == ray).nonzero().squeeze(1)
        cells = occupied.center[pairs.voxel[mine]]
        _, ax = plt.subplots(figsize=(8, 3.6))
        draw_walk(ax, directions[ray], cells, pairs.t_in[mine], pairs.t_out[mine],
                  grid.voxel_size, reached=distance, truth=float(true_distance[ray]))  # fmt: skip
        ax.set_title(f"ray {ray}, {distance:.2f} m from the camera")

    ray = widgets.SelectionSlider(options=rays, value=rays[len(rays) // 2], description="ray")
    farthest = float(pairs.t_out.max()) + 0.05
    return live_figure(draw, ray=ray, distance=("metres", farthest / 2, 0.0, farthest, 0.01))
