"""The rescoring's preference as a coloured sphere: each point is a direction of approach.

A point of the unit sphere is the direction in which a gripper would move; its colour is the score.
Directions are those of the robot's base frame: x to the human, z up.
"""

from collections.abc import Callable, Sequence
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, Colormap
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from scipy.ndimage import distance_transform_edt
from scipy.spatial.transform import Rotation

from hadr.camera import Array
from hadr.figures.handover.scene import bare_axes_3d, show_glass, show_grippers, show_hand
from hadr.figures.method.hands import upright_view
from hadr.figures.panels import COLORS, live_figure
from hadr.handover.grasping.grasps import Grasps, forward_of
from hadr.handover.grasping.gripper import FINGER_LENGTH, STEM_LENGTH, fork
from hadr.handover.grasping.rescoring import (
    Directions,
    Weights,
    intended_score,
    literal_at_best_turn,
    rescore,
)
from hadr.simulation.world.scenes import HeldScene

Score = Callable[[Array], Array]

VIEW = (12.0, -52.0)
"""Elevation and azimuth in degrees from which human, down and up can all be seen."""
_REACH = 1.72  # half the side of the picture; the sphere's radius is 1
_GROWN = 4.2  # how many times larger the gripper is drawn, where the radius stands for a metre


def favourite(score: Score) -> Array:
    """The direction of approach with the highest score, to about a degree, shape (3,)."""
    latitude = np.linspace(-np.pi / 2, np.pi / 2, 181)
    lat, lon = np.meshgrid(latitude, np.linspace(-np.pi, np.pi, 361), indexing="ij")
    every = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)
    every = every.reshape(-1, 3)
    return np.asarray(every[int(np.argmax(score(every)))])


def score_colors(limit: float) -> tuple[Colormap, BoundaryNorm]:
    """Colour map and bands from minus to plus a limit; lightness alone tells them apart."""
    return mpl.colormaps["viridis"], BoundaryNorm(np.linspace(-limit, limit, 13), 256)


def show_score_sphere(
    ax: Axes,
    score: Score,
    directions: Directions,
    *,
    limit: float = 0.6,
    view: tuple[float, float] = VIEW,
    best: Array | None = None,
    frame: Array | None = None,
    pixels: int = 360,
) -> Array:
    """Draw a score of unit directions (n, 3), base frame, as a sphere; gives the favourite (3,)."""
    screen = upright_view(view[1], view[0])
    star = favourite(score) if best is None else np.asarray(best, dtype=np.float64)
    ax.imshow(
        _painted(score, screen, limit, pixels), extent=(-1, 1, -1, 1), interpolation="bilinear"
    )
    around = np.linspace(-np.pi, np.pi, 181)
    horizon = screen @ np.stack([np.cos(around), np.sin(around), np.zeros_like(around)])
    horizon = np.where(horizon[2] > 0, horizon, np.nan)
    ax.plot(horizon[0], horizon[1], color="white", lw=1.0, ls=(0, (4, 4)), alpha=0.8)
    if frame is not None:
        for column, name in enumerate("xyz"):
            _show_arrow(ax, screen @ frame[:, column], 1.56, "#6a6a6a", name, lw=1.4)
    _show_arrow(ax, screen @ directions.robot_to_human, 1.42, COLORS["hand"], "human")
    _show_arrow(ax, screen @ directions.up_to_down, 1.42, COLORS["truth"], "down")
    _show_standing_gripper(ax, screen @ star)
    ax.set(xlim=(-_REACH, _REACH), ylim=(-_REACH, _REACH), aspect="equal")
    ax.set_axis_off()
    return star


def _painted(score: Score, screen: Array, limit: float, pixels: int) -> Array:
    """The near half of the sphere as RGBA, shape (pixels, pixels, 4), top row first."""
    line = (np.arange(pixels) + 0.5) / pixels * 2 - 1
    x, y = np.meshgrid(line, -line)
    square = 1 - x**2 - y**2
    inside = square > 0
    z = np.sqrt(np.clip(square, 0.0, None))
    seen = np.stack([x, y, z], axis=-1)[inside]  # screen coordinates
    cmap, norm = score_colors(limit)
    image = np.zeros((pixels, pixels, 4))
    image[inside] = cmap(norm(score(seen @ screen)))
    image[..., :3] *= (0.80 + 0.20 * z)[..., None]
    image[..., 3] = np.clip((1 - np.hypot(x, y)) * pixels / 2, 0.0, 1.0) * inside
    return image


