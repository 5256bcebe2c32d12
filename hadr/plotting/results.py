"""The measured tables as pictures and Markdown, drawn from result files and nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from hadr.plotting import COLORS

Row = Mapping[str, Any]

NAMES: dict[str, str] = {
    "raw": "raw depth",
    "inpainting": "inpainting",
    "nearest": "nearest valid depth",
    "hand-median": "the hand's median depth",
    "no-hand": "HADR without the hand",
    "hadr": "HADR",
    "hadr-long": "HADR, trained longer",
    "lidf": "LIDF",
    "dfnet": "DFNet (TransCG)",
    "swindrnet": "SwinDRNet",
    "tode": "TODE-Trans",
    "unet-hand": "U-Net with the hand",
    "hadr-plus": "HADR-plus",
    "no-aggregation": "HADR without aggregation of scales",
    "no-point-fusion": "HADR without point fusion",
    "hand-2d": "HADR with the 2D hand feature",
    "full": "HADR, the full model",
}
"""How a method of a result file is called in tables and pictures, in the order of the tables."""
PUBLISHED_NAMES: dict[str, str] = {
    "tode": "TODE-Trans",
    "dfnet": "TransCG",
    "swindrnet": "SwinDRNet",
    "lidf": "LIDF+Refine",
    "hadr": "HADR",
    "no-hand": "w/o Hand Feature",
    "no-aggregation": "w/o MS Aggregation",
    "no-point-fusion": "w/o Point Fusion",
    "hand-2d": "2D Hand Feature",
    "full": "Full Model",
}
"""Names of our rows in the paper's tables."""
_COLOR = {
    "hadr": "hadr",
    "hadr-long": "hadr",
    "no-hand": "glass",
    "unet-hand": "baseline",
    "hadr-plus": "robot",
    "lidf": "voxel",
    "dfnet": "highlight",
    "swindrnet": "truth",
    "tode": "ray",
    "hand-median": "hand",
}


def system_color(method: str) -> str:
    """Colour of a method in all pictures of results."""
    return COLORS[_COLOR.get(method, "raw")]


def ordered(rows: Sequence[Row], split: str) -> list[Row]:
    """Give the rows of a split in the order of `NAMES`."""
    place = {name: number for number, name in enumerate(NAMES)}
    chosen = [row for row in rows if row["split"] == split]
    return sorted(chosen, key=lambda row: place.get(row["method"], len(place)))


def _places(rows: Sequence[Row]) -> dict[str, int]:
    """Line of each method that occurs in any split, the first at the top."""
    there = {row["method"] for row in rows}
    listed = [name for name in NAMES if name in there] + sorted(there - set(NAMES))
    return {name: len(listed) - 1 - number for number, name in enumerate(listed)}


def _name_lines(ax: Axes, places: Mapping[str, int]) -> None:
    ax.set(
        yticks=list(places.values()),
        yticklabels=[NAMES.get(name, name) for name in places],
        ylim=(-0.7, len(places) - 0.3),
    )


def results_table(rows: Sequence[Row], published: Mapping[str, Mapping[str, Any]]) -> str:
    """Set the rows of both splits side by side, the paper's HADR below.

    Args:
        rows: Rows of `known.json` and `unknown.json`.
        published: Content of `results/paper_tables.json`.

    Returns:
        Markdown; "-" where a run is missing.
    """
    lines = [
        "| method | known: RMSE (cm) | MAE (cm) | δ1.05 (%) | unknown: RMSE (cm) | MAE (cm) | "
        "δ1.05 (%) | weights (M) | training (min) |",
        "|:--" + "|--:" * 8 + "|",
    ]
    found = {(row["split"], row["method"]): row for row in rows}
    for method, name in NAMES.items():
        pair = [found.get((split, method)) for split in ("known", "unknown")]
        if pair == [None, None]:
            continue
        cells = [cell for row in pair for cell in _scores(row)]
        trained = next((row for row in pair if row and row.get("training_s")), None)
        size = f"{trained['parameters'] / 1e6:.1f}" if trained else "-"
        minutes = f"{trained['training_s'] / 60:.0f}" if trained else "-"
        lines.append("| " + " | ".join([name, *cells, size, minutes]) + " |")
    cells = []
    for split in ("known", "unknown"):
        rmse, _, mae, delta = published[split]["HADR"][:4]
        cells += [f"{100 * rmse:.1f}", f"{100 * mae:.1f}", f"{delta:.2f}"]
    lines.append("| *HADR as published, on other data* | " + " | ".join([*cells, "-", "-"]) + " |")
    return "\n".join(lines)


