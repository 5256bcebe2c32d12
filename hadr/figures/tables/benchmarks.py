"""What the benchmarks measured, as Markdown and pictures: learning by heart, ablation, costs."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from hadr.figures.panels import COLORS
from hadr.figures.rows import Dots, draw_bar_rows, draw_dot_rows
from hadr.figures.tables.results import Row, markdown

_PART_COLORS = ("hadr", "glass", "voxel", "highlight", "robot", "baseline", "hand", "raw")
_PAIRING = {"walk": ("walk through the grid", "hadr"), "dense": ("all rays x all voxels", "hand")}


def by_heart_table(rows: Sequence[Row]) -> str:
    """List what each network reaches on four frames that it learns by heart."""
    lines = []
    for row in rows:
        metres = row["counts"].endswith("_m")
        value, goal = (
            f"{1000 * number:.1f} mm" if metres else f"{1 - number:.3f} IoU"
            for number in (row["reached"], row["goal"])
        )  # fmt: skip
        verdict = "yes" if row["is_reached"] else "**no**"
        steps = str(row["steps"] + row.get("frozen_steps", 0))
        lines.append([row["network"], steps, value, goal, verdict, _within_reach(row)])
    head = ["network", "steps", "after them", "goal", "reached", "why not"]
    return markdown(pd.DataFrame(lines, columns=head), "lrrrll")


def _within_reach(row: Row) -> str:
    """Why a network misses its goal: the most that it can express."""
    if row["is_reached"]:
        return ""
    if "mae_where_true_voxel_m" in row:
        lost = 100 - 100 * row["share_with_true_voxel"]
        rest = f"on the others {1000 * row['mae_where_true_voxel_m']:.2f} mm"
        return f"the true voxel of {lost:.1f} % of its rays is no candidate; {rest}"
    if (least := row.get("least_mae_of_its_grid_m")) is None:
        return ""
    return f"an image of a quarter of the size, enlarged: no less than {1000 * least:.1f} mm"


def draw_ablation(ax: Axes, rows: Sequence[Row]) -> None:
    """Draw the RMSE without each part minus that of the full network, which is the first row."""
    full, others = rows[0], rows[1:]
    pairs = [row["against_full"] for row in others]
    gaps = 100 * np.array([pair["mean_difference_m"] for pair in pairs])
    doubt = 100 * np.array([pair["standard_error_m"] for pair in pairs])
    worth, harm = gaps > 2 * doubt, gaps < -2 * doubt
    colors = [COLORS[c] for c in np.where(worth, "robot", np.where(harm, "hand", "raw"))]
    ends = np.stack([gaps - doubt, gaps + doubt], axis=1)
    names = [row["network"] for row in others]
    draw_dot_rows(ax, names, [Dots(gaps, colors, ends=ends, text="{:+.2f}")])
    ax.axvline(0, color=COLORS["truth"], lw=1)
    ax.margins(x=0.15)
    ax.set_xlabel(f"RMSE (cm) more than that of the full network, {100 * full['rmse_m']:.2f} cm")


def draw_parts_of_time(ax: Axes, restoration: Row) -> None:
    """Draw where the processor time of one frame goes, a bar for each preset."""
    presets = restoration["parts_cpu_ms"]
    names = dict.fromkeys(name for parts in presets.values() for name in parts if name != "all")
    parts = {name: [times.get(name, 0) for times in presets.values()] for name in names}
    colors = [COLORS[color] for color in _PART_COLORS]
    draw_bar_rows(ax, [f"HADR, {preset}" for preset in presets], parts, colors)
    ax.set_xlabel("processor time of one frame (ms)")


def draw_pairing(ax: Axes, pairing: Row) -> None:
    """Draw the time of pairing rays with voxels over the frames of a batch."""
    batches = [row["frames"] for row in pairing["by_batch"]]
    for name, (label, color) in _PAIRING.items():
        rows = [row for row in pairing["by_batch"] if name in row]
        ax.plot([row["frames"] for row in rows], [row[name]["wall_median_ms"] for row in rows],
                "o-", color=COLORS[color], label=label)  # fmt: skip
    ax.set(xscale="log", yscale="log", xlabel="frames in the batch", ylabel="time (ms)")
    ax.set_xticks(batches, [str(number) for number in batches])
    ax.minorticks_off()
    ax.legend(loc="upper left")


def draw_frame_costs(ax: Axes, rows: Sequence[Row]) -> None:
    """Draw the processor time of one generated frame by its parts, a bar for each engine and size.

    `rows` are those of `results/generation/benchmark.json`.
    """
    title = "{engine}, {width}x{height} ({kilobytes_a_frame:.0f} kB)"
    seconds = [row["cpu_seconds_by_part"] for row in rows]
    parts = {part: [of[part] for of in seconds] for part in seconds[0]}
    colors = [COLORS[color] for color in _PART_COLORS]
    draw_bar_rows(ax, [title.format(**row) for row in rows], parts, colors, edges="white")
    for place, row in enumerate(rows):
        whole = row["cpu_seconds_a_frame"]
        ax.text(whole + 0.15, place, f"{whole:.1f} s", va="center", fontsize=9)
    ax.set_xlabel("processor time of one frame (s)")
    ax.legend(loc="upper right", ncols=3)
