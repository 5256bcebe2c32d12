"""The report's other tables: conditions, the ledger's switches, trials, speed; from result files.

The paper's own tables beside ours are made by `hadr.press.paper_report`.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from hadr.experiments.averages import standard_error
from hadr.experiments.tables import DEFAULT
from hadr.figures.tables.results import NAMES, markdown, rmse_cm, with_doubt
from hadr.metrics import METRICS
from hadr.records.result_file import read_result_file, read_result_files, read_sealed

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
    (8, "simulated sensor around the glass, in it no depth as before", "segmentation",
     "simulated sensor"),
    (9, "predicted keypoints", "keypoints", "predicted keypoints"),
    (14, "split by frame instead of by hold", "ledger", "split by frame"),
    (15, "metrics pooled over all pixels", "ledger", None),
)  # fmt: skip
"""The ledger's rows that were measured: number, the change, the result file, and its row there."""


def _cells(row: Mapping[str, Any]) -> dict[str, str]:
    """All metrics of a row by their headings."""
    return {metric.heading: metric.text(row.get(name)) for name, metric in METRICS.items()}


def ledger_table(path: str | Path) -> str:
    """What the switches of `ledger.json` change, as Markdown: a column a switch, a line a metric.

    The pooled column is the default's own, averaged otherwise; beside each other RMSE stands its
    standard error over holds.
    """
    columns = {}
    for row in read_result_file(path).rows:
        made = f"{row['epochs']} epochs, seed {' '.join(map(str, row['seeds']))}"
        name = _SWITCHED.get(row["method"], row["method"])
        columns[name] = {**_cells(row), "RMSE (cm)": rmse_cm(row), "trained": made}
        if row["method"] == DEFAULT:
            columns["metrics pooled"] = {**_cells(row["pooled"]), "trained": made}
    return markdown(pd.DataFrame(columns).rename_axis("metric").reset_index())


def ledger_effects(folder: str | Path) -> str:
    """What each measured row of the ledger does to HADR's error on known objects, as Markdown."""
    names = ("ledger", "segmentation", "keypoints")
    read = {name: read_result_file(Path(folder) / f"{name}.json") for name in names}
    default = read["ledger"].row(method=DEFAULT)
    lines = []
    for number, words, name, wanted in _EFFECTS:
        if name == "ledger":
            before = default
            after = default["pooled"] if wanted is None else read[name].row(method=wanted)
        else:
            before, after = (
                read[name].row(method="hadr", given=given) for given in ("all true", wanted)
            )
        lines.append({
            "row": f"[{number}](#ledger-{number})",
            "what is turned": words,
            "default (cm)": f"{100 * before['rmse_m']:.2f}",
            "turned (cm)": f"{100 * after['rmse_m']:.2f}",
            "difference": f"{100 * (after['rmse_m'] - before['rmse_m']):+.2f}",
            "from": f"`{name}.json`",
        })  # fmt: skip
    return markdown(pd.DataFrame(lines), "llrrrl")


_MEASURED = {
    "RMSE": ("true keypoints", "rmse_m"),
    "shape": ("true keypoints", "shape_m"),
    "RMSE with predicted keypoints": ("predicted keypoints", "rmse_m"),
}
"""What short trainings are compared by, and where it stands in a row of `switches.json`."""


def switch_effects(path: str | Path) -> list[dict[str, Any]]:
    """What the switches of `switches.json` are worth in a short training.

    Returns:
        One a switch, first the trainings without: `turned`, the ledger's `row`, and by the names of
        `_MEASURED` a length with its doubt, metres: of the first the mean and the standard
        deviation over the seeds; of the others the difference from that mean, whose doubt adds the
        paired standard error over holds and the deviation over the first one's seeds.
    """
    file = read_result_file(path)
    groups: dict[str, list[dict[str, Any]]] = {}
    for row in file.rows:
        groups.setdefault(row["turned"], []).append(row)
    effects = list[dict[str, Any]]()
    for turned, rows in groups.items():
        effect: dict[str, Any] = {"turned": turned, "row": rows[0]["row"]}
        for name, (given, part) in _MEASURED.items():
            own, base = (
                np.array([row["given"][given]["per_frame"][part] for row in some])
                for some in (rows, next(iter(groups.values())))
            )  # (seeds, frames)
            seeds = base.mean(axis=1)
            effect[name] = float(seeds.mean()), float(seeds.std(ddof=1))
            if effects:
                gaps = own.mean(axis=0) - base.mean(axis=0)
                among = effect[name][1] * (1 / len(own) + 1 / len(base)) ** 0.5
                of_frames = standard_error(gaps.tolist(), file.provenance["holds"]) or 0
                effect[name] = float(gaps.mean()), float(np.hypot(of_frames, among))
        effects.append(effect)
    return effects


def switches_table(path: str | Path) -> str:
    """`switch_effects` as Markdown, in centimetres; bold is more than twice its doubt."""
    lines = []
    for number, effect in enumerate(switch_effects(path)):
        row = effect["row"]
        line = {"row": f"[{row}](#ledger-{row})" if row else "", "what is turned": effect["turned"]}
        for name in _MEASURED:
            value, doubt = effect[name]
            cell = with_doubt(value, doubt, sign="+" if number else "")
            clear = number and abs(value) > 2 * doubt
            line[f"{name} (cm)"] = f"**{cell}**" if clear else cell
        lines.append(line)
    return markdown(pd.DataFrame(lines), "llr")


