"""The report's other tables: conditions, the ledger's switches, trials, speed; from result files.

The paper's own tables beside ours are made by `hadr.press.paper_report`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hadr.experiments.tables import DEFAULT
from hadr.figures.tables.results import NAMES, with_doubt
from hadr.records.markdown import markdown_table
from hadr.records.result_file import read_result_file

"""The ledger's column that has every switch as the project has it."""
METRICS = (
    ("rmse_m", "RMSE (cm)", 100),
    ("rel", "REL (%)", 100),
    ("mae_m", "MAE (cm)", 100),
    ("delta_105", "δ1.05 (%)", 1),
    ("delta_110", "δ1.10 (%)", 1),
    ("delta_125", "δ1.25 (%)", 1),
)
"""Columns of the paper's tables: as in a row, as above a column, and the factor between."""
_SWITCHED = {
    "coded-weights": "loss weights as coded",
    "wrist-translation": "wrist without rotation",
    "clamped-probability": "probability clamped",
}
"""How the ledger's switches are called above their columns."""


_EFFECTS = (
    (1, "loss weights as coded", "ledger", "coded-weights"),
    (4, "probability clamped", "ledger", "clamped-probability"),
    (7, "wrist frame without rotation", "ledger", "wrist-translation"),
    (8, "simulated sensor instead of erased depth", "segmentation", "simulated sensor"),
    (9, "predicted keypoints", "keypoints", "predicted keypoints"),
    (14, "split by frame instead of by hold", "ledger", "split by frame"),
    (15, "metrics pooled over all pixels", "ledger", None),
)
"""The ledger's rows that were measured: number, the change, the result file, and its row there."""


def _with_doubt(row: Mapping[str, Any]) -> str:
    return with_doubt(row["rmse_m"], row["rmse_standard_error_m"])


def ledger_table(path: str | Path) -> str:
    """Set what the ledger's switches change: a column a switch, a line a metric.

    Args:
        path: `ledger.json`.

    Returns:
        Markdown; the pooled column is the default's own, averaged otherwise. Beside each RMSE
        stands its standard error over holds.

    Raises:
        ValueError: The file was edited by hand.
        FileNotFoundError: There is no such file.
    """
    file = read_result_file(path)
    columns = [(_SWITCHED.get(row["method"], row["method"]), row) for row in file.rows]
    default = dict(columns).get(DEFAULT)
    if default is not None:
        doubtless = {"rmse_standard_error_m": None}  # of a mean over frames, which this is none
        columns.insert(1, ("metrics pooled", {**default, **default["pooled"], **doubtless}))
    lines = [
        [title, *(f"{factor * row[column]:.2f}" for _, row in columns)]
        for column, title, factor in METRICS
    ]
    lines[0][1:] = [
        cell if row["rmse_standard_error_m"] is None else _with_doubt(row)
        for cell, (_, row) in zip(lines[0][1:], columns, strict=True)
    ]
    epochs = [
        f"{row['epochs']} epochs, seed {' '.join(map(str, row['seeds']))}" for _, row in columns
    ]
    lines.append(["trained", *epochs])
    return markdown_table(["metric", *(name for name, _ in columns)], lines)


def ledger_effects(folder: str | Path) -> str:
    """List what each measured row of the ledger does to HADR's error on known objects.

    Args:
        folder: Has `ledger.json`, `segmentation.json` and `keypoints.json`.

    Returns:
        Markdown, a line a row: its number, what was turned, HADR's RMSE in centimetres as by
        default and with it, the difference, and the file.

    Raises:
        ValueError: A file was edited by hand.
        FileNotFoundError: A file is missing.
        KeyError: A row is missing.
    """
    read = {
        name: read_result_file(Path(folder) / f"{name}.json")
        for name in ("ledger", "segmentation", "keypoints")
    }
    default = read["ledger"].row(method=DEFAULT)
    lines = []
    for number, words, name, wanted in _EFFECTS:
        if name == "ledger":
            before = default["rmse_m"]
            turned = default["pooled"] if wanted is None else read[name].row(method=wanted)
            after = turned["rmse_m"]
        else:
            both = (read[name].row(method="hadr", given=given) for given in ("all true", wanted))
            before, after = (row["rmse_m"] for row in both)
        cells = [f"{100 * before:.2f}", f"{100 * after:.2f}", f"{100 * (after - before):+.2f}"]
        lines.append([f"[{number}](#ledger-{number})", words, *cells, f"`{name}.json`"])
    head = ["row", "what is turned", "default (cm)", "turned (cm)", "difference", "from"]
    return markdown_table(head, lines, "llrrrl")


