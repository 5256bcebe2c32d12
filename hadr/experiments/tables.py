"""The result files: each a table of the book, made from finished runs and nothing else.

    known.json, unknown.json     all methods, on objects known from training and on unknown ones
    ablation.json                the paper's five rows, HADR with one part taken out
    ledger.json                  HADR with one switch of the ledger turned, and frames dealt out
    keypoints.json               true or predicted keypoints
    segmentation.json            true or predicted masks, and the simulated sensor's depth
    ablation_predicted.json      the ablation, with predicted masks and keypoints
    unknown_predicted.json       unknown objects, with what finders predict that never saw them

A row is the mean over its seeds; how it was made stands in it: configuration, commit, versions,
machine.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from hadr.experiments.averages import against, table_rows
from hadr.experiments.conditions import (
    CONDITION_TABLES,
    condition_rows,
)
from hadr.experiments.protocol import EXPERIMENTS, Experiment
from hadr.experiments.runner import Bench, Run
from hadr.experiments.scoring import EVALUATION_SIZE
from hadr.experiments.systems import ALL_METHODS, COMPARED, PARTS, SEEING, SWITCHES
from hadr.models.networks import RIVALS
from hadr.records.provenance import provenance
from hadr.records.result_file import write_result_file

FILES = ("known", "unknown", "ablation", "ledger", *CONDITION_TABLES)
"""Names of the result files."""
TABLES: tuple[Experiment, ...] = ("known", "unknown")
"""The experiments in which all methods are compared."""
ABLATION = {**{part: part for part in PARTS}, "full": "hadr"}
"""Rows of the ablation, and the run on known objects that each is, in the paper's order."""
DEFAULT = "as by default"
LEDGER = {
    DEFAULT: ("known", "hadr"),
    **{switch: ("known", switch) for switch in (*SWITCHES, *SEEING)},
    "split by frame": ("by-frame", "hadr"),
}
"""Rows of the ledger's table, and which run each is."""


def write_tables(bench: Bench, folder: str | Path) -> list[Path]:
    """Write, in the order of `FILES`, those for which a run is finished, and remove the others.

    ValueError where none is.
    """
    rows = finished_rows(bench)
    if not rows:
        raise ValueError(f"no run in {bench.out} is finished")
    stems = {row["split"]: row["per_frame"]["stems"] for row in rows[::-1]}
    holds = {split: bench.holds(split, named) for split, named in stems.items()}
    found = {(row["split"], row["method"]): row for row in table_rows(rows, holds)}
    for split in TABLES:
        for method, pair in against_next(rows, found, split, holds.get(split)).items():
            found[split, method]["against_next"] = pair
    gaps = against(rows, "known", ABLATION["full"], holds.get("known"))
    oracle = bench.corruption == "oracle"
    tables: dict[str, list[dict[str, Any]]] = {
        **{split: [found[split, m] for m in COMPARED if (split, m) in found] for split in TABLES},
        "ablation": [
            {**found[key], "method": name, "against_full": gaps.get(method)}
            for name, method in ABLATION.items()
            if (key := ("known", method)) in found
        ],
        "ledger": [{**found[key], "method": name} for name, key in LEDGER.items() if key in found],
        **{name: condition_rows(bench, name, holds) if oracle else [] for name in CONDITION_TABLES},
    }
    written = []
    origin = {**provenance(), "data": bench.data}
    for name in FILES:
        path = Path(folder) / f"{name}.json"
        if not tables[name]:
            path.unlink(missing_ok=True)  # of other data or another preset: no run stands for it
        else:
            write_result_file(path, _what(name, bench), tables[name], origin)
            written.append(path)
    return written


def against_next(
    rows: Sequence[Mapping[str, Any]],
    averaged: Mapping[tuple[str, str], Mapping[str, Any]],
    split: str,
    holds: Sequence[str] | None = None,
) -> dict[str, dict[str, Any]]:
    """Compare each of the paper's five methods with the next better of them, frame by frame."""
    there = [method for method in ("hadr", *RIVALS) if (split, method) in averaged]
    there.sort(key=lambda method: float(averaged[split, method]["rmse_m"]))
    return {
        method: {"method": better, **against(rows, split, better, holds)[method]}
        for better, method in pairwise(there)
    }


def finished_rows(bench: Bench) -> list[dict[str, Any]]:
    """The rows of all finished runs of a bench, the methods in the tables' order."""
    runs = sorted(
        runs_in(bench.out),
        key=lambda run: (ALL_METHODS.index(run.method), run.experiment, run.seed),
    )
    return [row for run in runs if (row := bench.finished(run)) is not None]


def runs_in(out: Path) -> Iterator[Run]:
    """The runs that have a row, finished with the present configuration or not."""
    for path in sorted(out.glob("*/*/seed-*/row.json")):
        experiment, method, seed = path.parts[-4:-1]
        number = seed.removeprefix("seed-")
        if method in ALL_METHODS and experiment in EXPERIMENTS and number.isdigit():
            yield Run(experiment, method, int(number))


def _what(name: str, bench: Bench) -> str:
    width, height = EVALUATION_SIZE
    frames = {
        "known": "objects known from training, in holds that are not",
        "unknown": "two objects that no network has seen in training",
        "ablation": "objects known from training, HADR with one part taken out",
        "ledger": "objects known from training, HADR with one switch of the ledger turned; "
        "split by frame: as many frames in each part, dealt out one by one",
        "keypoints": "objects known from training, with true or predicted keypoints, true masks",
        "segmentation": "objects known from training, with true or predicted masks and keypoints, "
        "or with the simulated sensor's depth around the mask",
        "ablation_predicted": "objects known from training, HADR with one part taken out, with "
        "true or predicted masks and keypoints",
        "unknown_predicted": "two objects that no network has seen in training, neither those that "
        "restore depth nor those that predict masks and keypoints",
    }[name]
    return (
        f"Depth of the glass restored from one frame (preset {bench.size}): {frames}. "
        f"Corruption {bench.corruption}, true masks and keypoints unless a row says otherwise, "
        f"scored on the object's true pixels at {width}x{height}: means over the frames, pooled "
        "values beside; a pixel that a method leaves out takes the depth of the restored ones "
        "around it, and is 0 in a frame without any. Standard errors are over holds: frames of "
        "one hold are alike"
    )
