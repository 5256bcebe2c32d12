"""Pictures of hands and their features: bones in a parallel projection, axes, arrows of a voxel.

A view is a rotation ``screen_from_frame`` (3, 3) whose rows are the screen's right, up and toward
the viewer, written in the frame in which the hand is given. Hands are given in metres, and drawn in
centimetres.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import torch
from matplotlib.axes import Axes
from scipy.spatial.transform import Rotation

from hadr.camera import Array, project
from hadr.data.frame import Frame
from hadr.figures.method.voxels import cube_edges
from hadr.figures.panels import BONE_COLORS, COLORS, bare_axes, live_figure
from hadr.hand import BONES, FINGERS, absolute_hand_feature, check_keypoints
from hadr.models.hand.weighted_regression import SHARPNESS, JointMaps

#: Colours of the axes x, y and z.
AXIS_COLORS: dict[str, str] = {"x": "#D55E00", "y": "#009E73", "z": "#0072B2"}
#: The two forms of the absolute feature, in the colours that they keep throughout a chapter.
FRAME_COLORS: dict[str, str] = {
    "wrist frame": COLORS["hadr"],
    "wrist subtracted only": COLORS["baseline"],
}


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
    return np.asarray(100.0 * np.asarray(points, dtype=float) @ screen_from_frame[:2].T)


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


def draw_depth_hint(
    axes: Sequence[Axes], glass_m: npt.ArrayLike, hand_m: npt.ArrayLike, background_m: npt.ArrayLike
) -> None:
    """Hold the depth (N,) of each frame's glass against those of hand and background, metres.

    Backgrounds that are farther than the picture goes are drawn at its right border.
    """
    glass, hand, rest = (np.asarray(a, dtype=float) for a in (glass_m, hand_m, background_m))
    scatter, histogram = axes
    low, high = np.nanmin(glass) - 0.05, np.nanmax(hand) + 0.1
    scatter.plot([low, high], [low, high], color="black", lw=1, label="equal")
    label, border = "background beside the glass", high + 0.05
    drawn = np.minimum(rest, border)
    scatter.scatter(drawn, glass, color=COLORS["background"], s=12, alpha=0.5, label=label)
    scatter.scatter(hand, glass, color=COLORS["hand"], s=12, alpha=0.7, label="hand")
    scatter.set_xlabel("median depth of the surroundings (m)")
    scatter.set_ylabel("median depth of the glass (m)")
    scatter.set(xlim=(low, border + 0.02), ylim=(low, high + 0.15))
    scatter.legend(loc="upper left")
    gap = (glass - hand) * 100
    histogram.hist(gap[np.isfinite(gap)], bins=15, color=COLORS["hand"])
    histogram.axvline(0, color="black", lw=1)
    histogram.set(xlabel="glass minus hand (cm)", ylabel="frames")


def draw_votes(
    axes: Sequence[Axes], frame: Frame, surface: torch.Tensor, maps: JointMaps, joint: int, k: float
) -> None:
    """Draw a joint's heat on the hand, and what its pixels propose, see `joints_of_maps`.

    The surface (1, 3, H, W) and the reach k are in metres, the maps of a whole frame.
    """
    left, right = axes
    rows, columns = np.nonzero(frame.hand_mask)
    heat = maps.heat[0, joint].numpy()[rows, columns]
    points = surface[0].numpy()[:, rows, columns].T  # (n, 3)
    offset = maps.offset[0, joint].numpy()[:, rows, columns].T
    votes = project(points + k * (1 - heat[:, None]) * offset, frame.camera)
    weight = np.exp(SHARPNESS * (heat - heat.max()))
    weight /= weight.sum()
    u, v = frame.keypoints_uv[joint]
    shown = np.full(frame.hand_mask.shape, np.nan)
    shown[rows, columns] = heat
    for ax in axes:
        ax.imshow(frame.color, alpha=0.45)
        ax.plot(u, v, "o", ms=11, mfc="none", mec="black", mew=1.6, label="true")
        bare_axes(ax)
    image = left.imshow(shown, cmap="magma", vmin=0, vmax=1)
    (u0, v0), (u1, v1) = (getattr(frame.keypoints_uv, end)(axis=0) for end in ("min", "max"))
    left.set(xlim=(u0 - 25, u1 + 25), ylim=(v1 + 25, v0 - 25))
    bar = left.figure.colorbar(image, ax=left, shrink=0.8)
    bar.ax.set_title("heat", fontsize=9)
    near = np.flatnonzero(heat > 0.4)
    sizes = 6 + 120 * weight[near] / weight.max()
    us, vs = votes[near].T
    right.scatter(us, vs, s=sizes, color=COLORS["hand"], alpha=0.4, lw=0, label="votes")
    right.plot(*(weight @ votes), "x", ms=9, mew=2, color=COLORS["truth"], label="mean")
    right.set(xlim=(u - 45, u + 45), ylim=(v + 35, v - 35))
    right.legend(loc="upper right", fontsize=9)


def draw_wrist_frame(
    ax: Axes,
    keypoints: npt.ArrayLike,
    rotation: Array,
    names: str,
    screen_from_frame: Array,
    title: str,
) -> None:
    """Draw some axes of the wrist frame over the hand; with z among them, the palm's triangle."""
    points = check_keypoints(keypoints)
    from_wrist = points - points[0]
    show_bones(ax, from_wrist, screen_from_frame, alpha=0.55)
    if "z" in names:
        corners = from_wrist[[0, FINGERS["index"][0], FINGERS["little"][0]]]
        triangle = on_screen(corners, screen_from_frame)
        ax.fill(*triangle.T, color=COLORS["highlight"], alpha=0.6, zorder=2)
    for name in names:
        show_axis(ax, name, rotation[:, "xyz".index(name)], screen_from_frame)
    frame_hand_axes(ax, title)


