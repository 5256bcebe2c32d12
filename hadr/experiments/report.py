"""The report: the paper's tables beside ours, with what each of our rows cost and comes from.

It is made from the result files and `paper_tables.json`, whether these are the repository's own or
what `hadr reproduce` has just written, and the book's page *The paper's tables, and ours* is it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hadr.plotting.results import NAMES
from hadr.result_file import ResultFile, read_result_file

PUBLISHED_NAMES = {
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
TITLES = {
    "known": "Known objects",
    "unknown": "Unknown objects",
    "ablation": "Ablation of HADR, known objects",
}
"""The paper's tables that have a result file."""
DEFAULT = "as by default"
"""The ledger's column that has every switch as the project has it."""
_COLUMNS = (
    ("rmse_m", "RMSE (cm)", 100, 2),
    ("rel", "REL (%)", 100, 2),
    ("mae_m", "MAE (cm)", 100, 2),
    ("delta_105", "δ1.05 (%)", 1, 2),
    ("delta_110", "δ1.10 (%)", 1, 2),
    ("delta_125", "δ1.25 (%)", 1, 2),
)


def report(results: str | Path, published: str | Path, size: str = "mini") -> str:
    """Set the paper's tables beside those of a folder of result files.

    Args:
        results: The folder, with any of known.json, unknown.json and ablation.json.
        published: The paper's tables, `results/paper_tables.json`.
        size: The preset, for the commands.

    Returns:
        Markdown with one section a table: the numbers in pairs, then command, training time,
        weights, seeds and provenance of each row.

    Raises:
        ValueError: A result file was edited by hand, or there is none.
        FileNotFoundError: The paper's tables are missing.
    """
    paper = json.loads(Path(published).read_text(encoding="utf-8"))
    parts = []
    for name, title in TITLES.items():
        path = Path(results) / f"{name}.json"
        if path.exists():
            parts.append(_section(title, name, read_result_file(path), paper, size))
    if not parts:
        raise ValueError(f"{results} has none of the files {', '.join(TITLES)}")
    return "\n\n".join(parts) + "\n"


def _section(title: str, name: str, file: ResultFile, paper: Mapping[str, Any], size: str) -> str:
    frames = sorted({row["frames"] for row in file.rows})
    lines = [
        f"## {title}",
        "",
        f"{' or '.join(map(str, frames))} test frames. Each cell: the paper's number on its data, "
        "**ours** on ours (mean over the frames), and the difference, ours minus the paper's.",
        "",
        *_pairs(file.rows, paper[name]),
        "",
        "How each of our rows was made:",
        "",
        *_makings(file.rows, name, size),
    ]
    origin = file.provenance
    lines += [
        "",
        f"`{name}.json`, written {origin['created']}, data {_short(origin['data']['sha256'])}, "
        f"checksum {_short(origin['sha256'])}.",
    ]
    return "\n".join(lines)


def _pairs(rows: Sequence[Mapping[str, Any]], paper: Mapping[str, Sequence[float]]) -> list[str]:
    lines = [
        "| method | " + " | ".join(title for _, title, _, _ in _COLUMNS) + " |",
        "|:--" + "|--:" * len(_COLUMNS) + "|",
    ]
    for row in rows:
        theirs = paper.get(PUBLISHED_NAMES.get(row["method"], ""))
        cells = []
        for place, (column, _, factor, digits) in enumerate(_COLUMNS):
            own = factor * row[column]
            if theirs is None:
                cells.append(f"**{own:.{digits}f}**")
                continue
            printed = factor * theirs[place]
            shown = f"{printed:.1f}" if factor == 100 else f"{printed:.2f}"
            cells.append(f"{shown} → **{own:.{digits}f}** ({own - printed:+.{digits}f})")
        lines.append(f"| {_title(row['method'])} | " + " | ".join(cells) + " |")
    return lines


def _makings(rows: Sequence[Mapping[str, Any]], name: str, size: str) -> list[str]:
    lines = [
        "| method | command: `hadr reproduce …` | training (min) | weights (M) | seeds | "
        "SD of RMSE (cm) | commit | configuration |",
        "|:--|:--|--:|--:|--:|--:|:--|:--|",
    ]
    for row in rows:
        run = row["configuration"]["run"].rsplit("/", 1)[0]
        minutes = f"{row['training_s'] / 60:.1f}" if row.get("training_s") else "-"
        weights = f"{row['parameters'] / 1e6:.2f}" if row.get("parameters") else "-"
        spread = row["seed_sd"]["rmse_m"]
        commits = ", ".join(commit[:7] for commit in row["provenance"]["commit"])
        lines.append(
            f"| {_title(row['method'])} | `--preset {size} --only {run}` | {minutes} | {weights} | "
            f"{len(row['seeds'])} | {'-' if spread is None else f'{100 * spread:.2f}'} | "
            f"{commits} | {_short(row['config_sha256'][0])} |"
        )
    return lines


def _short(sha: str) -> str:
    return f"`{sha[:10]}`"


def _title(method: str) -> str:
    return NAMES.get(method, method)


def ledger_table(path: str | Path) -> str:
    """Set what the ledger's switches change: a column a switch, a line a metric.

    Args:
        path: `ledger.json`.

    Returns:
        Markdown; the pooled column is the default's own, averaged otherwise.

    Raises:
        ValueError: The file was edited by hand.
        FileNotFoundError: There is no such file.
    """
    file = read_result_file(path)
    columns = [(row["method"], row) for row in file.rows]
    default = dict(columns).get(DEFAULT)
    if default is not None:
        columns.insert(1, ("metrics pooled", {**default, **default["pooled"]}))
    lines = [
        "| metric | " + " | ".join(name for name, _ in columns) + " |",
        "|:--" + "|--:" * len(columns) + "|",
    ]
    for column, title, factor, digits in _COLUMNS:
        cells = [f"{factor * row[column]:.{digits}f}" for _, row in columns]
        lines.append(f"| {title} | " + " | ".join(cells) + " |")
    epochs = [f"{row['epochs']} epochs, seed {row['seeds'][0]}" for _, row in columns]
    lines.append("| trained | " + " | ".join(epochs) + " |")
    return "\n".join(lines)
