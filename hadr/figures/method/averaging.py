"""How two ways of averaging answer one bad frame: the mean over frames, and all pixels pooled."""

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from hadr.camera import FloatArray
from hadr.figures.panels import COLORS
from hadr.metrics import DepthMetrics, frame_metrics, mean_over_frames, pooled


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
