"""Tables of what the comparison found beyond its main rows: averages, poses, memory."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from hadr.figures.tables import markdown
from hadr.figures.tables.results import NAMES, Row, difference_cell, ordered, with_doubt


def memory_table(rows: Sequence[Row]) -> str:
    """Set each method's error with whole holds held out beside that with frames dealt out."""
    head = [
        "method", "whole holds: RMSE (cm)", "minus the hand's median", "frame by frame: RMSE (cm)",
        "minus the hand's median",
    ]  # fmt: skip
    lines = []
    for one in ordered(rows, "known"):
        (other,) = (
            row for row in rows if (row["method"], row["split"]) == (one["method"], "by-frame")
        )
        cells = []
        for row in (one, other):
            itself = row["method"] == "hand-median"
            cells.append(with_doubt(row["rmse_m"], row["rmse_standard_error_m"]))
            cells.append(difference_cell(None if itself else row["against_hand_median"]))
        lines.append([NAMES[one["method"]], *cells])
    return markdown(pd.DataFrame(lines, columns=head))


def averages_table(rows: Sequence[Row]) -> str:
    """Set each network's error in both averages, and against the hand's median frame by frame."""
    head = [
        "objects", "method", "RMSE, mean over frames (cm)", "pooled (cm)",
        "minus the hand's median (cm)", "better on frames (%)",
    ]  # fmt: skip
    lines = []
    for row in [r for split in ("known", "unknown") for r in ordered(rows, split)]:
        pair = row.get("against_hand_median")
        if "parameters" not in row or pair is None:
            continue
        share = 100 * pair["better_on_frames"] / pair["frames"]
        both = (f"{100 * part['rmse_m']:.2f}" for part in (row, row["pooled"]))
        name = NAMES[row["method"]]
        lines.append([row["split"], name, *both, difference_cell(pair), f"{share:.0f}"])
    return markdown(pd.DataFrame(lines, columns=head), "llr")


def poses_table(rows: Sequence[Row]) -> str:
    """Set each method's error on familiar and on new hand poses."""
    head = [
        "objects", "method", "RMSE, most familiar third (cm)", "newest third (cm)",
        "rank correlation",
    ]  # fmt: skip
    lines = []
    for row in [r for split in ("known", "unknown") for r in ordered(rows, split)]:
        near, _, far = row["by_pose"]
        both = (f"{100 * part['rmse_m']:.2f}" for part in (near, far))
        name = NAMES[row["method"]]
        lines.append([row["split"], name, *both, f"{row['rank_correlation']:+.2f}"])
    return markdown(pd.DataFrame(lines, columns=head), "llr")