def _show_arrow(
    ax: Axes, along: Array, length: float, color: str, name: str, *, lw: float = 2.6
) -> None:
    """An arrow that stands on the sphere; along is in screen coordinates."""
    behind = bool(along[2] < -1e-9)
    head = {"arrowstyle": "-|>", "color": color, "lw": lw, "shrinkA": 0, "shrinkB": 0}
    edge = [withStroke(linewidth=3, foreground="white")]
    arrow = ax.annotate(
        "", tuple(length * along[:2]), tuple(along[:2]), arrowprops=head, zorder=-1 if behind else 5
    )
    if arrow.arrow_patch is not None:
        arrow.arrow_patch.set(path_effects=[withStroke(linewidth=lw + 2, foreground="white")])
    x, y = (length + 0.06) * along[:2]
    sideways = "left" if along[0] > 0.25 else "right" if along[0] < -0.25 else "center"
    upright = "center" if sideways != "center" else "top" if along[1] < 0 else "bottom"
    ax.text(
        x, y, name, color=color, ha=sideways, va=upright, fontsize=10, path_effects=edge, zorder=6
    )


def _show_standing_gripper(ax: Axes, along: Array) -> None:
    """A gripper whose stem stands on the sphere and whose fingers point outwards, and a dot."""
    side = np.cross(along, [0.0, 0.0, 1.0])
    if np.linalg.norm(side) < 1e-6:
        side = np.array([1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)  # lies in the picture, so that the fingers are seen apart
    turn = np.stack([side, np.cross(along, side), along], axis=1)
    lines = (_GROWN * fork(0.06) + [0, 0, 1.0 + _GROWN * (FINGER_LENGTH + STEM_LENGTH)]) @ turn.T
    layer = -1 if along[2] < -1e-9 else 7
    for color, width in (("white", 5.5), (COLORS["robot"], 3.2)):
        for line in lines:
            ax.plot(*line[:, :2].T, color=color, lw=width, solid_capstyle="round", zorder=layer)
    ax.plot(*along[:2, None], "o", color=COLORS["robot"], mec="white", mew=1.2, ms=7, zorder=layer)


def draw_regions(
    ax: Axes, steps: npt.ArrayLike, region: npt.NDArray[np.int64], names: Sequence[str]
) -> None:
    """Colour a square by which name holds where, with the names written into their regions."""
    along = np.asarray(steps, dtype=np.float64)
    shades = mpl.colormaps["tab20"](np.arange(len(names)) % 20)
    shades[:, :3] = 0.5 + 0.5 * shades[:, :3]
    half = (along[1] - along[0]) / 2
    low, high = along[0] - half, along[-1] + half
    ax.imshow(shades[region], origin="lower", extent=(low, high, low, high), aspect="auto")
    for index, name in enumerate(names):
        inside = region == index
        ax.contour(along, along, inside, levels=[0.5], colors="white", linewidths=1.2)
        if inside.mean() > 0.005:
            deep = distance_transform_edt(np.pad(inside, 1))[1:-1, 1:-1]  # away from the border
            row, column = np.unravel_index(int(deep.argmax()), inside.shape)
            ax.text(along[column], along[row], name, ha="center", va="center", fontsize=10)


def score_bar(
    fig: Figure,
    axes: Any = None,
    *,
    cax: Axes | None = None,
    limit: float = 0.6,
    shrink: float = 0.7,
    label: str = "score of the two wishes",
) -> Axes:
    """Draw the colour bar of the spheres beside axes, or into ``cax``; the two wishes alone."""
    cmap, norm = score_colors(limit)
    place: dict[str, Any] = {"cax": cax}
    if cax is None:
        place = {"ax": axes, "shrink": shrink, "pad": 0.02, "aspect": 18}
    ticks = np.linspace(-limit, limit, 5)
    bar = fig.colorbar(ScalarMappable(norm, cmap), label=label, ticks=ticks, **place)
    found: Axes = bar.ax
    return found


def show_choice(ax: Any, scene: HeldScene, grasps: Grasps, scores: npt.ArrayLike) -> None:
    """Draw a hand with its glass, 7 candidates shaded by their score, and the winner."""
    value = np.asarray(scores, dtype=np.float64)
    best = int(value.argmax())
    some = np.random.default_rng(4).permutation(len(value))[:7]
    shade = mpl.colormaps["Greys"](0.15 + 0.5 * (value - value.min()) / (np.ptp(value) or 1.0))
    show_hand(ax, scene.keypoints)
    show_glass(ax, scene.item, scene.base_from_object)
    poses = forward_of(grasps.poses, -0.02)
    show_grippers(ax, poses[some], grasps.widths[some], list(shade[some]), lw=1.3)
    show_grippers(ax, poses[[best]], grasps.widths[[best]], ["white"], lw=7)
    show_grippers(ax, poses[[best]], grasps.widths[[best]], [COLORS["robot"]], lw=4.5)
    middle = scene.base_from_object[:3, 3] + [0, 0, 0.13]
    bare_axes_3d(ax, middle - 0.19, middle + 0.19, zoom=1.55)
    ax.view_init(40, -70)  # else the chosen gripper stands edge-on


def candidate_choice(
    scene: HeldScene,
    grasps: Grasps,
    directions: Directions,
    weights: Weights,
    *,
    tilt_deg: float | None = None,
    limit: float = 0.6,
) -> Figure:
    """Draw a sphere of one form of the score, and the grasp that this form chooses, base frame.

    Without a tilt it is the intended form, with one the printed formula, its rotation written in a
    frame that is the base frame turned by so many degrees about its y axis: 0 is the base frame,
    90 a frame whose z axis points to the human. Colours go from minus to plus the limit.
    """
    frame: Array | None = None
    if tilt_deg is None:
        scores = rescore(grasps, directions, weights=weights)
        name = f"$w_{{r2h}}$ = {weights.robot_to_human:.1f}, $w_{{u2d}}$ = {weights.up_to_down:.1f}"
    else:
        frame = tilted_frame(tilt_deg)
        written, wishes = in_tilted_frame(grasps, directions, tilt_deg)
        scores = rescore(written, wishes, form="literal", weights=weights)
        name = f"frame turned by {tilt_deg:.0f}°"

    def wish(approach: Array) -> Array:
        if frame is None:
            return intended_score(np.zeros(len(approach)), approach, directions, weights)
        return literal_at_best_turn(approach @ frame, wishes, weights=weights)

    best = int(scores.argmax())
    a = grasps.axis("approach")[best]
    v, u = a @ directions.robot_to_human, a @ directions.up_to_down
    chosen = f"candidate {best}: a·v = {v:+.2f}, a·u = {u:+.2f}"
    fig: Figure = plt.figure(figsize=(7.4, 3.7), layout="none")
    left = fig.add_axes((0.0, 0.0, 0.47, 0.92))
    show_score_sphere(left, wish, directions, limit=limit, frame=frame, pixels=240)
    right = fig.add_axes((0.56, -0.02, 0.44, 0.94), projection="3d")
    show_choice(right, scene, grasps, scores)
    bar = score_bar(fig, cax=fig.add_axes((0.50, 0.16, 0.018, 0.62)), limit=limit, label="")
    bar.tick_params(labelsize=8.5)
    fig.text(0.51, 0.80, "score", ha="center", fontsize=9)
    for x, title in ((0.23, name), (0.78, chosen)):
        fig.text(x, 0.935, title, ha="center", va="center", fontsize=10.5)
    return fig


def tilted_frame(tilt_deg: float) -> Array:
    """base_from_tilted: the base frame turned about its y axis, shape (3, 3)."""
    return np.asarray(Rotation.from_euler("y", tilt_deg, degrees=True).as_matrix())


def in_tilted_frame(
    grasps: Grasps, directions: Directions, tilt_deg: float
) -> tuple[Grasps, Directions]:
    """The same grasps and wishes, written in the tilted frame."""
    tilted_from_base = np.eye(4)
    tilted_from_base[:3, :3] = tilted_frame(tilt_deg).T
    return (
        grasps.in_frame(tilted_from_base, "tilted"),
        directions.in_frame(tilted_from_base[:3, :3], "tilted"),
    )


def weigh_wishes(scene: HeldScene, grasps: Grasps, directions: Directions) -> Any:
    """Weigh the intended score's two wishes: its sphere and the grasp it chooses, base frame."""

    def draw(human: float, down: float) -> None:
        weights = Weights(robot_to_human=human, up_to_down=down)
        candidate_choice(scene, grasps, directions, weights, limit=1.2)

    ends = (0.0, 1.0, 0.1)
    return live_figure(draw, human=("w_r2h", 0.4, *ends), down=("w_u2d", 0.2, *ends))