def _scores(row: Row | None) -> list[str]:
    if row is None:
        return ["-"] * 3
    return [f"{100 * row['rmse_m']:.2f}", f"{100 * row['mae_m']:.2f}", f"{row['delta_105']:.2f}"]


def draw_systems(ax: Axes, rows: Sequence[Row], split: str, published_rmse_m: float) -> None:
    """Draw each method's RMSE as a dot with its standard error over holds.

    Args:
        ax: Ordinary 2D axes.
        rows: Rows of `known.json` and `unknown.json`.
        split: "known" or "unknown".
        published_rmse_m: The paper's RMSE of HADR on its own data, metres.
    """
    places = _places(rows)
    for row in ordered(rows, split):
        place = places[row["method"]]
        value, doubt = 100 * row["rmse_m"], 100 * (row.get("rmse_standard_error_m") or 0)
        color = system_color(row["method"])
        ax.errorbar(value, place, xerr=doubt, color=color, marker="o", ms=7, capsize=2)
        ax.annotate(f"{value:.1f}", (value + doubt, place), xytext=(6, 0), va="center",
                    textcoords="offset points", fontsize=9)  # fmt: skip
    ax.axvline(100 * published_rmse_m, color=COLORS["truth"], lw=1, ls=":")
    _name_lines(ax, places)
    ax.set(
        xscale="log",
        xlim=(0.6, 300),
        xlabel="RMSE (cm)",
        title=f"{split} objects",
    )
    ax.set_xticks([1, 3, 10, 30, 100], ["1", "3", "10", "30", "100"])
    ax.minorticks_off()


def draw_learning(ax: Axes, rows: Sequence[Row], split: str) -> None:
    """Draw the validation error of each training over its minutes.

    Args:
        ax: Ordinary 2D axes.
        rows: Rows with ``curve``.
        split: "known" or "unknown".
    """
    for row in ordered(rows, split):
        curve = row.get("curve")
        if not curve:
            continue
        minutes = np.asarray(curve["seconds"]) / 60
        error = 100 * np.asarray(curve["validation_rmse_m"])
        style = "--" if row["method"] == "hadr-long" else "-"
        ax.plot(minutes, error, style, color=system_color(row["method"]), marker="o", ms=2.5,
                label=NAMES.get(row["method"], row["method"]))  # fmt: skip
    ax.set(xlabel="minutes of training, one core", ylabel="RMSE (cm)", title=f"{split} objects")


def draw_parts(ax: Axes, rows: Sequence[Row], split: str) -> None:
    """Draw what is left of each method's error when place, and place and tilt, are given away.

    Args:
        ax: Ordinary 2D axes.
        rows: Rows of `results/mini/errors.json`.
        split: "known" or "unknown".
    """
    places = _places(rows)
    parts = (
        ("rmse_m", "whole error", "o"),
        ("shape_m", "without its median: shape and tilt", "s"),
        ("tilt_m", "without its best plane: shape alone", "D"),
    )
    for row in ordered(rows, split):
        place = places[row["method"]]
        values = [100 * row[part] for part, _, _ in parts]
        color = system_color(row["method"])
        ax.plot([min(values), max(values)], [place, place], color=color, lw=1.2)
        for value, (_, _, marker) in zip(values, parts, strict=True):
            face = color if marker == "o" else "white"
            ax.plot(value, place, marker, color=color, ms=6, mfc=face)
    for _, label, marker in parts:
        face = COLORS["raw"] if marker == "o" else "white"
        ax.plot([], [], marker, color=COLORS["raw"], mfc=face, label=label)
    _name_lines(ax, places)
    ax.set(xlim=(0, None), xlabel="RMSE (cm)", title=f"{split} objects")


