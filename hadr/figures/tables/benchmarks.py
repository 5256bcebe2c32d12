"""What the benchmarks measured, as Markdown and pictures: learning by heart, ablation, speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.axes import Axes

from hadr.figures import COLORS
from hadr.records.markdown import markdown_table

Record = Mapping[str, Any]

_PART_COLORS = ("hadr", "glass", "voxel", "highlight", "robot", "baseline", "hand", "raw")
_PAIRING = {"walk": ("walk through the grid", "hadr"), "dense": ("all rays x all voxels", "hand")}


def by_heart_table(rows: Sequence[Record]) -> str:
    """List what each network reaches on four frames that it learns by heart.

    Args:
        rows: Rows of `results/training/overfit.json`.

    Returns:
        Markdown.
    """
    lines = []
    for row in rows:
        value, goal = (_by_heart(row["counts"], row[key]) for key in ("reached", "goal"))
        verdict = "yes" if row["is_reached"] else "**no**"
        steps = str(row["steps"] + row.get("frozen_steps", 0))
        lines.append([row["network"], steps, value, goal, verdict, _within_reach(row)])
    head = ["network", "steps", "after them", "goal", "reached", "the most that it can express"]
    return markdown_table(head, lines, "lrrrll")


def _within_reach(row: Record) -> str:
    """What a network that misses its goal can express at all."""
    if row["is_reached"]:
        return ""
    if "mae_where_true_voxel_m" in row:
        share = 100 * row["share_with_true_voxel"]
        reached = 1000 * row["mae_where_true_voxel_m"]
        return f"{share:.1f} % of its rays, those whose true voxel is a candidate: {reached:.2f} mm"
    if "least_mae_of_its_grid_m" in row:
        least = 1000 * row["least_mae_of_its_grid_m"]
        return f"an image of a quarter of the size, enlarged: no less than {least:.1f} mm"
    return ""


def _by_heart(counts: str, value: float) -> str:
    if counts.endswith("_m"):
        return f"{1000 * value:.1f} mm"
    return f"{1 - value:.3f} IoU"


def draw_ablation(ax: Axes, rows: Sequence[Record]) -> None:
    """Draw how much each change is worth: the RMSE without it, minus that of the full network.

    Args:
        ax: Ordinary 2D axes.
        rows: Rows of `results/mini/hadr-plus-ablation.json`, the full network first.
    """
    full, others = rows[0], list(rows[1:])[::-1]
    for place, row in enumerate(others):
        gap = 100 * row["against_full"]["mean_difference_m"]
        doubt = 100 * row["against_full"]["standard_error_m"]
        color = COLORS["robot"] if gap > 2 * doubt else COLORS["raw"]
        ax.errorbar(gap, place, xerr=doubt, color=color, marker="o", ms=7, capsize=2)
        side = 1 if gap >= 0 else -1
        ax.annotate(f"{gap:+.2f}", (gap + side * doubt, place), xytext=(6 * side, 0), va="center",
                    ha="left" if side > 0 else "right", textcoords="offset points",
                    fontsize=9)  # fmt: skip
    ax.axvline(0, color=COLORS["truth"], lw=1)
    ax.margins(x=0.15)
    ax.set(
        yticks=range(len(others)),
        yticklabels=[row["network"] for row in others],
        ylim=(-0.7, len(others) - 0.3),
        xlabel=f"RMSE (cm) more than that of the full network, {100 * full['rmse_m']:.2f} cm",
    )


def speed_table(restoration: Record, perception: Record) -> str:
    """List the time of one 224x224 frame: HADR against a Swin-T, and the whole perception.

    Args:
        restoration: Content of `results/speed/restoration.json`.
        perception: Content of `results/speed/perception.json`.

    Returns:
        Markdown; "-" where a form was not measured.
    """
    times, ratios = restoration["times"], restoration["against_swin"]["wall_median_ms"]
    cost = restoration.get("accuracy", {}).get("change_percent", {})
    rates = perception["frames_per_second"]
    forms = list(dict.fromkeys(t.split(", ", 1)[1] for t in times if ", " in t))
    head = [
        "form", "`mini` (ms)", "`paper` (ms)", "`paper` against Swin-T",
        "RMSE of the bundled HADR", "whole perception, `mini` (frames a second)",
    ]  # fmt: skip
    swin = f"{times['Swin-T']['wall_median_ms']:.0f}"
    lines = [["*plain Swin-T*", "-", swin, "1.00", "-", "-"]]
    for form in forms:
        cells = [f"{times[f'{size}, {form}']['wall_median_ms']:.0f}" for size in ("mini", "paper")]
        rate = rates.get("as it is" if form == "all rays" else form)
        change = "-" if form == "all rays" else f"{cost[form]:+.1f} %"
        ratio = ratios[f"paper, {form}"]
        frames = f"{rate['wall_median']:.1f}" if rate else "-"
        lines.append([form, *cells, f"{ratio:.2f}", change, frames])
    return markdown_table(head, lines)


def draw_parts_of_time(ax: Axes, restoration: Record) -> None:
    """Draw where the processor time of one frame goes, a bar for each preset.

    Args:
        ax: Ordinary 2D axes.
        restoration: Content of `results/speed/restoration.json`.
    """
    bars = {
        name: {part: ms for part, ms in parts.items() if part != "all"}
        for name, parts in restoration["parts_cpu_ms"].items()
    }
    parts = list(dict.fromkeys(part for bar in bars.values() for part in bar))
    for part, color in zip(parts, _PART_COLORS, strict=False):
        for place, bar in enumerate(bars.values()):
            left = sum(bar.get(earlier, 0) for earlier in parts[: parts.index(part)])
            ax.barh(place, bar.get(part, 0), left=left, color=COLORS[color],
                    label=part if place == 0 else None)  # fmt: skip
    ax.set(
        yticks=range(len(bars)),
        yticklabels=[f"HADR, {name}" for name in bars],
        xlabel="processor time of one frame (ms)",
    )


def draw_pairing(ax: Axes, pairing: Record) -> None:
    """Draw the time of pairing rays with voxels over the frames of a batch.

    Args:
        ax: Ordinary 2D axes.
        pairing: Content of `results/speed/pairing.json`.
    """
    batches = [row["frames"] for row in pairing["by_batch"]]
    for name, (label, color) in _PAIRING.items():
        rows = [row for row in pairing["by_batch"] if name in row]
        ax.plot([row["frames"] for row in rows], [row[name]["wall_median_ms"] for row in rows],
                "o-", color=COLORS[color], label=label)  # fmt: skip
    ax.set(xscale="log", yscale="log", xlabel="frames in the batch", ylabel="time (ms)")
    ax.set_xticks(batches, [str(number) for number in batches])
    ax.minorticks_off()
    ax.legend(loc="upper left")
