"""The report: each number of the paper's tables, ours, the difference, and where ours is from.

It is made from the result files and `paper_tables.json`, whether these are the repository's own or
what `hadr reproduce` has just written, and the book's page *The paper's tables, and ours* is it.
The tables are HTML, for their rows of one method belong together, and must fit on a phone.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from jinja2 import Environment
from markupsafe import Markup

from hadr.experiments.steps import seconds_text
from hadr.figures.tables.comparison import PUBLISHED_NAMES
from hadr.figures.tables.handover import CONDITIONS
from hadr.figures.tables.results import NAMES
from hadr.metrics import METRICS, best_in_bold
from hadr.records.result_file import ResultFile, read_result_file

TITLES = {
    "known": "Known objects",
    "unknown": "Unknown objects",
    "ablation": "Ablation of HADR, known objects",
    "handover": "Handover",
}
"""The paper's tables, of which the first prints two; each has a result file of this name."""
HANDOVER_NAMES = {"raw": "GraspNet", "hadr": "HADR + GraspNet"}
"""Names of our conditions in the paper's table of the handover."""
HANDOVER_COLUMNS = ("successes", "rate", "> 50 %", "> 80 %", "100 %")
NOT_RUN = "not measured here: the command below makes it"
"""Why a number of ours is missing; all of the paper's rows have a counterpart of ours."""

Method = tuple[str, dict[str, list[str]], dict[str, str]]
"""A row's name, its lines of numbers, and where they are from, the summary of that first."""


def report(results: str | Path, published: str | Path, size: str = "mini") -> str:
    """Set the published tables, `paper_tables.json`, beside those of a folder of result files.

    Gives Markdown with one section for each of known.json, unknown.json, ablation.json and
    handover.json that is there: the paper's rows with the paper's number, ours and the difference,
    then the rows that the paper has not; below each stand command, for a preset, run time and
    provenance.
    """
    paper = json.loads(Path(published).read_text(encoding="utf-8"))
    parts = []
    for name, title in TITLES.items():
        path = Path(results) / f"{name}.json"
        if path.exists():
            file = read_result_file(path)
            if name == "handover":
                section = _handover(file, paper[name], size)
            else:
                theirs = {
                    row: dict(zip(paper["columns"], numbers, strict=True))
                    for row, numbers in paper[name].items()
                }
                section = _depth(name, file, theirs, size)
            of = f", preset {size}" * (name != "handover")
            parts.append(f"## {title}{of}\n\n{section}\n\n{_origin(path, file.provenance)}")
    return "\n\n".join(parts) + "\n"


def _origin(path: Path, told: Mapping[str, Any]) -> str:
    """The file's own provenance, in a sentence."""
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


def _depth(name: str, file: ResultFile, paper: Mapping[str, Mapping[str, float]], size: str) -> str:
    rows = {PUBLISHED_NAMES.get(row["method"], row["method"]): row for row in file.rows}
    run = {title: method for method, title in PUBLISHED_NAMES.items()}
    listed: list[Method] = []
    for title in dict.fromkeys([*paper, *rows]):
        row, theirs, label, lines = rows.get(title), paper.get(title), title, dict[str, list[str]]()
        if theirs is not None:
            lines["paper"] = [
                metric.text(theirs.get(key), digits=1 if metric.factor == 100 else 2)
                for key, metric in METRICS.items()
            ]  # as many digits as are printed
        if row is None:
            listed.append((label, lines, {"command": _code(_command(name, run[title], size))}))
            continue
        label = NAMES.get(row["method"], row["method"])
        lines["ours"] = [metric.text(row.get(key)) for key, metric in METRICS.items()]
        if theirs is not None:
            label = _both(title, label)
            gaps = {key: row[key] - theirs[key] for key in METRICS if key in row and key in theirs}
            lines["difference"] = [
                metric.text(gaps.get(key), sign="+") for key, metric in METRICS.items()
            ]
        listed.append((label, lines, _making(name, row, size)))
    frames = " or ".join(str(n) for n in sorted({row["frames"] for row in file.rows}))
    words = f"{frames} test frames; ours is the mean over them. The difference is ours minus the "
    heads = [metric.heading for metric in METRICS.values()]
    return _section(f"{words}paper's.", heads, listed, TITLES[name], "rows of ours")


