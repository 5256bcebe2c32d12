"""The report: each number of the paper's four tables, ours, the difference, and where ours is from.

It is made from the result files and `paper_tables.json`, whether these are the repository's own or
what `hadr reproduce` has just written, and the book's page *The paper's tables, and ours* is it.
The tables are HTML, for their rows of one method belong together, and must fit on a phone.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from hadr.experiments.reproduction_plan import seconds_text
from hadr.figures.tables.comparison import PUBLISHED_NAMES
from hadr.figures.tables.handover import ARMS
from hadr.figures.tables.results import NAMES
from hadr.press.report import METRICS
from hadr.records.result_file import ResultFile, read_result_file

TITLES = {
    "known": "Known objects",
    "unknown": "Unknown objects",
    "ablation": "Ablation of HADR, known objects",
    "handover": "Handover",
}
"""The paper's four tables; each has a result file of this name."""
HANDOVER_NAMES = {"raw": "GraspNet", "hadr": "HADR + GraspNet"}
"""Names of our arms in the paper's table of the handover."""
HANDOVER_COLUMNS = ("successes", "rate", "> 50 %", "> 80 %", "100 %")
NOT_RUN = "not measured here: the command below makes it"
"""Why a number of ours is missing; all of the paper's rows have a counterpart of ours."""


def report(results: str | Path, published: str | Path, size: str = "mini") -> str:
    """Set the paper's tables beside those of a folder of result files.

    Args:
        results: The folder, with any of known.json, unknown.json, ablation.json, handover.json.
        published: The paper's tables, `results/paper_tables.json`.
        size: The preset, for the commands.

    Returns:
        Markdown with one section a table, the tables in HTML: the paper's rows with the paper's
        number, ours and the difference; then the rows that the paper has not. Below each stand
        command, run time and provenance.

    Raises:
        ValueError: A result file was edited by hand, or there is none.
        FileNotFoundError: The paper's tables are missing.
    """
    paper = json.loads(Path(published).read_text(encoding="utf-8"))
    parts = []
    for name, title in TITLES.items():
        path = Path(results) / f"{name}.json"
        if path.exists():
            file = read_result_file(path)
            make = _handover if name == "handover" else _depth
            parts.append(f"## {title}\n\n{make(name, file, paper[name], size)}\n\n{_origin(path)}")
    if not parts:
        raise ValueError(f"{results} has none of the files {', '.join(TITLES)}")
    return "\n\n".join(parts) + "\n"


def _origin(path: Path) -> str:
    """The file's own provenance, in a sentence."""
    file = read_result_file(path)
    told = file.provenance
    versions = ", ".join(
        f"{title} {told['versions'][name]}"
        for name, title in (("torch", "PyTorch"), ("numpy", "NumPy"), ("mujoco", "MuJoCo"))
        if name in told["versions"]
    )
    data = f"; data {_short(told['data']['sha256'])}" if "data" in told else ""
    return (
        f"All of this stands in `{path.parent.name}/{path.name}`, written {told['created'][:10]} "
        f"at commit {_short(told['commit'])} on {told['machine']}, {versions}{data}; the file's "
        f"checksum is {_short(told['sha256'])}."
    )


def _depth(name: str, file: ResultFile, paper: Mapping[str, Sequence[float]], size: str) -> str:
    rows = {PUBLISHED_NAMES.get(row["method"], row["method"]): row for row in file.rows}
    run = {title: method for method, title in PUBLISHED_NAMES.items()}
    ours_alone = [row for title, row in rows.items() if title not in paper]
    frames = " or ".join(str(n) for n in sorted({row["frames"] for row in file.rows}))
    heads = [title for _, title, _ in METRICS]
    bodies = []
    for title, numbers in paper.items():
        row = rows.get(title)
        theirs = [factor * x for x, (_, _, factor) in zip(numbers, METRICS, strict=True)]
        printed = [f"{x:.1f}" if i < 3 else f"{x:.2f}" for i, x in enumerate(theirs)]
        if row is None:
            origin = _details([("command", _code(_command(name, run[title], size)))], "command")
            bodies.append(_body(title, heads, [("paper", printed)], origin, NOT_RUN))
            continue
        own = _own(row)
        gaps = [f"{a - b:+.2f}" for a, b in zip(own, theirs, strict=True)]
        lines = [("paper", printed), ("ours", [f"{x:.2f}" for x in own]), ("difference", gaps)]
        label = _both(title, NAMES.get(row["method"], row["method"]))
        bodies.append(_body(label, heads, lines, _making(name, row, size)))
    parts = [
        f"{frames} test frames; ours is the mean over them. The difference is ours minus the "
        "paper's.",
        _table(heads, bodies),
    ]
    if ours_alone:
        alone = [
            _body(
                NAMES.get(row["method"], row["method"]),
                heads,
                [("ours", [f"{x:.2f}" for x in _own(row)])],
                _making(name, row, size),
            )
            for row in ours_alone
        ]
        parts += ["Rows of ours that the paper's table does not have:", _table(heads, alone)]
    return "\n\n".join(parts)