def draw_by_object(
    ax: Axes,
    rows: Sequence[Row],
    split: str,
    names: Mapping[str, str],
    part: str = "rmse_m",
    xlabel: str = "RMSE (cm)",
) -> None:
    """Draw each method's error on each object as a dot.

    Args:
        ax: Ordinary 2D axes.
        rows: Rows of `results/mini/errors.json`.
        split: "known" or "unknown".
        names: What the objects are called, by number.
        part: Which part of the error, in metres.
        xlabel: What that is, with its unit.
    """
    chosen = ordered(rows, split)
    objects = sorted({number for row in chosen for number in row["by_object"]})
    for row in chosen:
        values = [100 * row["by_object"][number][part] for number in objects]
        color = system_color(row["method"])
        face = "white" if row["method"] == "hadr-long" else color
        ax.plot(values, range(len(objects)), "o", color=color, mfc=face, alpha=0.9,
                label=NAMES.get(row["method"], row["method"]))  # fmt: skip
    ax.set(
        yticks=range(len(objects)),
        yticklabels=[f"{number} {names.get(number, '')}".strip() for number in objects],
        ylim=(len(objects) - 0.5, -0.5),
        xlabel=xlabel,
        title=f"{split} objects",
    )
    if part != "bias_m":
        ax.set_xlim(0, None)
    ax.grid(axis="y", lw=0.5, alpha=0.5)


def draw_bias(ax: Axes, rows: Sequence[Row], split: str, names: Mapping[str, str]) -> None:
    """Draw for each method how far off each object is placed in the mean, with its sign.

    Args:
        ax: Ordinary 2D axes.
        rows: Rows of `results/mini/errors.json`.
        split: "known" or "unknown".
        names: What the objects are called, by number.
    """
    xlabel = "too near  ←  mean error of place (cm)  →  too far"
    draw_by_object(ax, rows, split, names, "bias_m", xlabel)
    ax.axvline(0, color=COLORS["truth"], lw=0.8)


def compared(rows: Sequence[Row], published: Mapping[str, Any], split: str) -> list[str]:
    """Give the methods of the paper's table that have a row, the paper's best first."""
    there = {row["method"] for row in rows if row["split"] == split}
    found = [m for m in NAMES if m in there and PUBLISHED_NAMES.get(m, "") in published[split]]
    return sorted(found, key=lambda method: published[split][PUBLISHED_NAMES[method]][0])


def orders_table(rows: Sequence[Row], published: Mapping[str, Any]) -> str:
    """Set the paper's methods side by side: its error and ours, and the place that each gives.

    Args:
        rows: Rows of `known.json` and `unknown.json`.
        published: Content of `results/paper_tables.json`.

    Returns:
        Markdown, a line a method and split.
    """
    lines = [
        "| objects | method | paper: RMSE (cm) | place | δ1.05 (%) | ours: RMSE (cm) | place | "
        "δ1.05 (%) |",
        "|:--|:--" + "|--:" * 6 + "|",
    ]
    for split in ("known", "unknown"):
        methods = compared(rows, published, split)
        own = {row["method"]: row for row in rows if row["split"] == split}
        theirs = [published[split][PUBLISHED_NAMES[method]] for method in methods]
        for method, row in zip(methods, theirs, strict=True):
            ours = own[method]
            places = [
                1 + sum(other[0] < row[0] for other in theirs),
                1 + sum(own[other]["rmse_m"] < ours["rmse_m"] for other in methods),
            ]
            lines.append(
                f"| {split} | {NAMES[method]} | {100 * row[0]:.1f} | {places[0]} | {row[3]:.2f} | "
                f"{100 * ours['rmse_m']:.2f} | {places[1]} | {ours['delta_105']:.2f} |"
            )
    return "\n".join(lines)


def draw_against_paper(
    ax: Axes, rows: Sequence[Row], published: Mapping[str, Any], split: str
) -> None:
    """Draw each method's RMSE as published (hollow) and ours (full, with its standard error).

    Args:
        ax: Ordinary 2D axes.
        rows: Rows of `known.json` and `unknown.json`.
        published: Content of `results/paper_tables.json`.
        split: "known" or "unknown".
    """
    own = {row["method"]: row for row in rows if row["split"] == split}
    methods = compared(rows, published, split)
    largest = max((100 * own[method]["rmse_m"] for method in methods), default=1)
    for line, method in enumerate(methods):
        color = system_color(method)
        theirs = 100 * published[split][PUBLISHED_NAMES[method]][0]
        ours = 100 * own[method]["rmse_m"]
        doubt = 100 * (own[method].get("rmse_standard_error_m") or 0)
        ax.plot([theirs, ours], [line, line], color=color, lw=1, alpha=0.5)
        ax.plot(theirs, line, "o", color=color, mfc="white", ms=8)
        ax.errorbar(ours, line, xerr=doubt, color=color, marker="o", ms=8, capsize=2)
    ax.set(
        xscale="log",
        yticks=range(len(methods)),
        yticklabels=[NAMES[method] for method in methods],
        ylim=(len(methods) - 0.5, -0.5),
        xlim=(0.7, max(10, 1.3 * largest)),
        xlabel="RMSE (cm)",
        title=f"{split} objects",
    )
    ax.set_xticks([1, 2, 5, 10], ["1", "2", "5", "10"])
    ax.minorticks_off()