def conditions_table(folder: str | Path) -> str:
    """Set each method's error under all conditions: true or predicted masks, keypoints, sensor.

    Args:
        folder: Has `keypoints.json` and `segmentation.json`.

    Returns:
        Markdown: RMSE in centimetres and its standard error over holds, a line a method, a column
        a condition; "-" where a method has nothing of what is predicted.

    Raises:
        ValueError: A file was edited by hand.
        FileNotFoundError: A file is missing.
    """
    rows: dict[tuple[str, str], Mapping[str, Any]] = {}
    for name in ("segmentation", "keypoints"):
        file = read_result_file(Path(folder) / f"{name}.json")
        rows |= {(row["method"], row["given"]): row for row in file.rows}
    methods = list(dict.fromkeys(method for method, _ in rows))
    given = list(dict.fromkeys(condition for _, condition in rows))
    lines = []
    for method in methods:
        found = [rows.get((method, condition)) for condition in given]
        cells = ["-" if row is None else _with_doubt(row) for row in found]
        lines.append([_title(method), *cells])
    shared = [next(row for (_, c), row in rows.items() if c == condition) for condition in given]
    masks = [f"{row['mask_iou']:.2f}" for row in shared]
    hands = [f"{100 * row['keypoints_m']:.1f}" for row in shared]
    lines.append(["*IoU of the masks given*", *masks])
    lines.append(["*error of the keypoints given (cm)*", *hands])
    return markdown_table(["method", *given], lines)


def tuning_table(path: str | Path) -> str:
    """Set the trials that each network had, the best of each in bold.

    Args:
        path: `tuning.json`.

    Returns:
        Markdown: validation RMSE in centimetres, a line a network, a column a trial that all had;
        below it the trials that one network alone had.

    Raises:
        ValueError: The file was edited by hand.
        FileNotFoundError: There is no such file.
    """
    rows = read_result_file(path).rows
    networks = {row["network"] for row in rows}
    asked = {t: {r["network"] for r in rows if r["trial"] == t} for t in (r["trial"] for r in rows)}
    trials = [trial for trial, had in asked.items() if had == networks]
    lines = []
    for network in dict.fromkeys(row["network"] for row in rows):
        mine = [r for r in rows if r["network"] == network and r["trial"] in trials]
        own = {row["trial"]: row["rmse_m"] for row in mine}
        best = min(own.values())
        cells = [f"{100 * own[trial]:.2f}" for trial in trials]
        cells = [
            f"**{cell}**" if own[trial] == best else cell
            for trial, cell in zip(trials, cells, strict=True)
        ]
        lines.append([_title(network), *cells])
    table = markdown_table(["network", *trials], lines)
    alone = [
        f"{_title(row['network'])}, {row['trial']}: {100 * row['rmse_m']:.2f}"
        for row in rows
        if row["trial"] not in trials
    ]
    return f"{table}\n\nBeyond these, {'; '.join(alone)}." if alone else table


def speed_table(path: str | Path) -> str:
    """Set time, memory and weights of all methods side by side.

    Args:
        path: `side_by_side.json`.

    Returns:
        Markdown, a line a method and preset.

    Raises:
        ValueError: The file was edited by hand.
        FileNotFoundError: There is no such file.
    """
    file = read_result_file(path)
    head = ["method", "preset", "input", "time of a frame (ms)", "memory (MiB)", "weights (M)"]
    lines = []
    for row in file.rows:
        width, height = row["input"]
        memory = row.get("peak_rss_bytes")
        lines.append(
            [
                _title(row["method"]),
                row["preset"] or "-",
                f"{width}x{height}",
                f"{row['wall_median_ms']:.1f}",
                "-" if memory is None else f"{memory / 2**20:.0f}",
                f"{row['parameters'] / 1e6:.2f}",
            ]
        )
    return markdown_table(head, lines, "llr")


def _title(method: str) -> str:
    return NAMES.get(method, method)