def _own(row: Mapping[str, Any]) -> list[float]:
    return [factor * row[column] for column, _, factor in METRICS]


def _making(name: str, row: Mapping[str, Any], size: str) -> str:
    """Command, run time and provenance of a row of a depth table."""
    run = row["configuration"]["run"].rsplit("/", 1)[0]
    command = _command(name, run, size)
    seeds = " ".join(map(str, row["seeds"]))
    if seeds != "0":
        command += f" --seeds {seeds}"
    corruption = row["configuration"]["data"]["corruption"]
    if corruption != "oracle":
        command += f" --corruption {corruption}"
    each = " a seed" if len(row["seeds"]) > 1 else ""
    scoring, training = row.get("evaluation_s"), row.get("training_s")
    times = [f"{seconds_text(training)} of training{each}"] if training else []
    times += [f"{seconds_text(scoring)} of scoring{each}"] if scoring else []
    threads = row.get("threads")
    if training and threads:
        times.append(f"{threads} thread{'' if threads == 1 else 's'}")
    told = [("command", _code(command)), ("run time", ", ".join(times) or "not recorded")]
    if row.get("parameters"):
        told.append(("weights", f"{row['parameters'] / 1e6:.2f} million"))
    spread = row["seed_sd"]["rmse_m"]
    words = f"{len(row['seeds'])} ({seeds})"
    if spread is not None:
        words += f"; standard deviation of RMSE {100 * spread:.3f} cm"
    told.append(("seeds", words))
    origin = row["provenance"]
    commits = ", ".join(_code(commit[:7]) for commit in origin["commit"])
    if origin.get("uncommitted_changes"):
        commits += ", with changes beside it that were not committed"
    told += [
        ("commit", commits),
        ("machine", escape(origin["machine"])),
        ("recipe", _code(row["config_sha256"][0][:7])),
    ]
    return _details(
        told, f"command, {seconds_text((training or 0) + (scoring or 0))}{each}, origin"
    )


def _command(name: str, run: str, size: str) -> str:
    data = "" if size == "tiny" else " --data DIR data_samples/frames"
    wish = run if "/" in run else f"{'known' if name == 'ablation' else name}/{run}"
    if name == "ablation" and run == "full":
        wish = "known/hadr"
    return f"hadr reproduce --preset {size}{data} --out OUT --only {wish}"


def _handover(name: str, file: ResultFile, paper: Mapping[str, Any], size: str) -> str:
    ours = {row["arm"]: row for row in file.rows}
    of_all, objects = int(paper["attempts"]), int(paper["objects"])
    bodies = []
    for arm, title in HANDOVER_NAMES.items():
        won, *reached = paper[title]
        theirs = [f"{won}/{of_all}", f"{paper['success_rate_percent'][title]:.1f} %"]
        theirs += [f"{count}/{objects}" for count in reached]
        row = ours.get(arm)
        if row is None:
            origin = _details([("command", _code(_arm_command(arm)))], "command")
            bodies.append(_body(title, HANDOVER_COLUMNS, [("paper", theirs)], origin, NOT_RUN))
            continue
        gap = [f"{row['successes'] - won:+d}"] if row["attempts"] == of_all else ["-"]
        gap.append(f"{100 * row['rate'] - 100 * won / of_all:+.1f}")
        same = len(row["rate_by_object"]) == objects
        counts = zip(_reached(row), reached, strict=True)
        gap += [f"{a - b:+d}" if same else "-" for a, b in counts]
        lines = [("paper", theirs), ("ours", _attempts(row)), ("difference", gap)]
        label = _both(title, ARMS[arm])
        bodies.append(_body(label, HANDOVER_COLUMNS, lines, _making_of(arm, row, file)))
    rest = [
        _body(ARMS.get(arm, arm), HANDOVER_COLUMNS, [("ours", _attempts(row))],
              _making_of(arm, row, file))
        for arm, row in ours.items()
        if arm not in HANDOVER_NAMES
    ]  # fmt: skip
    parts = [
        "The paper's attempts were made by a real arm and a real hand, with grasps of GraspNet; "
        "ours by simulated ones, with the simulator's masks and keypoints, made noisy, and with "
        "grasps of a sampler of our own. So only the rates' order may be compared. The last three "
        "columns count the objects of which more than half, more than 80 %, or all attempts "
        "succeed.",
        _table(HANDOVER_COLUMNS, bodies),
    ]
    if rest:
        parts += ["Arms of ours that the paper's table does not have:",
                  _table(HANDOVER_COLUMNS, rest)]  # fmt: skip
    return "\n\n".join(parts)


