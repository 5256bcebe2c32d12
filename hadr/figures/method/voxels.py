"""Figures of voxels in space for the book: cubes, a point cloud in them, a ray through them.

They use the camera frame turned for the eye: x to the right, z (away from the camera) into the
page, and -y up.
"""

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from hadr.figures.panels import COLORS


def cube_edges(center: npt.ArrayLike, size: float) -> npt.NDArray[np.float64]:
    """The twelve edges of an upright cube of so many metres, shape (12, 2, 3)."""
    signs = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    pairs = [(i, j) for i in range(8) for j in range(i) if np.abs(signs[i] - signs[j]).sum() == 1]
    return np.asarray(np.asarray(center, dtype=float) + size * signs[np.array(pairs)])


def upright(points: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Turn points (..., 3) of the camera frame for a 3D figure: columns x, z, -y."""
    p = np.asarray(points, dtype=float)
    return np.stack((p[..., 0], p[..., 2], -p[..., 1]), axis=-1)


def label_upright(ax: Any, low: npt.ArrayLike, high: npt.ArrayLike, zoom: float) -> None:
    """Label 3D axes of points turned by :func:`upright`, from corner low to high, camera frame."""
    corners = upright(np.stack((np.asarray(low, dtype=float), np.asarray(high, dtype=float))))
    first, last = corners.min(axis=0), corners.max(axis=0)
    ax.set(xlim=(first[0], last[0]), ylim=(first[1], last[1]), zlim=(first[2], last[2]))
    ax.set_box_aspect(last - first, zoom=zoom)
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
    width: float = 1.2,
    alpha: float = 0.7,
) -> None:
    """Draw the edges of cubes around centres (V, 3), camera frame, in axes turned by `upright`."""
    cubes = np.asarray(centers, dtype=float).reshape(-1, 3)
    lines = [edge for center in cubes for edge in upright(cube_edges(center, size))]
    ax.add_collection3d(Line3DCollection(lines, colors=color, linewidths=width, alpha=alpha))


def voxel_figure(
    points: npt.ArrayLike,
    colors: npt.ArrayLike,
    of_hand: npt.ArrayLike,
    centers: npt.ArrayLike,
    marked: npt.ArrayLike,
    size: float,
) -> Figure:
    """Draw a point cloud in its occupied voxels, the hand's and those marked in its colour."""
    cloud, middle = np.asarray(points, dtype=float), np.asarray(centers, dtype=float)
    strong, hand = np.asarray(marked, dtype=bool), np.asarray(of_hand, dtype=bool)
    fig: Figure = plt.figure(figsize=(8, 5.0))
    ax = fig.add_subplot(projection="3d", elev=24, azim=-72)
    ax.scatter(*upright(cloud)[::3].T, c=np.asarray(colors)[::3], s=2.5, depthshade=False)
    ax.scatter(*upright(cloud[hand]).T, color=COLORS["hand"], s=6, depthshade=False)
    draw_cubes(ax, middle[~strong], size, COLORS["raw"], width=0.5, alpha=0.35)
    draw_cubes(ax, middle[strong], size, COLORS["hand"], width=1.3)
    _draw_camera(ax)
    low = np.minimum(cloud.min(axis=0) - 0.1, 0)
    label_upright(ax, low, cloud.max(axis=0) + 0.1, 1.15)
    return fig


def ray_figure(
    direction: npt.ArrayLike,
    centers: npt.ArrayLike,
    t_in: npt.ArrayLike,
    size: float,
    clouds: Mapping[str, npt.ArrayLike],
) -> Figure:
    """Draw one ray through the cubes of its candidates, with named point clouds around it."""
    r, middle = np.asarray(direction, dtype=float), np.asarray(centers, dtype=float)
    enters = np.asarray(t_in, dtype=float)
    fig: Figure = plt.figure(figsize=(8, 4.4))
    ax = fig.add_subplot(projection="3d", elev=20, azim=-40)
    for name, points in clouds.items():
        ax.scatter(*upright(points)[::2].T, s=2, color=COLORS[name], alpha=0.6, label=name)
    draw_cubes(ax, middle, size)
    ax.plot(*upright(np.outer([0, enters.max() + 1.4 * size], r)).T, color=COLORS["ray"], lw=1.5)
    ax.scatter(*upright(np.outer(enters, r)).T, s=26, color=COLORS["ray"], depthshade=False)
    _draw_camera(ax)
    low, high = middle.min(axis=0) - 0.6 * size, middle.max(axis=0) + 0.6 * size
    label_upright(ax, np.minimum(low, 0), high, 1.12)
    ax.legend(loc="upper left", markerscale=4)
    return fig


def _draw_camera(ax: Any) -> None:
    ax.scatter(0, 0, 0, marker="s", s=30, color="black")
    ax.text(0, 0, -0.04, "camera", ha="center", va="top")