def draw_feature_hands(
    axes: Sequence[Axes], hands: npt.ArrayLike, screen_from_frame: Array, label: str
) -> None:
    """Draw features as the hands (N, 21, 3) that they are, one a panel, all in one window."""
    points = np.asarray(hands, dtype=float)
    flat = on_screen(points, screen_from_frame).reshape(-1, 2)
    middle = (flat.min(axis=0) + flat.max(axis=0)) / 2
    half = np.maximum((flat.max(axis=0) - flat.min(axis=0)) / 2 + 1, (11, 10))
    for ax, hand in zip(axes, points, strict=True):
        show_bones(ax, hand, screen_from_frame, lw=2)
        frame_hand_axes(ax)
        ax.set_xlim(middle[0] - half[0], middle[0] + half[0])
        ax.set_ylim(middle[1] - half[1], middle[1] + half[1])
    axes[0].text(middle[0] - half[0] - 1, middle[1], label, rotation=90, ha="right", va="center")


def draw_both_frames(
    ax: Axes, x: npt.ArrayLike, values: Mapping[str, npt.ArrayLike], xlabel: str, ylabel: str
) -> None:
    """Draw one line for each form of the absolute feature."""
    for name, line in values.items():
        ax.plot(x, line, color=FRAME_COLORS[name], label=name, marker="o", ms=3.5)
    ax.set(xlabel=xlabel, ylabel=ylabel)
    ax.legend()


def draw_voxel_arrows(
    ax: Axes,
    keypoints: npt.ArrayLike,
    center: npt.ArrayLike,
    size_m: float,
    screen_from_frame: Array,
    title: str,
    *,
    color: str,
) -> None:
    """Draw a voxel, the hand, and the 21 arrows from the voxel's centre to the keypoints."""
    points = check_keypoints(keypoints)
    middle = np.asarray(center, dtype=float)
    for edge in on_screen(cube_edges(middle, size_m), screen_from_frame):
        ax.plot(*edge.T, color=color, lw=1.3)
    show_bones(ax, points, screen_from_frame, lw=2.5, alpha=0.45, joints=False)
    start = on_screen(middle, screen_from_frame)
    arrow = {"arrowstyle": "-|>", "color": color, "lw": 0.9, "shrinkA": 0, "shrinkB": 0}
    for end in on_screen(points, screen_from_frame):
        ax.annotate("", tuple(end), tuple(start), annotation_clip=False, zorder=5, arrowprops=arrow)
    ax.scatter(start[0], start[1], s=40, color="black", zorder=5)
    frame_hand_axes(ax, title)


def draw_wrist_depths(ax: Axes, errors_m: npt.ArrayLike, seen: npt.ArrayLike) -> None:
    """Draw the histogram of the depth read for the wrist minus the keypoint's depth."""
    errors_cm, visible = 100 * np.asarray(errors_m, dtype=float), np.asarray(seen, dtype=bool)
    bins = np.linspace(errors_cm.min(), errors_cm.max(), 24).tolist()
    ax.hist(errors_cm[visible], bins, color=COLORS["hand"], label="wrist seen")
    label = "wrist hidden or outside"
    ax.hist(errors_cm[~visible], bins, color=COLORS["raw"], label=label, alpha=0.8)
    ax.axvline(0, color="black", lw=1)
    ax.set(xlabel="depth read for the wrist minus keypoint (cm)", ylabel="frames")
    ax.legend()


def orbit_hand(keypoints: npt.ArrayLike) -> Any:
    """Turn the camera around a hand and watch both forms of the absolute hand feature."""
    points = check_keypoints(keypoints)
    center = points.mean(axis=0)

    def draw(sideways: float, upwards: float) -> None:
        turn = Rotation.from_euler("yx", [sideways, upwards], degrees=True).as_matrix()
        moved = (points - center) @ turn.T + center
        both = torch.from_numpy(np.stack([points, moved]))
        _, (view, bars) = plt.subplots(1, 2, figsize=(8.0, 3.4))
        show_bones(view, moved - center, np.diag([1.0, -1.0, -1.0]))  # y of the camera points down
        frame_hand_axes(view, "the hand, seen by the turned camera")
        view.set(xlim=(-12, 12), ylim=(-12, 12))
        for offset, rotation, label in ((-0.2, True, "wrist frame"), (0.2, False, "wrist only")):
            feature = absolute_hand_feature(both, wrist_rotation=rotation)
            change = (feature[1] - feature[0]).reshape(21, 3).norm(dim=1).numpy() * 100
            color = COLORS["hadr" if rotation else "baseline"]
            bars.bar(np.arange(21) + offset, change, 0.4, label=label, color=color)
        bars.set(xlabel="keypoint", ylabel="change of the feature (cm)", ylim=(0, 30))
        bars.legend()

    degrees = (0.0, -90.0, 90.0, 5.0)
    return live_figure(draw, sideways=("sideways (°)", *degrees), upwards=("upwards (°)", *degrees))