def _attempts(row: Mapping[str, Any]) -> list[str]:
    counts = [f"{count}/{len(row['rate_by_object'])}" for count in _reached(row)]
    return [f"{row['successes']}/{row['attempts']}", f"{100 * row['rate']:.1f} %", *counts]


def _reached(row: Mapping[str, Any]) -> list[int]:
    return [int(row[f"objects_at_{share}_percent"]) for share in (50, 80, 100)]


def _arm_command(arm: str) -> str:
    return f"hadr handover --arms {arm} --out OUT"


def _making_of(arm: str, row: Mapping[str, Any], file: ResultFile) -> str:
    """Command, run time and provenance of an arm of the handover."""
    seconds = row["attempts"] * row["mean_wall_seconds"]
    low, high = (100 * edge for edge in row["interval"])
    origin = file.provenance
    names = sorted(row["rate_by_object"])
    command = _arm_command(arm)
    if row["attempts"] < 48:
        command += f" --objects {' '.join(names)}"
    told = [
        ("command", _code(command)),
        ("run time", f"{seconds_text(seconds)} for {row['attempts']} attempts, one at a time"),
        ("rate", f"95 % interval {low:.0f} to {high:.0f} %"),
        ("commit", _code((origin["commit"] or "unknown")[:7])),
        ("machine", escape(str(origin["machine"]))),
    ]
    return _details(told, f"command, {seconds_text(seconds)}, origin")


def _both(title: str, own: str) -> str:
    """The paper's name of a row, and ours where it is another."""
    return title if own in title or title in own else f"{title} (ours: {own})"


def _short(sha: str) -> str:
    return f"`{sha[:7]}`"


def _code(text: str) -> str:
    return f"<code>{escape(text)}</code>"


def _details(told: Sequence[tuple[str, str]], summary: str) -> str:
    items = "".join(f"<dt>{name}</dt><dd>{value}</dd>" for name, value in told)
    return f"<details><summary>{escape(summary)}</summary><dl>{items}</dl></details>"


def _body(
    label: str,
    heads: Sequence[str],
    lines: Sequence[tuple[str, Sequence[str]]],
    origin: str,
    missing: str = "",
) -> str:
    """One method of a table: its name, its lines of numbers, and where they are from."""
    span = len(heads) + 1
    parts = [f'<tr class="method"><th colspan="{span}" scope="rowgroup">{escape(label)}</th></tr>']
    for name, numbers in lines:
        cells = "".join(f"<td>{escape(number)}</td>" for number in numbers)
        parts.append(f'<tr class="{name}"><th scope="row">{name}</th>{cells}</tr>')
    if missing:
        parts.append(f'<tr class="ours"><th scope="row">ours</th><td colspan="{span - 1}">'
                     f"{escape(missing)}</td></tr>")  # fmt: skip
    parts.append(f'<tr class="origin"><td colspan="{span}">{origin}</td></tr>')
    return "<tbody>\n" + "\n".join(parts) + "\n</tbody>"


def _table(heads: Sequence[str], bodies: Sequence[str]) -> str:
    """A table without an empty line, which would end it in Markdown."""
    cells = "".join(f'<th scope="col">{_head(title)}</th>' for title in heads)
    head = f"<thead><tr><td></td>{cells}</tr></thead>"
    return "\n".join(['<table class="table paper-table">', head, *bodies, "</table>"])


def _head(title: str) -> str:
    name, _, unit = title.partition(" (")
    return f"{escape(name)}<br/>({escape(unit)}" if unit else escape(title)