def real_table(path: str | Path) -> str:
    """Each method's error on the two real frames of `cleargrasp_d435.json`, as Markdown.

    A line a method, the RMSE in centimetres with its range over the stand-in hands, and the share
    of the glass that got a depth.
    """
    file = read_result_file(path)
    lines: dict[str, dict[str, str]] = {}
    named = {**NAMES, "raw": "the sensor's own depth"}
    for row in file.rows:
        name = row["method"]
        line = lines.setdefault(name, {"method": named.get(name, name)})
        ends = [f"{100 * row[key]:.1f}" for key in ("rmse_low_m", "rmse_high_m") if key in row]
        hands = f" ({' to '.join(ends)})" if ends else ""
        glasses = file.provenance["scenes"][row["scene"]]["glasses"]
        line[f"{glasses} glasses: RMSE (cm)"] = f"{100 * row['rmse_m']:.1f}{hands}"
        line[f"of {glasses} restored (%)"] = f"{100 * row['coverage']:.0f}"
    return markdown(pd.DataFrame(lines.values()))


def conditions_table(folder: str | Path, *names: str) -> str:
    """Each method's error under all conditions: true or predicted masks, keypoints, sensor.

    From the files of these names in a folder, `segmentation` and `keypoints` where none is named,
    as Markdown: RMSE in centimetres and its standard error over holds; "-" where a method has
    nothing of what is predicted.
    """
    rows = pd.DataFrame(read_result_files(folder, *(names or ("segmentation", "keypoints"))).rows)
    rows["error"] = [rmse_cm(row) for _, row in rows.iterrows()]
    rows = rows.drop_duplicates(["method", "given"])
    table = rows.pivot(index="method", columns="given", values="error")
    table = table.reindex(index=rows["method"].unique(), columns=rows["given"].unique())
    own = range(len(table))
    shared = rows.drop_duplicates("given").set_index("given")
    table.loc["*IoU of the masks given*"] = shared["mask_iou"].map("{:.2f}".format)
    hands = (100 * shared["keypoints_m"]).map("{:.1f}".format)
    table.loc["*error of the keypoints given (cm)*"] = hands
    table = table.rename(index=NAMES, columns="{}: RMSE (cm)".format).fillna("-").reset_index()
    return markdown(table, best=[own])


def tuning_table(path: str | Path) -> str:
    """The trials that each network had, as Markdown: validation RMSE in cm, the best in bold.

    A line a network, a column a trial that all had; below, those that one network alone had.
    """
    rows = pd.DataFrame(read_result_file(path).rows)
    rows["network"] = rows["network"].map(lambda name: NAMES.get(name, name))
    table = rows.pivot(index="network", columns="trial", values="rmse_m") * 100
    table = table.reindex(index=rows["network"].unique(), columns=rows["trial"].unique())
    shared = table.dropna(axis="columns")
    cells = shared.map("{:.2f}".format)
    cells = cells.mask(shared.eq(shared.min(axis=1), axis=0), "**" + cells + "**")
    alone = table.drop(columns=shared.columns).stack().dropna()
    more = "; ".join(f"{network}, {trial}: {rmse:.2f}" for (network, trial), rmse in alone.items())
    return markdown(cells.reset_index()) + (f"\n\nBeyond these, {more}." if more else "")


def speed_table(path: str | Path) -> str:
    """Time, memory and weights of all methods of `side_by_side.json`, as Markdown."""
    lines, rows = [], read_result_file(path).rows
    for row in rows:
        memory = row.get("peak_rss_bytes")
        lines.append({
            "method": NAMES.get(row["method"], row["method"]),
            "preset": row["preset"] or "-",
            "input": "{}x{}".format(*row["input"]),
            "time of a frame (ms)": f"{row['wall_min_ms']:.1f}",
            "memory (MiB)": "-" if memory is None else f"{memory / 2**20:.0f}",
            "weights (M)": f"{row['parameters'] / 1e6:.2f}",
        })  # fmt: skip
    best = pd.DataFrame(rows).groupby("preset").indices.values()  # of those that have a preset
    return markdown(pd.DataFrame(lines), "llr", best)


def generation_text(folder: str | Path) -> str:
    """What many frames cost, of `benchmark.json` and `mini_run.json`, in a paragraph."""
    cost, run = (read_sealed(Path(folder) / f"{name}.json") for name in ("benchmark", "mini_run"))
    paper, work = cost["paper_frames"], cost["efficiency_of_2_workers"]
    hours = ", ".join(f"{row['hours']:.1f} h on {row['cores']}" for row in paper["cost"])
    few, size = cost["workers"][1]["frames"], "{width}x{height}".format(**run["folder_settings"])
    calm = run["minutes_at_the_pace_of_the_quickest_tenth"]
    return (
        f"Two workers do {2 * work['at_work']:.2f} times the work of one, "
        f"{2 * work['with_start']:.2f} times with their start in a run of {few} frames. The "
        f"paper's {paper['frames']:,} frames of 1280x720 would take {hours} cores, if many "
        f"workers do as well as two. A whole set of {run['frames']:,} frames of {size} took "
        f"{run['seconds'] / 60:.0f} minutes with two workers ({run['note']}; {calm:.0f} minutes "
        "at the pace of its quickest tenth)."
    )
