"""Run a row of a result file once more, from the configuration that it records."""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from hadr.experiments.runner import Bench, Run
from hadr.experiments.scoring import EVALUATION_SIZE
from hadr.records.reading import structured
from hadr.records.result_file import digest, read_result_file
from hadr.training.presets import recipe_from_dict


def measure_again(
    bench: Bench, file: str | Path, method: str, say: Callable[[str], None] = print
) -> bool:
    """Train and score a row's first seed again, as it is recorded: recipe and number of threads."""
    row = row_to_run(bench, file, method)
    configuration = row["configuration"]
    if other := configuration["data"]["sha256"] != bench.data["sha256"]:
        say("the frames of --data are others than the row's: numbers will differ, if by little")
    experiment, name, seed = configuration["run"].split("/")
    run = Run(experiment, name, int(seed.removeprefix("seed-")))
    if configuration["recipe"] is None:
        scores = bench.score_cheap(run)
    else:
        before = torch.get_num_threads()
        torch.set_num_threads(row.get("threads") or before)
        try:
            recipe = recipe_from_dict(configuration["recipe"])
            folder = bench.out / "again" / run.name
            scores = bench.score(run, recipe, bench.train(run, recipe, folder).model)
        finally:
            torch.set_num_threads(before)
        shutil.rmtree(folder)  # or the next time would compare with this one
    found, same = scores.columns(), True
    say(f"{run.name:<24} {'recorded':>12} {'again':>12}")
    for column, (then, *_) in row["by_seed"].items():
        then, now = math.nan if then is None else then, float(found[column])
        agrees = abs(now - then) <= 1e-6 * abs(then) or (math.isnan(now) and math.isnan(then))
        say(f"  {column:<22} {then:12.6f} {now:12.6f}{'' if agrees else '  differs'}")
        same = same and agrees
    if not (same or other):
        say("another processor or version of PyTorch sums in another order, and with the last "
            f"digits trainings differ: this is {bench.device}, the row was made on "
            f"{row.get('device', 'cpu')}, {row['provenance']['machine']}")  # fmt: skip
    return same


@dataclass(frozen=True)
class _Configuration:
    run: str
    recipe: dict[str, Any] | None
    data: dict[str, Any]
    evaluation_size: tuple[int, int]

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[\w-]+/[\w-]+/seed-\d+", self.run):
            raise ValueError(f"run must be EXPERIMENT/METHOD/seed-N, got {self.run!r:.60}")


@dataclass(frozen=True)
class _Row:
    """What a row must say to be run again."""

    configuration: _Configuration
    config_sha256: list[str]
    by_seed: dict[str, list[float | None]]
    provenance: dict[str, Any]

    def __post_init__(self) -> None:
        if empty := [name for name, values in self.by_seed.items() if not values]:
            raise ValueError(f"by_seed: {empty[0]} has no value")


def row_to_run(bench: Bench, file: str | Path, method: str) -> dict[str, Any]:
    """Find a row of a result file that can be run again on a bench.

    ValueError where the file was edited, has no such row, or the row has no recipe recorded; or
    where the bench's corruption, limit or size are others than the row's. Its frames may be.
    """
    try:
        row = read_result_file(file).row(method=method)
    except KeyError as error:
        raise ValueError(f"{file}: {error.args[0]}; rows of known.json can be run") from error
    structured(row, _Row, f"{file}: row {method!r}", further=True)
    configuration: dict[str, Any] = row["configuration"]
    if row["config_sha256"][:1] != [digest(configuration)]:
        raise ValueError(f"{file}: row {method!r} has no whole configuration to run again")
    then = {**configuration["data"], "size": configuration["evaluation_size"]}
    now = {**bench.data, "size": list(EVALUATION_SIZE)}
    options = {"corruption": "--corruption", "limit": "--preset"}
    for part, option in {**options, "size": "this version"}.items():
        if then[part] != now[part]:
            raise ValueError(
                f"{file}: row {method!r} was measured with {part} = {then[part]}, and {option} "
                f"gives {now[part]}"
            )
    return row
