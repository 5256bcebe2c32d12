"""Our tables beside the paper's, and what else the comparison found; all from result files."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from hadr.figures.rows import Dots, draw_dot_rows
from hadr.figures.tables.results import (
    NAMES,
    Row,
    difference_cell,
    markdown,
    ordered,
    rmse_cm,
    scores,
    system_color,
    system_marker,
)
from hadr.models.networks import NETWORKS

PUBLISHED_NAMES: dict[str, str] = {
    **{kind: network.published for kind, network in NETWORKS.items() if network.published},
    "no-hand": "w/o Hand Feature",
    "no-aggregation": "w/o MS Aggregation",
    "no-point-fusion": "w/o Point Fusion",
    "hand-2d": "2D Hand Feature",
    "full": "Full Model",
}
"""Names of our rows in the paper's tables."""


def compared(rows: Sequence[Row], published: Mapping[str, Any], split: str) -> list[str]:
    """Give the methods of the paper's table that have a row, the paper's best first."""
    there = {row["method"] for row in rows if row["split"] == split}
    found = [m for m in NAMES if m in there and PUBLISHED_NAMES.get(m, "") in published[split]]
    return sorted(found, key=lambda method: published[split][PUBLISHED_NAMES[method]][0])


def orders_table(rows: Sequence[Row], published: Mapping[str, Any]) -> str:
    """Set the paper's methods side by side: its error and ours, and the place that each gives."""
    head = [
        "objects", "method", "paper: RMSE (cm)", "place", "δ1.05 (%)", "ours: RMSE (cm)", "place",
        "δ1.05 (%)", "minus the next better (cm)",
    ]  # fmt: skip
    lines = []
    for split in ("known", "unknown"):
        methods = compared(rows, published, split)
        own = {row["method"]: row for row in rows if row["split"] == split}
        theirs = [published[split][PUBLISHED_NAMES[method]] for method in methods]
        for method, row in zip(methods, theirs, strict=True):
            ours = own[method]
            place = 1 + sum(other[0] < row[0] for other in theirs)
            printed = [f"{100 * row[0]:.1f}", str(place), f"{row[3]:.2f}"]
            place = 1 + sum(own[other]["rmse_m"] < ours["rmse_m"] for other in methods)
            measured = [f"{100 * ours['rmse_m']:.2f}", str(place), f"{ours['delta_105']:.2f}"]
            gap = difference_cell(ours.get("against_next"))
            lines.append([split, NAMES[method], *printed, *measured, gap])
    return markdown(pd.DataFrame(lines, columns=head), "llr")


def reasons_table(
    tables: Mapping[str, Sequence[Row]],
    published: Mapping[str, Any],
    reasons: Mapping[str, tuple[str, str]],
) -> str:
    """Set how far each of our rows lies from the paper's, why, and where that was tried."""
    lines = []
    for method, (reason, where) in reasons.items():
        gaps = {}
        for table, rows in tables.items():
            there = published[table].get(PUBLISHED_NAMES[method])
            ours = [row["rmse_m"] for row in rows if row["method"] == method]
            if there is not None and ours:
                gaps["unknown" if table == "unknown" else "known"] = 100 * (ours[0] - there[0])
        if not gaps:
            raise KeyError(method)
        cells = [f"{gaps[s]:+.1f}" if s in gaps else "-" for s in ("known", "unknown")]
        lines.append([NAMES[method], *cells, reason, where])
    head = ["row", "ours minus paper: known (cm)", "unknown (cm)", "main reason", "where tested"]
    return markdown(pd.DataFrame(lines, columns=head), "lrrll")


def ways_table(ways: Sequence[tuple[str, str, str, float]]) -> str:
    """List one network's errors: where it was scored, on which frames, and what a hole counts."""
    head = ["scored in", "frames", "a pixel without an answer", "RMSE (cm)"]
    lines = [[*words, f"{100 * rmse:.2f}"] for *words, rmse in ways]
    return markdown(pd.DataFrame(lines, columns=head), "lllr")


def draw_against_paper(
    ax: Axes, rows: Sequence[Row], published: Mapping[str, Any], split: str
) -> None:
    """Draw each method's RMSE as published (hollow) and ours (full, with its standard error)."""
    own = {row["method"]: row for row in rows if row["split"] == split}
    methods = compared(rows, published, split)
    colors, markers = ([f(m) for m in methods] for f in (system_color, system_marker))
    theirs = [100 * published[split][PUBLISHED_NAMES[method]][0] for method in methods]
    ours = np.array([100 * own[method]["rmse_m"] for method in methods])
    doubt = np.array([100 * (own[m].get("rmse_standard_error_m") or 0) for m in methods])
    ends = np.stack([ours - doubt, ours + doubt], axis=1)
    series = [Dots(theirs, colors, markers, hollow=True), Dots(ours, colors, markers, ends=ends)]
    draw_dot_rows(ax, [NAMES[method] for method in methods], series, size=8, joined=True)
    limits = (0.7, max(10, 1.3 * ours.max(initial=1)))
    ax.set(xscale="log", xlim=limits, xlabel="RMSE (cm)", title=f"{split} objects")
    ax.set_xticks([1, 2, 5, 10], ["1", "2", "5", "10"])
    ax.minorticks_off()