def _making(name: str, row: Mapping[str, Any], size: str) -> dict[str, str]:
    """Command, run time and provenance of a row of a depth table."""
    command = _command(name, row["configuration"]["run"].rsplit("/", 1)[0], size)
    seeds = " ".join(map(str, row["seeds"]))
    if seeds != "0":
        command += f" --seeds {seeds}"
    if (corruption := row["configuration"]["data"]["corruption"]) != "oracle":
        command += f" --corruption {corruption}"
    each = " a seed" if len(row["seeds"]) > 1 else ""
    scoring, training = row.get("evaluation_s"), row.get("training_s")
    times = [f"{seconds_text(training)} of training{each}"] if training else []
    times += [f"{seconds_text(scoring)} of scoring{each}"] if scoring else []
    if training and (threads := row.get("threads")):
        times.append(f"{threads} thread{'' if threads == 1 else 's'}")
    told = {"command": _code(command), "run time": ", ".join(times) or "not recorded"}
    if row.get("parameters"):
        told["weights"] = f"{row['parameters'] / 1e6:.2f} million"
    spread, origin = row["seed_sd"]["rmse_m"], row["provenance"]
    doubt = "" if spread is None else f"; standard deviation of RMSE {100 * spread:.3f} cm"
    commits = Markup(", ").join(_code(commit[:7]) for commit in origin["commit"])
    if origin.get("uncommitted_changes"):
        commits += ", with changes beside it that were not committed"
    told["standard error"] = f"of RMSE {100 * row['rmse_standard_error_m']:.2f} cm, over holds"
    told |= {"seeds": f"{len(row['seeds'])} ({seeds}){doubt}", "commit": commits}
    told |= {"machine": origin["machine"], "recipe": _code(row["config_sha256"][0][:7])}
    return {f"command, {seconds_text((training or 0) + (scoring or 0))}{each}, origin": "", **told}


def _command(name: str, run: str, size: str) -> str:
    data = {"tiny": "", "imagenet": " --data NEAR"}.get(size, " --data DIR data_samples/frames")
    wish = run if "/" in run else f"{'known' if name == 'ablation' else name}/{run}"
    if name == "ablation" and run == "full":
        wish = "known/hadr"
    out = "OUT1" if size == "imagenet" else "OUT"
    return f"hadr reproduce --preset {size}{data} --out {out} --only {wish}"


def _handover(file: ResultFile, paper: Mapping[str, Any], size: str) -> str:
    ours = {row["condition"]: row for row in file.rows}
    of_all, objects = int(paper["attempts"]), int(paper["objects"])
    listed: list[Method] = []
    for condition in dict.fromkeys([*HANDOVER_NAMES, *ours]):
        row, lines = ours.get(condition), dict[str, list[str]]()
        label = CONDITIONS.get(condition, condition)
        if title := HANDOVER_NAMES.get(condition):
            won, *reached = paper[title]
            rate = f"{paper['success_rate_percent'][title]:.1f} %"
            lines["paper"] = [f"{won}/{of_all}", rate, *(f"{count}/{objects}" for count in reached)]
        command = f"hadr handover --conditions {condition} --out OUT"
        if row is None:
            listed.append((title or label, lines, {"command": _code(command)}))
            continue
        own = [int(row[f"objects_at_{share}_percent"]) for share in (50, 80, 100)]
        there = sorted(row["rate_by_object"])
        lines["ours"] = [f"{row['successes']}/{row['attempts']}", f"{100 * row['rate']:.1f} %"]
        lines["ours"] += [f"{count}/{len(there)}" for count in own]
        if title:
            label, same = _both(title, label), len(there) == objects
            gap = f"{row['successes'] - won:+d}" if row["attempts"] == of_all else "-"
            lines["difference"] = [gap, f"{100 * row['rate'] - 100 * won / of_all:+.1f}"]
            counts = zip(own, reached, strict=True)
            lines["difference"] += [f"{a - b:+d}" if same else "-" for a, b in counts]
        if row["attempts"] < of_all:
            command += f" --objects {' '.join(there)}"
        took = seconds_text(row["attempts"] * row["mean_wall_seconds"])
        low, high = (100 * edge for edge in row["interval"])
        origin = row.get("provenance", file.provenance)  # of a row that was measured again
        told = {
            f"command, {took}, origin": "",
            "command": _code(command),
            "run time": f"{took} for {row['attempts']} attempts, one at a time",
            "rate": f"95 % interval {low:.0f} to {high:.0f} %",
            "commit": _code((origin["commit"] or "unknown")[:7]),
            "machine": str(origin["machine"]),
        }
        listed.append((label, lines, told))
    words = (
        "The paper's attempts were made by a real arm and a real hand, with grasps of GraspNet; "
        "ours by simulated ones, with the simulator's masks and keypoints, made noisy, and with "
        "grasps of a sampler of our own. So only the rates' order may be compared, and not that of "
        "rates as near as these of 48 attempts: chapter 13 has more of some, the rows of "
        "`mini/handover_seeds.json`, and says what came out otherwise when all was made again. "
        "The last three columns count the objects of which more than half, more than 80 %, or all "
        "attempts succeed."
    )
    return _section(words, HANDOVER_COLUMNS, listed, TITLES["handover"], "conditions of ours")


