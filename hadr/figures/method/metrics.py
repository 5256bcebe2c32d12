"""Pictures of measurements: error maps with their scores, tolerances, frames as dots, averages.

Every length comes in metres, as everywhere in the library, and is drawn in centimetres.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from hadr.camera import BoolArray, FloatArray
from hadr.figures.panels import COLORS, show_error
from hadr.figures.rows import name_rows
from hadr.metrics import DepthMetrics, frame_metrics, mean_over_frames, pooled

_THRESHOLD_COLORS = {1.05: COLORS["hadr"], 1.10: COLORS["robot"], 1.25: COLORS["baseline"]}


def draw_scored_errors(
    axes: Sequence[Axes], errors: Mapping[str, FloatArray], scores: Mapping[str, DepthMetrics]
) -> None:
    """Draw error maps (H, W) side by side with RMSE and MAE below each, and one colour bar."""
    for ax, (name, error) in zip(axes, errors.items(), strict=True):
        image = show_error(ax, error, limit=0.03, colorbar=False)
        ax.set_title(name, fontsize=9.5)
        text = f"RMSE {scores[name].rmse_m * 100:.1f} cm\nMAE {scores[name].mae_m * 100:.1f} cm"
        ax.set_xlabel(text, fontsize=9.5)
    axes[0].figure.colorbar(image, ax=list(axes), shrink=0.7, pad=0.01, extend="both",
                            label="error (cm)")  # fmt: skip


def wide_window(mask: BoolArray) -> tuple[slice, slice]:
    """Rows and columns of a window of three to two, 1.7 times a mask's bounding box."""
    (top, left), (bottom, right) = np.argwhere(mask).min(axis=0), np.argwhere(mask).max(axis=0)
    half = 1.7 * max(bottom - top, (right - left) / 1.5) / 2
    row, column = (top + bottom) / 2, (left + right) / 2
    return (
        slice(max(int(row - half), 0), int(row + half)),
        slice(max(int(column - 1.5 * half), 0), int(column + 1.5 * half)),
    )


def draw_tolerances(
    ax: Axes,
    distance_m: npt.NDArray[np.float64],
    bands_m: Mapping[float, tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]],
    marks: Mapping[float, str],
) -> None:
    """Draw the errors, front and behind, that each threshold lets pass over the distance."""
    left, right = distance_m[0], distance_m[-1]
    for threshold, (front, behind) in sorted(bands_m.items(), reverse=True):
        color = _THRESHOLD_COLORS[threshold]
        ax.fill_between(distance_m, front * 100, behind * 100, color=color, alpha=0.3, lw=0)
        ax.plot(distance_m, behind * 100, distance_m, front * 100, color=color)
        style: dict[str, Any] = {"color": color, "va": "center", "weight": "bold"}
        ax.text(right + 0.01, behind[-1] * 100, f"δ{threshold:.2f}", **style)
    ax.axhspan(-1, 1, color="black", alpha=0.55, lw=0)  # what a gripper allows
    ax.text(right + 0.01, 0, "±1 cm", va="center", weight="bold")
    for mark, name in marks.items():
        ax.axvline(mark, color="black", lw=0.8, ls=":")
        ax.text(mark + 0.01, 27, name, size=9.5)
    ax.set(xlabel="distance of the glass (m)", ylabel="allowed error (cm)")
    ax.set(xlim=(left, right), ylim=(-26, 31))
    ax.text(left + 0.11, -22, "in front of the surface", size=9.5)
    ax.text(left + 0.11, 20, "behind the surface", size=9.5)


def draw_frame_dots(
    ax: Axes,
    frames: Mapping[str, Sequence[DepthMetrics]],
    averages: Mapping[str, Mapping[str, DepthMetrics]],
    rng: np.random.Generator,
) -> None:
    """Draw the MAE of each frame as a dot, one row a method, and the averages as bars."""
    for y, (name, listed) in enumerate(frames.items()):
        dots = 100 * np.array([m.mae_m for m in listed])
        height = y + rng.uniform(-0.12, 0.12, len(dots))
        ax.scatter(dots, height, s=16, color=COLORS["raw"], alpha=0.7)
        for (label, rows), color in zip(averages.items(), ("hadr", "baseline"), strict=False):
            bar: dict[str, Any] = {"lw": 2.5, "color": COLORS[color]}
            x = rows[name].mae_m * 100
            ax.plot([x, x], [y - 0.3, y + 0.3], label=label if y == 0 else None, **bar)
    name_rows(ax, list(frames))
    ax.set(xscale="log", xlabel="MAE (cm), one dot per frame")
    ax.set_xticks([1, 3, 10, 30, 100], ["1", "3", "10", "30", "100"])
    ax.minorticks_off()
    ax.legend(loc="lower right")