READABLE_M = 0.2
"""Larger errors, such as that of a hole, are left out where errors are drawn over time; metres."""


def draw_error_over_time(ax: Axes, rows: Sequence[Row], speed: Sequence[Row], split: str) -> None:
    """Draw each method's error over the least time of a frame, both at preset `imagenet`."""
    sizes = ("imagenet", None)
    times = {row["method"]: row["wall_min_ms"] for row in speed if row["preset"] in sizes}
    for row in ordered(rows, split):
        method = row["method"]
        if method in times and row["rmse_m"] < READABLE_M:
            ax.plot(times[method], 100 * row["rmse_m"], system_marker(method), ms=9,
                    color=system_color(method), label=NAMES[method])  # fmt: skip
    shown = [row["rmse_m"] for row in rows if row["rmse_m"] < READABLE_M]
    ax.set(
        xscale="log",
        ylim=(0, 110 * max(shown, default=0.1)),
        xlabel="time of a frame (ms)",
        ylabel="RMSE (cm)",
        title=f"{split} objects",
    )
    ax.xaxis.set_major_formatter("{x:g}")


def ablation_table(rows: Sequence[Row], published: Mapping[str, Any]) -> str:
    """Set the ablation of HADR beside the paper's."""
    head = [
        "row", "paper: RMSE (cm)", "MAE (cm)", "δ1.05 (%)", "ours: RMSE (cm)",
        "minus the full model's (cm)", "MAE (cm)", "δ1.05 (%)",
    ]  # fmt: skip
    lines = []
    for row in rows:
        theirs = published["ablation"][PUBLISHED_NAMES[row["method"]]]
        printed = [f"{100 * theirs[0]:.1f}", f"{100 * theirs[2]:.1f}", f"{theirs[3]:.2f}"]
        rmse, *others = scores(row)
        gap = difference_cell(row["against_full"])
        lines.append([NAMES[row["method"]], *printed, rmse, gap, *others])
    return markdown(pd.DataFrame(lines, columns=head), best=[range(len(lines))])


def memory_table(rows: Sequence[Row]) -> str:
    """Set each method's error with whole holds held out beside that with frames dealt out."""
    head = [
        "method", "whole holds: RMSE (cm)", "minus the hand's median (cm)",
        "frame by frame: RMSE (cm)", "minus the hand's median (cm)",
    ]  # fmt: skip
    lines = []
    by_frame = {row["method"]: row for row in rows if row["split"] == "by-frame"}
    for one in ordered(rows, "known"):
        cells = []
        for row in (one, by_frame[one["method"]]):
            itself = row["method"] == "hand-median"
            gap = difference_cell(None if itself else row["against_hand_median"])
            cells += [rmse_cm(row), gap]
        lines.append([NAMES[one["method"]], *cells])
    return markdown(pd.DataFrame(lines, columns=head), best=[range(len(lines))])


def averages_table(rows: Sequence[Row]) -> str:
    """Set each network's error in both averages, and against the hand's median frame by frame."""
    head = [
        "objects", "method", "RMSE, mean over frames (cm)", "pooled (cm)",
        "minus the hand's median (cm)",
    ]  # fmt: skip
    lines = []
    for row in ordered(rows, "known", "unknown"):
        pair = row.get("against_hand_median")
        if "parameters" not in row or pair is None:
            continue
        both = (f"{100 * part['rmse_m']:.2f}" for part in (row, row["pooled"]))
        lines.append([row["split"], NAMES[row["method"]], *both, difference_cell(pair)])
    return markdown(pd.DataFrame(lines, columns=head), "llr")


def poses_table(rows: Sequence[Row]) -> str:
    """Set each method's error on familiar and on new hand poses."""
    head = [
        "objects", "method", "RMSE, most familiar third (cm)", "RMSE, newest third (cm)",
        "rank correlation",
    ]  # fmt: skip
    lines = []
    for row in ordered(rows, "known", "unknown"):
        near, _, far = row["by_pose"]
        both = (f"{100 * part['rmse_m']:.2f}" for part in (near, far))
        name = NAMES[row["method"]]
        lines.append([row["split"], name, *both, f"{row['rank_correlation']:+.2f}"])
    return markdown(pd.DataFrame(lines, columns=head), "llr")
