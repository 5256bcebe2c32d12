"""Pictures of a data set's frames: contact sheets, one frame with all its labels, histograms."""

from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hadr.camera import Array, FloatArray
from hadr.data.frame import Frame
from hadr.figures import panels
from hadr.figures.panels import COLORS, show_color
from hadr.figures.rows import name_rows
from hadr.synthesis.generation.statistics import FrameStatistics

TIGHT = {"w_pad": 0.015, "h_pad": 0.015, "hspace": 0.0, "wspace": 0.0}
"""A constrained layout for sheets of pictures."""


def contact_sheet(
    pictures: Sequence[npt.NDArray[np.uint8]], titles: Sequence[str] | None = None, *, columns: int
) -> Figure:
    """Lay pictures of one size out in a grid; an empty title leaves no word."""
    if not pictures:
        raise ValueError("a contact sheet needs pictures, got none")
    if titles is not None and len(titles) != len(pictures):
        raise ValueError(f"{len(pictures)} pictures, but {len(titles)} titles")
    rows = -(-len(pictures) // columns)
    high, wide = pictures[0].shape[:2]
    line = 0.2 if titles is not None else 0.0
    size = (9.0, rows * (9.0 / columns * high / wide + line))
    fig: Figure
    fig, axes = plt.subplots(rows, columns, figsize=size, squeeze=False)
    fig.set_layout_engine("constrained", **TIGHT)
    for k, ax in enumerate(axes.flat):
        if k >= len(pictures):
            ax.set_axis_off()
            continue
        show_color(ax, pictures[k]).set_interpolation("antialiased")
        if titles is not None:
            ax.set_title(titles[k], fontsize=8.5, pad=2)
    return fig


def draw_labels(frame: Frame, normals: FloatArray) -> Figure:
    """Draw a frame with all its labels; it must have background and sensor depth. Nine pictures."""
    if frame.raw_depth is None or frame.background_depth is None:
        raise ValueError(f"frame {frame.stem} lacks raw depth or the depth without the glass")
    fig: Figure
    fig, axes = plt.subplots(3, 3, figsize=(9, 6.12))
    fig.set_layout_engine("constrained", **TIGHT)
    show_color(axes[0, 0], frame.color, "colour")
    show_color(axes[0, 1], frame.color, "21 keypoints")
    panels.show_keypoints(axes[0, 1], frame.keypoints_uv, size=5)
    show_color(axes[0, 2], frame.color // 2, "object mask, hand mask")
    panels.show_mask(axes[0, 2], frame.object_mask, COLORS["glass"], 0.8)
    panels.show_mask(axes[0, 2], frame.hand_mask, COLORS["hand"], 0.7)
    held = frame.depth[frame.object_mask | frame.hand_mask]
    limits = {"vmin": float(held.min()), "vmax": float(np.percentile(held, 99)) + 0.15}
    titles = ("true depth", "depth without the glass", "sensor depth (stereo)")
    depths = (frame.depth, frame.background_depth, frame.raw_depth)
    for ax, depth, title in zip(axes[1], depths, titles, strict=True):
        image = panels.show_depth(ax, depth, title, colorbar=False, **limits)
    fig.colorbar(image, ax=axes[1].tolist(), shrink=0.9, pad=0.01, label="depth (m)", extend="max")
    error = np.where(frame.raw_depth > 0, frame.raw_depth - frame.depth, np.nan)
    show_color(axes[2, 0], normal_colors(normals), "normals")
    behind = np.where(frame.object_mask, frame.background_depth - frame.depth, np.nan)
    panels.show_error(axes[2, 1], behind, "without the glass minus true", limit=0.3, colorbar=False)
    image = panels.show_error(axes[2, 2], error, "sensor minus true", limit=0.3, colorbar=False)
    bar = fig.colorbar(image, ax=axes[2].tolist(), shrink=0.9, pad=0.01, extend="both")
    bar.set_label("difference (cm)")
    return fig


def normal_colors(normals: FloatArray) -> npt.NDArray[np.float64]:
    """Unit normals (H, W, 3) as colours: red to the right, green up, blue toward the viewer."""
    known = np.linalg.norm(normals, axis=-1, keepdims=True) > 0.5
    colors = (1.0 + np.asarray(normals, dtype=float) * [1.0, -1.0, -1.0]) / 2
    return np.where(known, np.clip(colors, 0.0, 1.0), 0.85)


def normals_from_depth(depth_points: FloatArray) -> Array:
    """Unit normals toward the viewer of an organised cloud (H, W, 3); 0 where one is missing."""
    p = np.asarray(depth_points, dtype=float)
    right, below = p[:-1, 1:] - p[:-1, :-1], p[1:, :-1] - p[:-1, :-1]
    n = np.cross(below, right)
    n /= np.maximum(np.linalg.norm(n, axis=-1, keepdims=True), 1e-20)
    return np.pad(np.nan_to_num(n), ((0, 1), (0, 1), (0, 0)))


def draw_statistics(statistics: FrameStatistics) -> Figure:
    """Draw six histograms of a data set's frames."""
    s = statistics
    shown = (
        (s.distance_m, "hand's distance (m)", "hand", 97),
        (100 * s.glass_share, "glass in the picture (%)", "glass", 97),
        (100 * s.visible_share, "of the glass is visible (%)", "glass", 97),
        (100 * s.missing_share, "sensor depth missing on glass (%)", "raw", 97),
        (100 * s.bias_m, "sensor depth behind the glass (cm)", "raw", 90),
        (1000 * s.hand_error_m, "sensor depth off on the hand (mm)", "hand", 97),
    )
    fig: Figure
    fig, axes = plt.subplots(2, 3, figsize=(9, 5.04))
    for ax, (values, label, color, upper) in zip(axes.flat, shown, strict=True):
        ax.set_xlabel(label)
        _histogram(ax, values, COLORS[color], upper)
    for ax in axes[:, 0]:
        ax.set_ylabel("frames")
    return fig


def _histogram(ax: Axes, values: Array, color: str, upper: float) -> None:
    known = values[np.isfinite(values)]
    if known.size == 0:
        ax.text(0.5, 0.5, "not stored", transform=ax.transAxes, ha="center")
        return
    low, high = np.percentile(known, (0, upper))  # the last bar holds the rest
    step = np.diff(np.unique(np.round(known, 9))).min(initial=np.inf)
    coarse = 0 < (high - low) / step < 60  # stored in steps: a bar for each
    bins = np.arange(low - step / 2, high + step, step) if coarse else np.linspace(low, high, 25)
    ax.hist(np.clip(known, low, high), bins.tolist(), color=color, alpha=0.85)
    middle = float(np.median(known))
    ax.axvline(middle, color="black", lw=1.2, ls="--")
    ax.margins(y=0.15)
    ax.text(middle, 1.0, f" {middle:.3g}", transform=ax.get_xaxis_transform(), va="top", fontsize=9)


def draw_angles(angles: FloatArray, limits: FloatArray, names: Sequence[str]) -> Figure:
    """Draw joint angles (N, A) over their limits (A, 2), both in radians, a named row an angle."""
    count = len(names)
    if angles.ndim != 2 or angles.shape[1] != count or limits.shape != (count, 2):
        raise ValueError(
            f"angles {angles.shape}, limits {limits.shape} and {count} names don't belong together"
        )
    fig: Figure
    fig, ax = plt.subplots(figsize=(9, 0.21 * count + 0.7))
    rows = np.arange(count)
    low, high = np.rad2deg(limits).T
    ax.barh(rows, high - low, left=low, height=0.78, color="#e3e3e3", label="allowed")
    degrees = np.rad2deg(angles)
    box: dict[str, Any] = {"orientation": "horizontal", "positions": rows, "widths": 0.7}
    parts = ax.violinplot(degrees, showextrema=False, **box)
    for body in parts["bodies"]:
        body.set(facecolor=COLORS["hadr"], alpha=0.75, edgecolor="none")
    quartiles = np.percentile(degrees, (25, 50, 75), axis=0)
    ax.hlines(rows, quartiles[0], quartiles[2], color="black", lw=2.2)
    ax.plot(quartiles[1], rows, "o", color="white", mec="black", ms=4)
    name_rows(ax, [name.replace("_", " ") for name in names])
    ax.set(xlabel="angle (degrees)")
    ax.tick_params(axis="y", labelsize=8.5)
    return fig