def draw_object_dots(
    ax: Axes, errors_m: Mapping[str, Mapping[str, npt.ArrayLike]], colors: Mapping[str, str]
) -> None:
    """Draw each frame's error as a dot, one column an object, with the mean as a bar."""
    shifts = np.linspace(-0.15, 0.15, len(errors_m)) if len(errors_m) > 1 else [0.0]
    for (name, columns), shift in zip(errors_m.items(), shifts, strict=True):
        color = COLORS[colors[name]]
        for x, errors in enumerate(columns.values()):
            dots = 100 * np.asarray(errors, dtype=float)
            label = name if x == 0 else None
            ax.scatter(np.full(len(dots), x + shift), dots, s=18, color=color, label=label)
            ends = [x + shift - 0.12, x + shift + 0.12]
            ax.plot(ends, [dots.mean()] * 2, color=color, lw=3)
    objects = list(next(iter(errors_m.values())))
    ax.set_xticks(range(len(objects)), [name.replace(" ", "\n") for name in objects])
    ax.set(ylabel="MAE (cm)", ylim=(0, None))
    ax.legend()


def both_averages(
    pixels: Sequence[int], errors_m: Sequence[float]
) -> tuple[DepthMetrics, DepthMetrics]:
    """Mean over frames and pooled metrics of frames of one error each (metres), all at 0.7 m."""
    frames = []
    for count, error in zip(pixels, errors_m, strict=True):
        truth = np.full((1, count), 0.7)
        frames.append((truth + error, truth, np.ones((1, count), dtype=bool)))
    return mean_over_frames(frame_metrics(*frame) for frame in frames), pooled(frames)


def averages_picture(
    sizes: Sequence[int], errors_m: Sequence[float], size: int, error: int
) -> Figure:
    """Draw good frames and a bad one of sizes[size] pixels and errors_m[error], both averages."""
    count, pixels, small = 9, 400, 0.01  # of the good frames; metres
    rows = [
        both_averages([pixels] * count + [n], [small] * count + [errors_m[error]]) for n in sizes
    ]
    lines = np.array([[100 * metrics.mae_m for metrics in row] for row in rows])  # cm
    figure: Figure = plt.figure(figsize=(9, 3.2), layout="none")
    figure.subplots_adjust(0.02, 0.16, 0.985, 0.9, 0.12)
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.1))
    _draw_frames(left, [pixels] * count + [sizes[size]], max(sizes))
    left.set_title(
        f"{count} frames: {small * 100:.0f} cm; one frame: {errors_m[error] * 100:.0f} cm"
    )
    _draw_averages(right, np.asarray(sizes), lines, size)
    right.set_ylim(0, 100 * errors_m[-1] * 1.02)
    return figure


def _draw_frames(ax: Axes, pixels: Sequence[int], most: int) -> None:
    """Objects as squares of as many pixels, the last of them in the hand's colour."""
    step = np.sqrt(most) + 4
    for k, count in enumerate(pixels):
        last, side = k == len(pixels) - 1, np.sqrt(count)
        x, y = (3.9 * step / 2, 0.0) if last else (k % 3 * step / 2, (k // 3 - 1) * step / 2)
        color = COLORS["hand" if last else "raw"]
        ax.add_patch(Rectangle((x - side / 2, y - side / 2), side, side, color=color))
    ax.set(xlim=(-0.5 * step, 2.6 * step), ylim=(-step, step), aspect="equal")
    ax.set_axis_off()


def _draw_averages(ax: Axes, sizes: FloatArray, lines: FloatArray, here: int) -> None:
    for column, (name, color) in enumerate(
        {"mean over frames": "hadr", "pooled": "baseline"}.items()
    ):
        value = lines[here, column]
        label = f"{name}: {value:.2f} cm"
        ax.plot(sizes, lines[:, column], color=COLORS[color], lw=1.2, alpha=0.6)
        ax.plot(sizes[here], value, "o", ms=9, color=COLORS[color], label=label)
    ax.set(xscale="log", xlabel="pixels of the bad frame's object", ylabel="MAE (cm)")
    ax.axvline(sizes[here], color="black", lw=0.8, ls=":", zorder=0)
    ax.set_xticks(sizes, [str(size) for size in sizes])
    ax.minorticks_off()
    ax.legend(loc="upper left")
