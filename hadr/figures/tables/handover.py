"""The handover experiment as tables: each arm's attempts, and the settings that all share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd
from scipy.stats import binomtest

from hadr.figures.handover.film import ARMS
from hadr.figures.tables import markdown

Row = Mapping[str, Any]


def arms_table(rows: Sequence[Row], published: Mapping[str, Sequence[int]] | None = None) -> str:
    """List each arm's attempts in the columns of the paper's table, and a success's mean time."""
    lines = []
    for row in rows:
        low, high = row["interval"]
        lines.append(
            [
                str(ARMS.get(row["arm"], row["arm"])),
                f"{row['successes']}/{row['attempts']}",
                f"{100 * row['rate']:.1f}\N{NO-BREAK SPACE}%",
                f"{100 * low:.0f}\N{NO-BREAK SPACE}to\N{NO-BREAK SPACE}{100 * high:.0f}",
                *(f"{row[f'objects_at_{n}_percent']}/8" for n in (50, 80, 100)),
                _seconds(row["mean_seconds"]),
            ]
        )
    for name, (won, *objects) in (published or {}).items():
        counts = [f"{count}/8" for count in objects]
        lines.append(
            [
                f"*paper: {name}*",
                f"{won}/48",
                f"{100 * won / 48:.1f}\N{NO-BREAK SPACE}%",
                "",
                *counts,
                "",
            ]
        )
    head = ["depth", "successes", "rate", "95 % interval", "> 0.5", "> 0.8", "1.0", "time"]
    return markdown(pd.DataFrame(lines, columns=head))


def paired(first: Row, second: Row) -> tuple[int, int, float]:
    """Compare two arms attempt by attempt.

    Args:
        first: A row of `results/mini/handover.json` with its ``verdicts``.
        second: Another one.

    Returns:
        In how many attempts the first alone succeeds, in how many the second alone, and how likely
        chance alone makes at least such a difference (two-sided sign test; 1 without any).

    Raises:
        ValueError: The two have not made the same attempts.
    """
    if first["verdicts"].keys() != second["verdicts"].keys():
        raise ValueError(f"{first['arm']} and {second['arm']} have not made the same attempts")
    won = [
        (verdict == "success", second["verdicts"][name] == "success")
        for name, verdict in first["verdicts"].items()
    ]
    ahead, behind = won.count((True, False)), won.count((False, True))
    doubt = float(binomtest(ahead, ahead + behind).pvalue) if ahead + behind else 1.0
    return ahead, behind, doubt


def _seconds(value: float | None) -> str:
    if value is None:
        return "none"
    return f"{value:.1f} s" if value >= 1 else f"{1000 * value:.0f} ms"
