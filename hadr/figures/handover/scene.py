"""Pictures of the handover's scene in 3D axes: grippers as forks, glasses, the arm, a moving hand.

All coordinates are metres in one frame that the caller chooses.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from hadr.camera import Array
from hadr.figures.panels import COLORS
from hadr.hand import FINGERS, HandShape, forward_kinematics, keypoints_from_skeleton
from hadr.handover.grasping.grasps import forward_of
from hadr.handover.grasping.gripper import LARGEST_OPENING, fork
from hadr.synthesis.glass.shape import GlassObject, profile
from hadr.synthesis.glass.surfaces import Surface, vertex_normals
from hadr.synthesis.hand.skinning import posed_vertices
from hadr.synthesis.hand.template import hand_template

SKIN = np.array([0.95, 0.76, 0.64])
"""Colour of a hand in full light, sRGB."""
LIGHT = np.array([-0.3, -0.5, 0.8])
"""Toward the light, where z points up."""
SKIN_STEP = 0.006
"""Distance of the drawn skin's vertices, metres."""


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


def hand_skin(keypoints: Array) -> Surface:
    """The skin of a right hand with such keypoints (21, 3), metres, in their frame.

    Joint angles, pose and size are those with the smallest squared distance to the keypoints.
    """
    flat = keypoints_from_skeleton(forward_kinematics(np.zeros(20)).joints)
    palm = [joints[0] for joints in FINGERS.values()]
    turn, _ = Rotation.align_vectors(*(k[palm] - k[palm].mean(axis=0) for k in (keypoints, flat)))
    there = keypoints[palm].mean(axis=0) - turn.apply(flat[palm]).mean(axis=0)

    def off(found: Array) -> Array:
        posed = keypoints_from_skeleton(forward_kinematics(found[:20]).joints)
        turned = Rotation.from_rotvec(found[20:23]).apply(found[26] * posed)
        return np.asarray(turned + found[23:26] - keypoints).ravel()

    start = np.concatenate([np.full(20, 0.3), turn.as_rotvec(), there, [1.0]])
    found = least_squares(off, start, x_scale=[1.0] * 23 + [0.1] * 3 + [1.0]).x
    skin = posed_vertices(forward_kinematics(found[:20]), HandShape(), SKIN_STEP)
    vertices = Rotation.from_rotvec(found[20:23]).apply(found[26] * skin) + found[23:26]
    faces = hand_template(SKIN_STEP).faces
    return Surface(vertices, faces, vertex_normals(vertices, faces))


def show_hand(ax: Any, keypoints: Array, *, alpha: float = 1.0) -> None:
    """Draw the skin of a hand with such keypoints (21, 3), metres, and the keypoints as dots."""
    skin = hand_skin(keypoints)
    corners = skin.vertices[skin.faces]
    normals = skin.normals[skin.faces].mean(axis=1)
    light = 0.68 + 0.32 * np.clip(normals @ LIGHT / np.linalg.norm(LIGHT), -0.6, 1)
    colors = 1 - alpha * (1 - light[:, None] * SKIN)
    ax.add_collection3d(Poly3DCollection(corners, facecolors=colors, edgecolors=colors, lw=0.3))
    ax.scatter(*keypoints.T, s=5, color="black", depthshade=False, alpha=0.7 * alpha, lw=0)


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


@dataclass(frozen=True)
class Carried:
    """One way to carry a grasp along: base_from_tool at each moment, shape (t, 4, 4), metres."""

    name: str
    color: str
    poses: Array


@dataclass(frozen=True)
class HandFilm:
    """What happens: the hand, its glass and where the grasp belongs at each moment, base frame.

    Times are seconds, ascending, (t,), keypoints metres, (t, 21, 3), and poses (t, 4, 4).
    """

    times: Array
    keypoints: Array
    glass: GlassObject
    base_from_glass: Array
    true_poses: Array

    def off_mm(self, poses: Array) -> Array:
        """How far carried grippers are from where they belong, shape (t,), millimetres."""
        off = poses[:, :3, 3] - self.true_poses[:, :3, 3]
        return np.asarray(1000 * np.linalg.norm(off, axis=1))


def moment_picture(
    film: HandFilm, carried: Sequence[Carried], at: int, *, limit_mm: float
) -> Figure:
    """One picture of a film: the scene on the left, how far off the grasps are on the right."""
    fig: Figure = plt.figure(figsize=(7.4, 3.6), layout="none")
    scene = fig.add_axes((-0.03, -0.04, 0.56, 1.06), projection="3d")
    _show_moment(scene, film, carried, at)
    chart = fig.add_axes((0.60, 0.16, 0.38, 0.60))
    show_errors(chart, film, carried, limit_mm=limit_mm, at=at)
    return fig


def _show_moment(ax: Any, film: HandFilm, carried: Sequence[Carried], at: int) -> None:
    """Draw the scene at one moment, with the way that each gripper has come so far."""
    show_hand(ax, film.keypoints[at])
    show_glass(ax, film.glass, film.base_from_glass[at])
    for one in carried:
        ax.plot(*one.poses[: at + 1, :3, 3].T, color=one.color, lw=1.4, alpha=0.55)
        shown = forward_of(one.poses[at], -0.02)
        show_grippers(ax, [shown], [0.075], [one.color], lw=4)
    middle = (film.keypoints.min(axis=(0, 1)) + film.keypoints.max(axis=(0, 1))) / 2
    middle += np.array([-0.03, 0.0, 0.03])
    bare_axes_3d(ax, middle - 0.18, middle + 0.18, zoom=1.5)
    ax.view_init(40, -70)  # from the camera's side, the human on the right, no gripper edge-on


def show_errors(
    ax: Axes, film: HandFilm, carried: Sequence[Carried], *, limit_mm: float, at: int | None = None
) -> None:
    """Draw how far off each gripper is over time; what is still to come stays pale."""
    reached = len(film.times) - 1 if at is None else at
    for one in carried:
        off = film.off_mm(one.poses)
        ax.plot(film.times, off, color=one.color, lw=1.2, alpha=0.25)
        ax.plot(film.times[: reached + 1], off[: reached + 1], color=one.color, label=one.name)
        if off[reached] <= limit_mm:
            ax.plot(film.times[reached], off[reached], "o", color=one.color, clip_on=False, ms=5)
    ax.set(xlim=(film.times[0], film.times[-1]), ylim=(0, limit_mm))
    ax.set(xlabel="time (s)", ylabel="grasp off (mm)")
    ax.legend(loc="lower left", bbox_to_anchor=(-0.02, 1.0), borderaxespad=0.2, fontsize=9)
