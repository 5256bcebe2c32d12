"""Figures of rays and voxels for the book: cubes in 3D, a walk along one ray, a strip of rays.

The 3D figures use the camera frame turned for the eye: x to the right, z (away from the camera)
into the page, and -y up.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.colors import to_rgba
from matplotlib.patches import Rectangle
from matplotlib.ticker import MultipleLocator
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from hadr.plotting import COLORS
from hadr.ray_voxels import OccupiedVoxels, RayVoxelPairs

_CUBE = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_EDGES = [(i, j) for i in range(8) for j in range(i) if np.abs(_CUBE[i] - _CUBE[j]).sum() == 1]


def upright(points: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Turn points (..., 3) of the camera frame for a 3D figure: columns x, z, -y."""
    p = np.asarray(points, dtype=float)
    return np.stack((p[..., 0], p[..., 2], -p[..., 1]), axis=-1)


def label_upright(ax: Any, low: npt.ArrayLike, high: npt.ArrayLike) -> None:
    """Frame and label 3D axes that show points turned by :func:`upright`, with equal scales.

    Args:
        ax: 3D axes.
        low: Lower corner of what is to be seen, metres, camera frame, shape (3,).
        high: Upper corner, metres, camera frame, shape (3,).
    """
    corners = upright(np.stack((np.asarray(low, dtype=float), np.asarray(high, dtype=float))))
    first, last = corners.min(axis=0), corners.max(axis=0)
    ax.set(xlim=(first[0], last[0]), ylim=(first[1], last[1]), zlim=(first[2], last[2]))
    ax.set_box_aspect(last - first, zoom=1.15)
    ax.set_xlabel("x (m)", labelpad=6)
    ax.set_ylabel("z, away from the camera (m)", labelpad=12)
    ax.set_zlabel("up, −y (m)", labelpad=4)
    for axis in (ax.xaxis, ax.yaxis, ax.zaxis):
        axis.set_pane_color((1, 1, 1, 0))
        axis._axinfo["grid"]["color"] = (0.92, 0.92, 0.92, 1)
        axis.set_major_locator(MultipleLocator(0.5))


def draw_cubes(
    ax: Any,
    centers: npt.ArrayLike,
    size: float,
    color: str = COLORS["voxel"],
    *,
    width: float = 0.8,
    alpha: float = 0.7,
) -> None:
    """Draw the edges of cubes in 3D axes.

    Args:
        ax: 3D axes whose points are turned by :func:`upright`.
        centers: Centres in metres, camera frame, shape (V, 3).
        size: Side of a cube in metres.
        color: Colour of the edges.
        width: Width of the lines.
        alpha: Opacity of the lines.
    """
    corners = np.asarray(centers, dtype=float).reshape(-1, 1, 3) + _CUBE * size
    lines = [upright(cube[list(edge)]) for cube in corners for edge in _EDGES]
    ax.add_collection3d(Line3DCollection(lines, colors=color, linewidths=width, alpha=alpha))


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
    """Draw one ray and its candidate voxels from above: z to the right, x up.

    Args:
        ax: 2D axes.
        direction: Unit direction of the ray, camera frame, shape (3,).
        cells: Centres of the candidate voxels in metres, camera frame, shape (K, 3).
        t_in: Entering distances, metres along the ray, shape (K,).
        t_out: Leaving distances, metres along the ray, shape (K,).
        size: Side of a voxel in metres.
        reached: How far the walk has come, metres along the ray; the candidate in which it is
            then gets a stronger colour. None = the whole ray.
        truth: Distance of the true surface, metres along the ray, or None.
        numbers: Whether to write the distances beside the crossings.
    """
    d = np.asarray(direction, dtype=float)
    centers, starts, ends = (np.asarray(a, dtype=float) for a in (cells, t_in, t_out))
    far = float(ends.max()) + 0.12
    for k, center in enumerate(centers):
        here = reached is not None and starts[k] <= reached < ends[k]
        corner = (center[2] - size / 2, center[0] - size / 2)
        ax.add_patch(_square(corner, size, COLORS["voxel"], 0.55 if here else 0.16))
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
                ax.annotate(
                    f"{t:.3f}",
                    at,
                    at + sign * side * 0.055,
                    ha="center",
                    va="center",
                    fontsize=9,
                    bbox={"fc": "white", "ec": "none", "alpha": 0.8, "pad": 0.6},
                )
    if truth is not None:
        ax.plot(truth * d[2], truth * d[0], "*", ms=14, color=COLORS["truth"], zorder=5)
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_xlabel("z (m)")
    ax.set_ylabel("x (m)")


def _square(corner: tuple[float, float], size: float, color: str, alpha: float) -> Any:
    return Rectangle(corner, size, size, fc=to_rgba(color, alpha), ec=color, lw=1.2)


def draw_strip(
    ax: Any,
    pairs: RayVoxelPairs,
    occupied: OccupiedVoxels,
    true_distance: npt.ArrayLike,
    rays: npt.ArrayLike,
) -> None:
    """Draw some rays as rows: a bar for each candidate voxel, a star for the true surface.

    Bars of the same voxel have the same shade, so that one sees a voxel end and the next begin.

    Args:
        ax: 2D axes.
        pairs: The pairs of all rays.
        occupied: Their voxels.
        true_distance: Distance of each ray's true surface along the ray, metres, shape (R,).
        rays: Indices of the rays to draw, top to bottom.
    """
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
    ax.set_ylim(len(chosen) - 0.4, -0.6)
    ax.set_yticks(range(len(chosen)), [str(r) for r in chosen])
    ax.set_ylabel("ray")
    ax.set_xlabel("distance along the ray (m)")