def draw_error_over_time(ax: Axes, rows: Sequence[Row], speed: Sequence[Row], split: str) -> None:
    """Draw each method's error over the time that a frame takes, both at preset `mini`.

    Args:
        ax: Ordinary 2D axes.
        rows: Rows of `known.json` and `unknown.json`.
        speed: Rows of `results/speed/side_by_side.json`.
        split: "known" or "unknown".
    """
    times = {row["method"]: row["wall_median_ms"] for row in speed if row["preset"] != "paper"}
    for row in ordered(rows, split):
        if row["method"] not in times or row["rmse_m"] > 0.2:
            continue
        place = (times[row["method"]], 100 * row["rmse_m"])
        ax.plot(*place, "o", color=system_color(row["method"]), ms=8)
        ax.annotate(NAMES[row["method"]], place, xytext=(6, 4), textcoords="offset points",
                    fontsize=9)  # fmt: skip
    ax.set(
        xscale="log",
        ylim=(0, None),
        xlabel="time of a frame (ms)",
        ylabel="RMSE (cm)",
        title=f"{split} objects",
    )


def ablation_table(rows: Sequence[Row], published: Mapping[str, Any]) -> str:
    """Set the ablation of HADR beside the paper's.

    Args:
        rows: Rows of `ablation.json`.
        published: Content of `results/paper_tables.json`.

    Returns:
        Markdown, the rows in the paper's order.
    """
    lines = [
        "| row | paper: RMSE (cm) | MAE (cm) | δ1.05 (%) | ours: RMSE (cm) | standard error | "
        "MAE (cm) | δ1.05 (%) |",
        "|:--" + "|--:" * 7 + "|",
    ]
    for row in rows:
        theirs = published["ablation"][PUBLISHED_NAMES[row["method"]]]
        lines.append(
            f"| {NAMES[row['method']]} | {100 * theirs[0]:.1f} | {100 * theirs[2]:.1f} | "
            f"{theirs[3]:.2f} | {100 * row['rmse_m']:.2f} | "
            f"{100 * row['rmse_standard_error_m']:.2f} | {100 * row['mae_m']:.2f} | "
            f"{row['delta_105']:.2f} |"
        )
    return "\n".join(lines)


def averages_table(rows: Sequence[Row]) -> str:
    """Set each network's error in both averages, and against the hand's median frame by frame.

    Args:
        rows: Rows of `known.json` and `unknown.json`.

    Returns:
        Markdown.
    """
    lines = [
        "| objects | method | RMSE, mean over frames (cm) | pooled (cm) | minus the hand's median "
        "(cm) | better on frames (%) |",
        "|:--|:--" + "|--:" * 4 + "|",
    ]
    for row in [r for split in ("known", "unknown") for r in ordered(rows, split)]:
        pair = row.get("against_hand_median")
        if "parameters" not in row or pair is None:
            continue
        gap, doubt = 100 * pair["mean_difference_m"], 100 * pair["standard_error_m"]
        share = 100 * pair["better_on_frames"] / pair["frames"]
        lines.append(
            f"| {row['split']} | {NAMES[row['method']]} | {100 * row['rmse_m']:.2f} | "
            f"{100 * row['pooled']['rmse_m']:.2f} | {gap:+.2f} ± {doubt:.2f} | {share:.0f} |"
        )
    return "\n".join(lines)


def poses_table(rows: Sequence[Row]) -> str:
    """Set each method's error on familiar and on new hand poses.

    Args:
        rows: Rows of `results/mini/errors.json`.

    Returns:
        Markdown.
    """
    lines = [
        "| objects | method | RMSE, most familiar third (cm) | newest third (cm) | rank "
        "correlation |",
        "|:--|:--" + "|--:" * 3 + "|",
    ]
    for row in [r for split in ("known", "unknown") for r in ordered(rows, split)]:
        near, _, far = row["by_pose"]
        lines.append(
            f"| {row['split']} | {NAMES[row['method']]} | {100 * near['rmse_m']:.2f} | "
            f"{100 * far['rmse_m']:.2f} | {row['rank_correlation']:+.2f} |"
        )
    return "\n".join(lines)
