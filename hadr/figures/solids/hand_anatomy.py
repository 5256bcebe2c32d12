"""Drawings of the hand's skeleton with its names, of its joint angles, and of a recording."""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from hadr.camera import Array
from hadr.figures.panels import FINGER_COLORS, bare_axes
from hadr.figures.solids.studio import StudioView, studio_picture, studio_view
from hadr.figures.solids.turntable import HandOnGlass, bare_hand, held_glass
from hadr.hand import (
    ANGLE_LIMITS,
    ANGLE_NAMES,
    FINGERS,
    SKELETON_NAMES,
    SKELETON_PARENTS,
    HandShape,
    Skeleton,
    forward_kinematics,
)
from hadr.synthesis.recordings.recording import Recording

_PALM = SKELETON_NAMES.index("palm")
# Parents of the joints without the virtual one.
_TO_WRIST = [0 if parent == _PALM else parent for parent in SKELETON_PARENTS]
_SHORT = {"cmc": "CMC", "mcp": "MCP", "pip": "PIP", "dip": "DIP", "ip": "IP", "tip": "tip"}
#: One finger's angles stand for those of the other three.
SHOWN_ANGLES: tuple[str, ...] = tuple(
    name for name in ANGLE_NAMES if name.startswith(("thumb", "index"))
)
_STYLES = {
    "spread at the root": ":",
    "stretch at the root": "-",
    "middle joint": "--",
    "last joint": "-.",
}
_MOMENT = "0.35"


def open_hand() -> HandOnGlass:
    """An open hand with its fingers a little apart, so that names find room between them."""
    angles = np.zeros(20)
    for name, degrees in (("index", 7.0), ("ring", -5.0), ("little", -9.0)):
        angles[ANGLE_NAMES.index(f"{name}_mcp_spread")] = np.deg2rad(degrees)
    return bare_hand(forward_kinematics(angles), HandShape())


def draw_named_skeleton(hand: HandOnGlass, *, pixels: int = 640) -> Figure:
    """Draw the 22 joints, counted from 1 as in the paper, and the 21 keypoints, from 0."""
    view = studio_view(hand, radius=0.121, center=(0.014, 0.0, 0.088))
    picture = 255 - (255 - studio_picture(hand, view, pixels=pixels, paper=False)) // 2
    at = view.pixels_of(hand.joints, pixels)
    fig: Figure
    fig, axes = plt.subplots(1, 2, figsize=(9, 5.04))
    titles = ("22 joints of the animated skeleton", "21 keypoints of a detector")
    for ax, title in zip(axes, titles, strict=True):
        ax.imshow(picture, interpolation="bilinear")
        ax.set(xlim=(0.1 * pixels, pixels), ylim=(pixels, 0))
        bare_axes(ax, title)
    _bones(axes[0], at, SKELETON_PARENTS)
    _bones(axes[1], at, _TO_WRIST, _PALM)
    for i, name in enumerate(SKELETON_NAMES):
        _joint(axes[0], at[i], str(i + 1), name, virtual=i == _PALM)
        if i != _PALM:
            _joint(axes[1], at[i], str(i - (i > _PALM)), name)
        _name(axes[0], at[i], name, pixels)
    for finger, indices in FINGERS.items():
        tip, before = at[indices[3] + 1], at[indices[2] + 1]
        place = tip + 0.062 * pixels * (tip - before) / np.linalg.norm(tip - before)
        for ax in axes:
            ax.text(place[0], place[1], finger, color=FINGER_COLORS[finger], ha="center",
                    va="center", weight="bold", fontsize=9)  # fmt: skip
    return fig