def _both(title: str, own: str) -> str:
    """The paper's name of a row, and ours where it is another."""
    return title if own in title or title in own else f"{title} (ours: {own})"


def _short(sha: str | None) -> str:
    return f"`{(sha or 'unknown')[:7]}`"


def _code(text: str) -> Markup:
    return Markup("<code>{}</code>").format(text)


def _section(
    words: str, heads: Sequence[str], listed: Sequence[Method], title: str, more: str
) -> str:
    """The paper's rows as a table, and below it those that only we have."""
    paper, ours = (
        [one for one in listed if ("paper" in one[1]) is there] for there in (True, False)
    )
    titles = [head.partition(" (") for head in heads]
    for kind in ("paper", "ours"):
        _embolden(listed, kind, heads)
    where = " (it may stand in the next table)" if ours else ""
    about = f"{title}: the paper's rows beside ours; the best of either{where} is bold."
    parts = [words, _TABLE.render(heads=titles, listed=paper, missing=NOT_RUN, caption=about)]
    if ours:
        about = f"{title}: {more} that the paper's table does not have."
        parts.append(_TABLE.render(heads=titles, listed=ours, caption=about))
    return "\n\n".join(parts)


def _embolden(listed: Sequence[Method], kind: str, heads: Sequence[str]) -> None:
    """Set the best of the paper's numbers, or of ours, in bold; perfect depth does not compete."""
    best_of = [one for one in listed if not one[0].startswith(CONDITIONS["perfect"])]
    rows = [lines for _, lines, _ in best_of if kind in lines]
    cells = pd.DataFrame([lines[kind] for lines in rows], columns=list(heads))
    for lines, row in zip(rows, best_in_bold(cells, [range(len(rows))]).to_numpy(), strict=True):
        bold = Markup("<b>{}</b>")
        lines[kind] = [bold.format(cell[2:-2]) if "**" in cell else cell for cell in row]


_TABLE = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True).from_string("""\
<table class="table paper-table">
<caption>{{ caption }}</caption>
<thead><tr><td></td>
{%- for name, bracket, unit in heads -%}
<th scope="col">{{ name }}{% if unit %}<br/>({{ unit }}{% endif %}</th>
{%- endfor %}</tr></thead>
{% for label, lines, told in listed %}
<tbody>
<tr class="method"><th colspan="{{ heads | length + 1 }}" scope="rowgroup">{{ label }}</th></tr>
{% for name, numbers in lines.items() %}
<tr class="{{ name }}"><th scope="row">{{ name }}</th>
{%- for number in numbers %}<td>{{ number }}</td>{% endfor %}</tr>
{% endfor %}
{% if "ours" not in lines %}
<tr class="ours"><th scope="row">ours</th><td colspan="{{ heads | length }}">{{ missing }}</td></tr>
{% endif %}
<tr class="origin"><td colspan="{{ heads | length + 1 }}"><details>
{%- for term, text in told.items() -%}
{% if loop.first %}<summary>{{ term }}</summary><dl>{% endif %}
{% if text %}<dt>{{ term }}</dt><dd>{{ text }}</dd>{% endif %}
{% endfor -%}
</dl></details></td></tr>
</tbody>
{% endfor %}
</table>""")
