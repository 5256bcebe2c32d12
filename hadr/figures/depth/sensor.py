"""Pictures of a depth camera: how it sees glass, and simulated errors beside real ones."""

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hadr.camera import BoolArray, FloatArray, window_around
from hadr.corruption import see_through
from hadr.data.frame import Frame
from hadr.figures.depth.corruption_examples import corruption_statistics
from hadr.figures.panels import COLORS, bare_axes, live_figure, show_color, show_depth, show_error
from hadr.figures.tables.results import markdown

#: What is compared: key in the results, title, factor, unit.
SENSOR_ROWS: tuple[tuple[str, str, float, str], ...] = (
    ("missing_inside", "missing inside the glass", 100.0, "%"),
    ("bias_median_m", "behind the glass's surface (median)", 100.0, "cm"),
    ("outside_median_abs_m", "error outside the glass (median)", 1000.0, "mm"),
)
_COLUMNS = {
    "real_table": ("real,\non a table", COLORS["truth"], "D"),
    "simulated_table": ("simulated,\non a table", COLORS["hadr"], "o"),
    "simulated_held": ("simulated,\nin a hand", COLORS["hand"], "o"),
    "analytic_held": ("analytic,\nin a hand", COLORS["baseline"], "s"),
}


def draw_sensor_comparison(columns: Mapping[str, Mapping[str, Any]]) -> Figure:
    """Draw the errors of ``results/sensor/comparison.json``, a point a frame, bars at medians."""
    groups = [name for name in _COLUMNS if name in columns]
    fig: Figure
    fig, axes = plt.subplots(1, len(SENSOR_ROWS), figsize=(9, 3.06))
    for ax, (key, title, factor, unit) in zip(axes, SENSOR_ROWS, strict=True):
        for place, name in enumerate(groups):
            _, color, marker = _COLUMNS[name]
            values = factor * _values(columns[name]["each"], key)
            half = 0.22 if len(values) > 2 else 0.0
            spread = np.linspace(-half, half, len(values))
            ax.plot(place + spread, values, marker, color=color, ms=5.5, alpha=0.6, mec="none")
            if len(values):
                middle = float(np.median(values))
                ax.hlines(middle, place - 0.34, place + 0.34, color=color, lw=2)
        short = [_COLUMNS[n][0].replace("on a ", "").replace("in a ", "") for n in groups]
        ax.set_xticks(range(len(groups)), short, fontsize=7)
        ax.set(title=title, ylabel=unit, xlim=(-0.6, len(groups) - 0.4))
        ax.title.set_fontsize(10)
        if unit == "cm":  # in a hand the wall may be metres away
            ax.set_yscale("symlog", linthresh=10.0)
            ax.set_ylim(bottom=min(ax.dataLim.y0 - 1.0, -1.0))
            ax.set_yticks([-5, 0, 5, 10, 50, 100, 400], ["-5", "0", "5", "10", "50", "100", "400"])
    return fig


def _values(each: Any, key: str) -> npt.NDArray[np.float64]:
    rows = each.values() if isinstance(each, Mapping) else each
    values = np.array([row.get(key) for row in rows], dtype=float)  # None becomes NaN
    return np.asarray(values[np.isfinite(values)])


def sensor_table(columns: Mapping[str, Mapping[str, Any]]) -> str:
    """The same numbers as a Markdown table: median, and lowest to highest frame."""
    groups = [name for name in _COLUMNS if name in columns]
    heads = [f"{_COLUMNS[name][0]}, {columns[name]['frames']} frames" for name in groups]
    lines = []
    for key, title, factor, unit in SENSOR_ROWS:
        lines.append([f"{title}, {unit}"])
        for name in groups:
            v = factor * _values(columns[name]["each"], key)
            few = f"; {v.size} frames" * (v.size != columns[name]["frames"])
            span = f"({v.min():.1f} to {v.max():.1f}{few})" if v.size else ""
            lines[-1].append(f"{np.median(v):.1f} {span}" if span else "-")
    return markdown(pd.DataFrame(lines, columns=["", *(h.replace("\n", " ") for h in heads)]))


def see_through_picture(frame: Frame, missing: float, background: float, seed: int) -> Figure:
    """Draw a glass whose depth is partly missing and of the rest partly the background's; 0..1."""
    if frame.background_depth is None:
        raise ValueError(f"frame {frame.stem} lacks the depth without the glass")
    truth, mask = frame.depth, frame.object_mask
    shares = {"missing_share": missing, "background_share": (1 - missing) * background}
    seen = see_through(truth, frame.background_depth, mask, np.random.default_rng(seed), **shares)
    found = corruption_statistics(seen, truth, mask)
    window = window_around(mask, 14)
    near = float(truth[mask].min()) - 0.03
    far = float(np.percentile(frame.background_depth[mask], 95)) + 0.1
    figure: Figure = plt.figure(figsize=(9, 3.4), layout="none")  # all alike, and drawn faster
    figure.subplots_adjust(0.01, 0.02, 0.94, 0.88, 0.14, 0.0)
    axes = figure.subplots(1, 3)
    show_color(axes[0], frame.color[window], "colour")
    title = f"{found.missing_share:.0%} of the glass missing"
    show_depth(axes[1], seen[window], title, vmin=near, vmax=far)
    error = np.where(mask & (seen > 0), seen - truth, np.nan)
    known = "none" if np.isnan(found.bias_m) else f"{100 * found.bias_m:+.1f} cm"
    show_error(axes[2], error[window], f"median error {known}", limit=0.2)
    return figure


