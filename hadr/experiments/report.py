"""The report: the paper's tables beside ours, with what each of our rows cost and comes from.

It is made from the result files and `paper_tables.json`, whether these are the repository's own or
what `hadr reproduce` has just written, and the book's page *The paper's tables, and ours* is it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hadr.markdown import markdown_table
from hadr.plotting.comparison import PUBLISHED_NAMES
from hadr.plotting.results import NAMES
from hadr.result_file import ResultFile, read_result_file

TITLES = {
    "known": "Known objects",
    "unknown": "Unknown objects",
    "ablation": "Ablation of HADR, known objects",
}
"""The paper's tables that have a result file."""
DEFAULT = "as by default"
"""The ledger's column that has every switch as the project has it."""
_SWITCHED = {
    "coded-weights": "loss weights as coded",
    "wrist-translation": "wrist without rotation",
    "clamped-probability": "probability clamped",
}
"""How the ledger's switches are called above their columns."""
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
    parts = [
        "Each command is the end of `hadr reproduce --preset "
        f"{size} --data DIR data_samples/frames --out OUT`, where DIR is what `hadr generate "
        f"--preset {size}` has made."
        if size != "tiny"
        else "Each command is the end of `hadr reproduce --preset tiny --out OUT`."
    ]
    for name, title in TITLES.items():
        path = Path(results) / f"{name}.json"
        if path.exists():
            parts.append(_section(title, name, read_result_file(path), paper))
    if len(parts) == 1:
        raise ValueError(f"{results} has none of the files {', '.join(TITLES)}")
    return "\n\n".join(parts) + "\n"


def _section(title: str, name: str, file: ResultFile, paper: Mapping[str, Any]) -> str:
    frames = sorted({row["frames"] for row in file.rows})
    lines = [
        f"## {title}",
        "",
        f"{' or '.join(map(str, frames))} test frames. Each cell: the paper's number on its data, "
        "**ours** on ours (mean over the frames), and the difference, ours minus the paper's.",
        "",
        _pairs(file.rows, paper[name]),
        "",
        "How each of our rows was made:",
        "",
        _makings(file.rows),
    ]
    if any(row["provenance"].get("uncommitted_changes") for row in file.rows):
        lines += [
            "",
            "\\* of this commit, with changes beside it that were not committed.",
        ]
    origin = file.provenance
    torch, numpy = (origin["versions"].get(name, "?") for name in ("torch", "numpy"))
    lines += [
        "",
        f"`{name}.json`, written {origin['created']} on {origin['machine']}, PyTorch {torch}, "
        f"NumPy {numpy}; data {_short(origin['data']['sha256'])}, checksum "
        f"{_short(origin['sha256'])}.",
    ]
    return "\n".join(lines)


def _pairs(rows: Sequence[Mapping[str, Any]], paper: Mapping[str, Sequence[float]]) -> str:
    lines = []
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
        lines.append([_title(row["method"]), *cells])
    return markdown_table(["method", *(title for _, title, _, _ in _COLUMNS)], lines)


def _makings(rows: Sequence[Mapping[str, Any]]) -> str:
    head = [
        "command", "training (min)", "weights (M)", "seeds", "SD of RMSE (cm)", "commit",
        "recipe",
    ]  # fmt: skip
    lines = []
    for row in rows:
        run = row["configuration"]["run"].rsplit("/", 1)[0]
        minutes = f"{row['training_s'] / 60:.1f}" if row.get("training_s") else "-"
        weights = f"{row['parameters'] / 1e6:.2f}" if row.get("parameters") else "-"
        spread = row["seed_sd"]["rmse_m"]
        seeds = " ".join(map(str, row["seeds"]))
        if seeds != "0":
            run += f" --seeds {seeds}"
        corruption = row["configuration"]["data"]["corruption"]
        if corruption != "oracle":
            run += f" --corruption {corruption}"
        commits = ", ".join(commit[:7] for commit in row["provenance"]["commit"])
        if row["provenance"].get("uncommitted_changes"):
            commits += " \\*"
        cells = [
            f"`--only {run}`",
            minutes,
            weights,
            str(len(row["seeds"])),
            "-" if spread is None else f"{100 * spread:.3f}",
            commits,
            _short(row["config_sha256"][0]),
        ]
        lines.append(cells)
    return markdown_table(head, lines, "lrrrrll")


def _short(sha: str) -> str:
    return f"`{sha[:7]}`"


def _with_doubt(row: Mapping[str, Any]) -> str:
    return f"{100 * row['rmse_m']:.2f} ± {100 * row['rmse_standard_error_m']:.2f}"


def _title(method: str) -> str:
    return NAMES.get(method, method)


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
        [title, *(f"{factor * row[column]:.{digits}f}" for _, row in columns)]
        for column, title, factor, digits in _COLUMNS
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
