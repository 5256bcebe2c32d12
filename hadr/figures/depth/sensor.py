"""Pictures of the simulated depth camera, and its errors beside those of a real one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hadr.camera import window_around
from hadr.corruption import see_through
from hadr.data.frame import Frame
from hadr.figures.depth.corruption_statistics import corruption_statistics
from hadr.figures.panels import COLORS, show_color, show_depth, show_error
from hadr.figures.tables import markdown

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


def draw_sensor_comparison(
    columns: Mapping[str, Mapping[str, Any]], *, width: float = 9.0
) -> Figure:
    """Draw the errors of ``results/sensor/comparison.json``, a point a frame, bars at medians."""
    groups = [name for name in _COLUMNS if name in columns]
    if not groups:
        raise ValueError(f"need one of {', '.join(_COLUMNS)}, got {', '.join(columns) or 'none'}")
    fig: Figure
    fig, axes = plt.subplots(
        1, len(SENSOR_ROWS), figsize=(width, 0.34 * width), layout="constrained"
    )
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
        ax.set_xticks(range(len(groups)), short, fontsize=8)
        ax.set(title=title, ylabel=unit, xlim=(-0.6, len(groups) - 0.4))
        ax.title.set_fontsize(10)
        if unit == "cm":  # in a hand the wall may be metres away
            ax.set_yscale("symlog", linthresh=10.0)
            ax.set_ylim(bottom=min(ax.dataLim.y0 - 1.0, -1.0))
            ax.set_yticks([-5, 0, 5, 10, 50, 100, 400], ["-5", "0", "5", "10", "50", "100", "400"])
    return fig


def _values(each: Any, key: str) -> npt.NDArray[np.float64]:
    rows = each.values() if isinstance(each, Mapping) else each
    values = np.array([np.nan if row.get(key) is None else row[key] for row in rows], dtype=float)
    return np.asarray(values[np.isfinite(values)], dtype=float)


def sensor_table(columns: Mapping[str, Mapping[str, Any]]) -> str:
    """The same numbers as a Markdown table: median, and lowest to highest frame."""
    groups = [name for name in _COLUMNS if name in columns]
    heads = [
        f"{_COLUMNS[name][0]}, {columns[name]['frames']} frames".replace("\n", " ")
        for name in groups
    ]
    lines = []
    for key, title, factor, unit in SENSOR_ROWS:
        cells = []
        for name in groups:
            values = factor * _values(columns[name]["each"], key)
            text = "-"
            if len(values):
                text = f"{np.median(values):.1f} ({values.min():.1f} to {values.max():.1f})"
            cells.append(text)
        lines.append([f"{title}, {unit}", *cells])
    return markdown(pd.DataFrame(lines, columns=["", *heads]))


def show_infrared(ax: Axes, picture: npt.NDArray[np.uint8], title: str) -> None:
    """Show an infrared picture, shape (H, W) uint8, in its own grey."""
    ax.imshow(
        picture, cmap="gray", vmin=0, vmax=min(255.0, float(np.percentile(picture, 99.7)) + 1)
    )
    ax.set(title=title, xticks=[], yticks=[])
    ax.spines[:].set_visible(False)


def see_through_picture(frame: Frame, missing: float, background: float, seed: int = 0) -> Figure:
    """Draw a glass whose depth is partly missing and of the rest partly the background's; 0..1."""
    if frame.background_depth is None:
        raise ValueError(f"frame {frame.stem} lacks the depth without the glass")
    for name, share in (("missing", missing), ("background", background)):
        if not 0 <= share <= 1:
            raise ValueError(f"{name} must be a share in 0..1, got {share}")
    truth, mask = frame.depth, frame.object_mask
    seen = see_through(
        truth,
        frame.background_depth,
        mask,
        np.random.default_rng(seed),
        missing_share=missing,
        background_share=(1 - missing) * background,
    )
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
    show_error(axes[2], error[window], f"median error {known}", limit=0.4)
    return figure