_WALL_Y, _GLASS_Y = 1.0, 0.55
_DOT = np.array([0.12, _WALL_Y])
_IMAGERS = {"left": (-0.18, 0.035), "right": (0.18, -0.05)}  # x, and how far glass bends its ray


def draw_stereo_camera(ax: Axes, glass: bool, title: str) -> None:
    """Draw the camera from above, its projector's ray and what both imagers see of the dot."""
    ax.plot([-0.75, 0.75], [_WALL_Y, _WALL_Y], color=COLORS["background"], lw=7)
    ax.text(-0.74, _WALL_Y - 0.03, "wall", va="top")
    if glass:
        across = np.linspace(-0.45, 0.45, 60)
        side = _GLASS_Y + 0.9 * across**2
        ax.plot(across, side, color=COLORS["glass"], lw=9, alpha=0.55, solid_capstyle="butt")
        ax.text(0.5, float(side[-1]) - 0.06, "glass", va="center")
    ax.plot(*_ray(0.0, 0.0).T, color=COLORS["baseline"], lw=1.6)
    for name, (x, bend) in _IMAGERS.items():
        ax.plot(*_ray(x, bend if glass else 0.0).T, color=COLORS["hadr"], lw=1.6)
        ax.plot(x, 0, "s", ms=11, color=COLORS["truth"])
        ax.text(x, -0.06, name, ha="center", va="top")
    ax.plot(0, 0, "^", ms=11, color=COLORS["baseline"])
    ax.text(0, -0.06, "dots", ha="center", va="top", color="#9a6a00")
    ax.plot(*_DOT, "o", ms=7, color=COLORS["hand"], zorder=4)
    if glass:
        _draw_ghost(ax)
    ax.annotate("", (-0.18, -0.2), (0.18, -0.2), arrowprops={"arrowstyle": "<->", "lw": 1})
    ax.text(0, -0.22, "baseline b", ha="center", va="top")
    ax.set(xlim=(-0.8, 0.8), ylim=(-0.32, 1.1), aspect="equal")
    bare_axes(ax, title)


def _ray(x: float, bend: float) -> npt.NDArray[np.float64]:
    """From the camera to the dot, shifted sideways where it crosses the glass, shape (3, 2)."""
    start = np.array([x, 0.0])
    knee = start + _GLASS_Y / _WALL_Y * (_DOT - start) + np.array([bend, 0.0])
    return np.array([start, knee, _DOT])


def _draw_ghost(ax: Axes) -> None:
    """Where both imagers, taking their rays for straight, believe the dot to be."""
    (a, p, _), (b, q, _) = (_ray(x, bend) for x, bend in _IMAGERS.values())
    lengths = np.linalg.solve(np.stack([p - a, b - q], axis=1), b - a)
    ghost = a + lengths[0] * (p - a)
    for knee in (p, q):
        ax.plot(*np.array([knee, ghost]).T, "--", color=COLORS["hadr"], lw=1)
    ax.plot(*ghost, "x", ms=10, mew=2.5, color=COLORS["hand"], zorder=4)
    aside = (0.3, float(ghost[1]) + 0.16)  # between glass and wall
    line = {"arrowstyle": "-", "color": COLORS["hand"], "shrinkB": 6}
    ax.annotate("measured", ghost, aside, va="center", color=COLORS["hand"], arrowprops=line)


def corrupt_glass(depth: FloatArray, background_depth: FloatArray, mask: BoolArray) -> Any:
    """Mix missing and background depth inside a glass."""
    window = window_around(mask, 14)
    near, far = np.percentile(background_depth[window], 2), np.percentile(depth[window], 98)

    def draw(missing: float, background: float) -> None:
        shares = {"missing_share": missing, "background_share": (1 - missing) * background}
        seen = see_through(depth, background_depth, mask, np.random.default_rng(0), **shares)
        found = corruption_statistics(seen, depth, mask)
        _, ax = plt.subplots(figsize=(5.0, 3.6))
        title = f"{found.missing_share:.0%} missing, median error {found.bias_m * 100:+.1f} cm"
        show_depth(ax, seen[window], title, vmin=float(near) - 0.1, vmax=float(far))

    share = (0.5, 0.0, 1.0, 0.05)
    return live_figure(draw, missing=("missing", *share), background=("background", *share))
