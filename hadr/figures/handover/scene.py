"""Pictures of the handover's scene in 3D axes: grippers as forks, glasses, the arm.

All coordinates are metres in one frame that the caller chooses.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from hadr.figures.panels import BONE_COLORS, COLORS
from hadr.hand import BONES
from hadr.handover.grasping.gripper import LARGEST_OPENING, fork
from hadr.synthesis.glass.shape import GlassObject, profile

Array = npt.NDArray[np.float64]


def show_grippers(
    ax: Any,
    poses: npt.ArrayLike,
    widths: npt.ArrayLike,
    colors: Sequence[Any],
    *,
    lw: float = 2.0,
    alpha: float = 1.0,
) -> None:
    """Draw grippers as forks, each in its colour: frame_from_tool (n, 4, 4) and openings (n,)."""
    for pose, width, color in zip(np.asarray(poses), np.asarray(widths), colors, strict=True):
        lines = fork(float(width)) @ pose[:3, :3].T + pose[:3, 3]
        drawn = Line3DCollection(lines, colors=[color], lw=lw, alpha=alpha, capstyle="round")
        ax.add_collection3d(drawn)


def show_glass(
    ax: Any, glass: GlassObject, frame_from_glass: Array, *, alpha: float = 0.22
) -> None:
    """Draw the outside of a glass at a pose (4, 4), metres, with its rim and its foot as lines."""
    curve = profile(glass)
    outer = curve[: int(curve[:, 1].argmax()) + 1 : 2]  # (n, 2) radius, height
    angle = np.linspace(0.0, 2 * np.pi, 25)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)  # (25, 2)
    heights = np.broadcast_to(outer[:, None, 1:], (len(outer), 25, 1))
    rings = np.concatenate([outer[:, None, :1] * circle, heights], axis=2)
    rings = rings @ frame_from_glass[:3, :3].T + frame_from_glass[:3, 3]  # (n, 25, 3)
    faces = np.stack([rings[:-1, :-1], rings[:-1, 1:], rings[1:, 1:], rings[1:, :-1]], axis=2)
    surface = Poly3DCollection(
        faces.reshape(-1, 4, 3), lw=0, alpha=alpha, color=COLORS["glass"], zorder=2
    )
    ax.add_collection3d(surface)
    widest = int(outer[:, 0].argmax())
    foot = int(np.where(outer[:, 1] < 0.02, outer[:, 0], 0.0).argmax())
    for ring in (rings[-1], rings[widest], rings[foot]):
        ax.plot(*ring.T, color=COLORS["hadr"], lw=0.9, alpha=0.8)
    for side in (0, 6, 12, 18):
        ax.plot(*rings[:, side].T, color=COLORS["hadr"], lw=0.6, alpha=0.45)


def show_hand(ax: Any, keypoints: Array, *, alpha: float = 1.0) -> None:
    """Draw a hand's keypoints (21, 3), metres, with its flesh and a forearm."""
    wrist, middle = keypoints[0], keypoints[9]
    forearm = np.stack([wrist - 0.8 * (middle - wrist), wrist])
    palm = [(5, 9), (9, 13), (13, 17), (0, 1)]
    bones = [keypoints[list(bone)] for bone in (*BONES, *palm)]
    for line in (*bones, forearm):
        wide = 14.4 if line is forearm else 8.0
        ax.plot(*line.T, color="#f0c9a8", lw=wide, alpha=alpha, solid_capstyle="round")
    for bone, color in zip(BONES, BONE_COLORS, strict=True):
        ax.plot(*keypoints[list(bone)].T, color=color, lw=2.2, alpha=alpha)
    ax.scatter(*keypoints.T, s=10, color="black", depthshade=False, alpha=alpha)


def show_arm(
    ax: Any, outline: Array, tool: Array, thickness: float, color: str = COLORS["robot"]
) -> None:
    """Draw an arm: thick pale links with a coloured edge, joints as dots, the gripper as a fork."""
    foot = np.stack([outline[0], outline[0] + [0, 0, 0.025]])
    ax.plot(*foot.T, color=color, lw=2 * thickness, solid_capstyle="butt")
    body = np.stack([outline[-1], tool[:3, 3] - 0.1 * tool[:3, 2]])
    ax.plot(*body.T, color="#8a8f94", lw=0.8 * thickness, solid_capstyle="butt")
    show_grippers(ax, tool[None], [LARGEST_OPENING], ["#5b6066"], lw=0.32 * thickness)
    ax.plot(*outline.T, color=color, lw=thickness, solid_capstyle="round")
    ax.plot(*outline.T, color="#e4f3ee", lw=0.72 * thickness, solid_capstyle="round")
    joints = outline[[1, 3, 5, 6, 7]]
    size = (1.15 * thickness) ** 2
    ax.scatter(*joints.T, s=size, color="#e4f3ee", edgecolors=color, lw=1.2, zorder=2)
    ax.scatter(*joints.T, s=0.2 * size, color=color, lw=0, zorder=2)


def show_frame(ax: Any, pose: Array, length: float) -> None:
    """Draw a frame's axes: x red, y green, z blue."""
    for column, color in enumerate(("#CC3311", "#009E73", "#0072B2")):
        end = pose[:3, 3] + length * pose[:3, column]
        ax.plot(*np.stack([pose[:3, 3], end]).T, color=color, lw=1.8)


def show_table(ax: Any, lower: tuple[float, float], upper: tuple[float, float]) -> None:
    """Draw a table top at height 0 between two corners (x, y), metres."""
    (left, front), (right, back) = lower, upper
    corners = [(left, front, 0.0), (right, front, 0.0), (right, back, 0.0), (left, back, 0.0)]
    top = Poly3DCollection([corners], facecolor="#efe9df", edgecolor="#c9bfae", lw=0.8, zorder=-10)
    ax.add_collection3d(top)


def bare_axes_3d(ax: Any, lower: npt.ArrayLike, upper: npt.ArrayLike, *, zoom: float) -> None:
    """Equal scales between two corners (x, y, z) in metres, without panes, ticks or labels.

    Things then cover each other in the order in which they are drawn: draw the far ones first.
    """
    low, high = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    ax.set(**dict(zip(("xlim", "ylim", "zlim"), zip(low, high, strict=True), strict=True)))
    ax.set_box_aspect(high - low, zoom=zoom)
    ax.computed_zorder = False  # what is drawn later stands in front
    ax.set_axis_off()