def draw_poses(skeletons: Mapping[str, Skeleton], *, pixels: int = 280) -> Figure:
    """Draw named right hands with their bones, into the palm above, from the thumb's side below."""
    fig: Figure
    fig, axes = plt.subplots(2, len(skeletons), figsize=(9, 4.68), squeeze=False)
    for (name, skeleton), column in zip(skeletons.items(), axes.T, strict=True):
        hand = bare_hand(skeleton, HandShape())
        for ax, azimuth in zip(column, (-65.0, 0.0), strict=True):
            view = studio_view(hand, azimuth_deg=azimuth, radius=0.125, center=(0.0, -0.01, 0.075))
            picture = studio_picture(hand, view, pixels=pixels, paper=False)
            ax.imshow(255 - (255 - picture) // 4 * 3, interpolation="bilinear")
            _bones(ax, view.pixels_of(hand.joints, pixels), _TO_WRIST, _PALM)
            bare_axes(ax)
        column[0].set_title(name)
    return fig


def _finger_color(name: str) -> str:
    return FINGER_COLORS.get(name.split("_")[0], "#404040")


def _bones(ax: Axes, at: Array, parents: Sequence[int], left_out: int = -1) -> None:
    for i, parent in enumerate(parents):
        if parent < 0 or i == left_out:
            continue
        color = _finger_color(SKELETON_NAMES[i])
        ax.plot(*at[[parent, i]].T, color="white", lw=5, solid_capstyle="round", zorder=2)
        ax.plot(*at[[parent, i]].T, color=color, lw=2.6, solid_capstyle="round", zorder=3)


def _joint(ax: Axes, at: Array, number: str, name: str, *, virtual: bool = False) -> None:
    color = "white" if virtual else _finger_color(name)
    marker, edge, width = ("D", "black", 1.6) if virtual else ("o", "white", 1.0)
    ax.scatter(at[0], at[1], s=190, c=color, marker=marker, edgecolors=edge, linewidths=width,
               zorder=4)  # fmt: skip
    ink = "black" if virtual or name.startswith("index") else "white"
    ax.text(at[0], at[1], number, color=ink, ha="center", va="center_baseline", fontsize=7.5,
            weight="bold", zorder=5)  # fmt: skip


def _name(ax: Axes, at: Array, name: str, pixels: int) -> None:
    label = {"wrist": "wrist", "palm": "palm: the virtual point"}.get(name)
    text = label or _SHORT[name.split("_")[1]]
    side = -1 if name.startswith(("thumb", "palm")) else 1
    drop = 0.022 * pixels if name.endswith("mcp") else 0.0
    place = at + np.array([side * 0.032 * pixels, drop])
    if name.startswith("thumb"):
        place = at + np.array([0.012, 0.042]) * pixels
    box = {"facecolor": "white", "alpha": 0.7 if label else 0.45, "edgecolor": "none", "pad": 0.6}
    ax.text(place[0], place[1], text, fontsize=7.5, va="center", ha="left" if side > 0 else "right",
            zorder=6, bbox=box)  # fmt: skip


def draw_angle_sheet(*, pixels: int = 190) -> Figure:
    """Draw the real hand at both ends of each angle's range: the thumb's four, the index's four."""
    fig: Figure
    fig, axes = plt.subplots(3, len(SHOWN_ANGLES), figsize=(9, 3.96))
    fig.set_layout_engine("constrained", w_pad=0.01, h_pad=0.01, hspace=0.0, wspace=0.0)
    hands: dict[bytes, HandOnGlass] = {}
    for column, name in enumerate(SHOWN_ANGLES):
        number = ANGLE_NAMES.index(name)
        finger, joint, kind = name.split("_")
        for row, degrees in enumerate((*np.rad2deg(ANGLE_LIMITS[number])[::-1], 0.0)):
            ax = axes[(0, 2, 1)[row], column]
            _bent_hand(ax, hands, number, float(degrees), pixels)
            ax.text(0.5, 0.02, f"{degrees:+.0f}°" if degrees else "0°", transform=ax.transAxes,
                    ha="center", va="bottom", fontsize=8.5)  # fmt: skip
        axes[0, column].set_title(f"{finger} {_SHORT[joint]}\n{kind}", fontsize=9.5)
    for row, label in enumerate(("upper limit", "rest", "lower limit")):
        axes[row, 0].set_ylabel(label, fontsize=9.5)
    return fig


def _bent_hand(
    ax: Axes, hands: dict[bytes, HandOnGlass], number: int, degrees: float, pixels: int
) -> None:
    name = ANGLE_NAMES[number]
    finger, _, kind = name.split("_")
    angles = np.zeros(20)
    angles[number] = np.deg2rad(degrees)
    if angles.tobytes() not in hands:
        hands[angles.tobytes()] = bare_hand(forward_kinematics(angles), HandShape())
    hand = hands[angles.tobytes()]
    azimuth = -90.0 if kind == "spread" else (-55.0 if finger == "thumb" else -12.0)
    view = studio_view(hand, azimuth_deg=azimuth, radius=0.104, center=(0.012, 0.0, 0.078))
    ax.imshow(studio_picture(hand, view, pixels=pixels, paper=False), interpolation="bilinear")
    chain = view.pixels_of(hand.joints[[i + 1 for i in FINGERS[finger]]], pixels)
    ax.plot(*chain.T, "o-", color=FINGER_COLORS[finger], lw=1.6, ms=2.8, mec="white", mew=0.4)
    ax.set(xlim=(0, pixels), ylim=(pixels, 0))
    bare_axes(ax)


def draw_recording(recording: Recording, *, pixels: int = 300) -> Figure:
    """Draw a recording: the hand at its beginning, middle and end over the curves of its angles."""
    rows = [0, len(recording.time) // 2, len(recording.time) - 1]
    fig: Figure = plt.figure(figsize=(9, 6.21), layout="constrained")
    parts: Any = fig.subfigures(2, 1, height_ratios=(1.25, 1))
    above, below = parts
    view: StudioView | None = None
    for ax, row in zip(above.subplots(1, 3), rows, strict=True):
        scene = held_glass(recording.at(row))
        view = view or studio_view(scene)
        ax.imshow(studio_picture(scene, view, pixels=pixels), interpolation="bilinear")
        bare_axes(ax, f"{recording.time[row]:.2f} s")
    panels = below.subplots(1, 5, sharey=True)
    for finger, ax in zip(FINGERS, panels, strict=True):
        _draw_finger(ax, recording, finger)
        for row in rows:
            ax.axvline(recording.time[row], color=_MOMENT, lw=0.8, ls=(0, (4, 4)), zorder=0)
    panels[0].set_ylabel("angle (degrees)")
    handles = [Line2D([], [], color="0.25", ls=ls, label=name) for name, ls in _STYLES.items()]
    below.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=8.5)
    return fig


def _draw_finger(ax: Axes, recording: Recording, finger: str) -> None:
    names = [name for name in ANGLE_NAMES if name.startswith(finger)]
    for name, style in zip(names, _STYLES.values(), strict=True):
        degrees = np.rad2deg(recording.angles[:, ANGLE_NAMES.index(name)])
        ax.plot(recording.time, degrees, ls=style, color=FINGER_COLORS[finger], lw=1.6)
    ax.set_title(finger, color=FINGER_COLORS[finger], fontsize=10)
    ax.set_xlabel("time (s)")
