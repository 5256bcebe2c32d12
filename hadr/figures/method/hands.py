"""Pictures of hands: bones in a parallel projection, axes as arrows.

A view is a rotation ``screen_from_frame`` (3, 3) whose rows are the screen's right, up and toward
the viewer, written in the frame in which the hand is given. The axes are in centimetres.
"""

from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from scipy.spatial.transform import Rotation

from hadr.figures.panels import BONE_COLORS
from hadr.hand import BONES, check_keypoints

Array = npt.NDArray[np.float64]

#: Colours of the axes x, y and z.
AXIS_COLORS: dict[str, str] = {"x": "#D55E00", "y": "#009E73", "z": "#0072B2"}


def orbit_view(azimuth_deg: float, elevation_deg: float) -> Array:
    """Look at a frame from around it."""
    turn = Rotation.from_euler("xy", [elevation_deg, -azimuth_deg], degrees=True)
    return np.asarray(turn.as_matrix(), dtype=float)


def upright_view(azimuth_deg: float, elevation_deg: float) -> Array:
    """Look at a frame whose z points up, as `mpl_toolkits` has it: azimuth about z from x."""
    a, e = np.deg2rad([azimuth_deg, elevation_deg])
    toward = np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    return np.stack([right, np.cross(toward, right), toward])


def on_screen(points: npt.ArrayLike, screen_from_frame: Array) -> Array:
    """Project points in metres, shape (..., 3), to the screen's centimetres, shape (..., 2)."""
    projected: Array = 100.0 * np.asarray(points, dtype=float) @ screen_from_frame[:2].T
    return projected


def show_bones(
    ax: Axes,
    keypoints: npt.ArrayLike,
    screen_from_frame: Array,
    *,
    lw: float = 3.0,
    alpha: float = 1.0,
    joints: bool = True,
) -> None:
    """Draw the bones between keypoints (21, 3), metres, one colour a finger, far ones first.

    ``joints`` says whether the keypoints are marked, too.
    """
    points = check_keypoints(keypoints)
    flat, height = on_screen(points, screen_from_frame), points @ screen_from_frame[2]
    bones = sorted(
        zip(BONES, BONE_COLORS, strict=True), key=lambda bone: height[list(bone[0])].mean()
    )
    for level, ((parent, child), color) in enumerate(bones):
        line: dict[str, Any] = {"solid_capstyle": "round", "zorder": 3 + 0.01 * level}
        ax.plot(*flat[[parent, child]].T, color="white", lw=lw + 1.6, alpha=alpha, **line)
        ax.plot(*flat[[parent, child]].T, color=color, lw=lw, alpha=alpha, **line)
    if joints:
        ax.scatter(flat[:, 0], flat[:, 1], s=5 * lw, c="white", edgecolors="black", linewidths=0.7,
                   zorder=4, alpha=alpha)  # fmt: skip


def show_axis(ax: Axes, name: str, direction: Array, screen_from_frame: Array) -> None:
    """Draw the axis x, y or z as a named arrow of 6 cm from the origin along a unit vector (3,)."""
    ends = on_screen(np.outer([0.0, 0.06, 1.22 * 0.06], direction), screen_from_frame)
    color = AXIS_COLORS[name]
    arrow = {"arrowstyle": "-|>", "lw": 2.6, "color": color, "shrinkA": 0, "shrinkB": 0}
    ax.annotate("", ends[1], ends[0], arrowprops=arrow, annotation_clip=False, zorder=6)
    ax.update_datalim(ends)
    ax.autoscale_view()
    x, y = ends[2]
    ax.text(x, y, name, color=color, weight="bold", size=13, ha="center", va="center", zorder=6)


def frame_hand_axes(ax: Axes, title: str | None = None) -> None:
    """Give both directions one scale and hide the box, for pictures without a ruler."""
    ax.set_aspect("equal")
    ax.set_axis_off()
    if title is not None:
        ax.set_title(title)
