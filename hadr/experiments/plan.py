"""What is run for the tables, what of it is left, and the runs themselves; then the handover's.

OUT/handover/hadr/0004-902.json   an attempt, as `hadr handover` leaves it
OUT/tables/handover.json          the rows of the handover's table
"""

from __future__ import annotations

import traceback
from collections.abc import Generator, Mapping, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch

from hadr.experiments.conditions import (
    CONDITION_TABLES,
    conditions_of,
    finished_condition,
    measure_condition,
)
from hadr.experiments.protocol import EXPERIMENTS, Experiment
from hadr.experiments.runner import ROW, Bench, Run
from hadr.experiments.steps import Step, left_text
from hadr.experiments.systems import CHEAP, COMPARED, METHODS, PARTS, recipe_of, switches_of
from hadr.experiments.tables import ABLATION, LEDGER, TABLES, write_tables
from hadr.records.processes import one_thread, run_tasks
from hadr.records.provenance import provenance
from hadr.records.result_file import read_result_file, write_result_file
from hadr.training.recipe import Given

if TYPE_CHECKING:
    from hadr.simulation.trials.trial import Trial

    Attempts = Mapping[str, Sequence[Trial]]

KNOWN_ALONE = ("hadr-long",)
"""Trained for the known objects alone, but in preset imagenet: did HADR have too few epochs?"""
OFTEN = ("hadr", "no-hand")
"""Trained three times on the six objects, so that the hand's worth can be told from luck."""


TABLE_RUNS: dict[str, Sequence[tuple[str, str]]] = {
    "ablation": [("known", method) for method in ABLATION.values()],
    "ledger": [*LEDGER.values(), ("by-frame", "hand-median")],
    **{
        table: [(experiment, method) for method in methods]
        for table, (experiment, _, methods) in CONDITION_TABLES.items()
    },
}
"""The runs that those result files need which are none of an experiment's."""
REPRODUCED: tuple[str, ...] = (
    *("raw", "inpainted", "unet-hand", "hadr", "hadr-plus", "perfect"),
    *("hadr-plus-networks", "perfect-networks"),
    *("hadr-no-rescoring", "hadr-no-tracking"),
    *("hadr-plus-no-rescoring", "hadr-plus-no-tracking", "hadr-plus-no-rescoring-no-tracking"),
)
"""The conditions of results/mini/handover.json; `hadr handover` alone makes six of them."""


def plan(
    only: Sequence[str] = (), seeds: Sequence[int] | None = None, size: str = "mini"
) -> list[Run]:
    """List the runs of the tables, in the order in which they are made.

    Args:
        only: Beginnings of names such as ``known``, ``known/hadr`` or ``unknown/raw``, bare
            methods such as ``hadr-plus``, or one of `TABLE_RUNS`; a name that is a run's whole
            method or more takes that method alone (``known/hadr`` does not take
            ``known/hadr-plus``). Empty takes all.
        seeds: Seeds of all trainings; where it is left out, 0, and 0, 1, 2 for `OFTEN` on unknown
            objects (not at preset tiny).
        size: The preset.

    Returns:
        The runs: what learns nothing first, then the trainings of the two tables, of the ablation
        and of the ledger.

    Raises:
        ValueError: A wish fits no run.
    """
    sees = size == "imagenet"
    pairs = [
        (experiment, method)
        for method in (COMPARED if sees else METHODS)
        for experiment in TABLES
        if experiment == "known" or sees or method not in KNOWN_ALONE
    ]
    pairs += [("known", part) for part in PARTS if part not in METHODS]
    pairs += [("known", switch) for switch in switches_of(size)]
    pairs += [("by-frame", method) for method in ("hand-median", "hadr", "hadr-plus")]
    runs = [
        Run(experiment, method, seed)
        for experiment, method in pairs
        for seed in _seeds(experiment, method, seeds, size)
    ]
    if not only:
        return runs
    chosen = []
    for wish in only:
        words = _as_a_run(wish.strip("/").lower()).split("/")
        table = TABLE_RUNS.get("/".join(words), ())
        fitting = [
            run
            for run in runs
            if run.name.split("/")[: len(words)] == words
            or [run.method] == words
            or (run.experiment, run.method) in table
        ]
        if not fitting:
            raise ValueError(
                f"no run fits {wish!r}; runs are EXPERIMENT/METHOD with {', '.join(EXPERIMENTS)} "
                f"and {', '.join(dict.fromkeys(method for _, method in pairs))}, or a table of "
                f"{', '.join(TABLE_RUNS)}; seeds are chosen with --seeds"
            )
        chosen += fitting
    return [run for run in runs if run in chosen]


def _as_a_run(wish: str) -> str:
    """The run behind a row of the ablation, such as ``ablation/full``; anything else as it is."""
    row = wish.removeprefix("ablation/")
    is_row = row in ABLATION and (row != wish or row not in METHODS)
    return f"known/{ABLATION[row]}" if is_row else wish


def _seeds(
    experiment: Experiment, method: str, seeds: Sequence[int] | None, size: str
) -> Sequence[int]:
    if method in CHEAP:
        return (0,)
    if seeds is not None:
        return tuple(dict.fromkeys(seeds))
    often = experiment == "unknown" and method in OFTEN and size != "tiny"
    return (0, 1, 2) if often else (0,)


def table_steps(bench: Bench, runs: Sequence[Run], times: Mapping[str, float]) -> list[Step]:
    """Describe runs as steps of a plan, with the scores of their networks in other conditions.

    The seconds of last runs are found by the step's name.
    """
    steps = []
    for run in runs:
        row, seconds, words = bench.finished(run), times.get(run.name), "done"
        if row is None:
            left, of = _epochs_left(bench, run)
            words = left_text(left, of, "epoch") if left else "scoring"
        else:
            seconds = row.get("training_s", 0.0) + row["evaluation_s"]
        steps.append(Step("tables", run.name, words, seconds, f"{bench.out.name}/{run.name}/{ROW}"))
    conditions: dict[tuple[str, str], list[Mapping[str, Any] | None]] = {}
    for run, name, given in _conditions(bench, runs):
        found = finished_condition(bench, run, name, given)
        conditions.setdefault((run.experiment, name), []).append(found)
    for (experiment, given_name), scores in conditions.items():
        there = [row["evaluation_s"] for row in scores if row is not None]
        left = len(scores) - len(there)
        words = left_text(left, len(scores), "score")
        name = f"given {given_name}" + f", {experiment}" * (experiment != "known")
        seconds = times.get(name) if left else sum(there)
        made = f"{bench.out.name}/{experiment}/*/*/given"
        steps.append(Step("tables", name, words, seconds, made))
    return steps


def _epochs_left(bench: Bench, run: Run) -> tuple[int, int]:
    """How many epochs a run still needs, and how many it has in all."""
    recipe = recipe_of(run.method, bench.size)
    return (0, 0) if recipe is None else (
        max(recipe.epochs - bench.epochs_done(run), 0), recipe.epochs
    )  # fmt: skip


def _conditions(bench: Bench, runs: Sequence[Run]) -> list[tuple[Run, str, Given]]:
    """What the tables of conditions need of these runs; with another corruption, nothing."""
    if bench.corruption != "oracle":
        return []
    return conditions_of(runs, bench)


def measure_all(bench: Bench, runs: Sequence[Run], tables: str | Path, *, jobs: int = 1) -> None:
    """Make the runs that are missing, say each in a line, and write the tables after it.

    So many `jobs` run at a time, each in a process of its own with one thread. The tables hold
    every run of the bench that is finished, also those that were not asked for. RuntimeError where
    one of several jobs failed; the others were made, and the tables have them. ChildProcessError
    where a process died.
    """
    if jobs < 1:
        raise ValueError(f"jobs must be at least 1, got {jobs}")
    done = {run for run in runs if bench.finished(run) is not None}
    with closing(_measured(bench, runs, jobs)) as measured:  # an error here ends its processes
        for number, (run, row) in enumerate(measured, start=1):
            minutes = row.get("training_s", 0) / 60
            state = "was there" if run in done else f"{minutes:.1f} min of training"
            print(
                f"[{number}/{len(runs)}] {run.name:<32} RMSE {row['rmse_m']:.4f} m, "
                f"δ1.05 {row['delta_105']:.2f} % ({state})"
            )
            if run not in done:
                write_tables(bench, tables)
    for run, name, given in _conditions(bench, runs):
        if finished_condition(bench, run, name, given) is None:
            row = measure_condition(bench, run, name, given)
            print(f"{run.name:<32} RMSE {row['rmse_m']:.4f} m, given: {name}")
    write_tables(bench, tables)


def _measured(
    bench: Bench, runs: Sequence[Run], jobs: int
) -> Generator[tuple[Run, dict[str, Any]]]:
    """The runs with their rows, in the order in which they are finished."""
    if jobs == 1:
        for run in runs:
            yield run, bench.measure(run)
        return
    waiting = sorted(runs, key=lambda run: -_epochs_left(bench, run)[0])  # the longest first
    failed = []
    with closing(run_tasks(partial(_measure_alone, bench), waiting, jobs)) as made:
        for number, found in made:
            if isinstance(found, str):
                failed.append(f"{waiting[number].name} ({found})")
            else:
                yield waiting[number], found
    if failed:
        raise RuntimeError(f"not finished: {'; '.join(failed)}")


def _measure_alone(bench: Bench, run: Run) -> dict[str, Any] | str:
    """Make one run with one thread; its row, or why there is none."""
    try:
        with one_thread(torch.get_num_threads, torch.set_num_threads):
            return bench.measure(run)
    except Exception as error:
        traceback.print_exc()
        return f"{type(error).__name__}: {error}"


def planned_attempts(size: str, seed: int) -> dict[str, list[Trial]]:
    """The attempts of each condition: 48, and at preset tiny one, to see that everything runs."""
    from hadr.simulation.trials.experiment import attempts

    if size == "tiny":
        return {
            condition: attempts(condition, objects=["0004"], holds=[902], seed=seed)
            for condition in REPRODUCED
        }
    return {condition: attempts(condition, seed=seed) for condition in REPRODUCED}


def handover_steps(plan: Attempts, out: Path, times: Mapping[str, float]) -> list[Step]:
    """Describe the conditions as steps of a plan."""
    from hadr.simulation.trials.experiment import is_finished

    table, steps = out / "tables" / "handover.json", []
    rows = read_result_file(table).rows if table.is_file() else ()
    own = {row["condition"]: row["attempts"] * row["mean_wall_seconds"] for row in rows}
    for condition, trials in plan.items():
        left = sum(not is_finished(out / "handover", trial) for trial in trials)
        words = left_text(left, len(trials), "attempt")
        name = f"handover/{condition}"
        seconds = times.get(name) if left else own.get(condition, times.get(name))
        steps.append(Step("handover", name, words, seconds, "tables/handover.json"))
    return steps


def make_handover_table(plan: Attempts, out: Path, jobs: int) -> None:
    """Make the attempts that are missing, `jobs` at a time, and write the table."""
    from hadr.simulation.trials.experiment import run_attempts
    from hadr.simulation.trials.summary import condition_row

    rows = []
    for condition, trials in plan.items():
        rows.append(
            condition_row(
                condition, run_attempts(trials, out / "handover", jobs=jobs, report=_say_attempt)
            )
        )
        print(f"{condition}: {rows[-1]['successes']} of {rows[-1]['attempts']}", flush=True)
    what = (
        f"handover attempts in simulation, {len(trials)} a condition, seed {trials[0].seed}; masks "
        "and keypoints from the simulator with noise; success by HandoverSim's rules"
    )
    write_result_file(out / "tables" / "handover.json", what, rows, provenance())


def _say_attempt(trial: Trial, row: Mapping[str, Any]) -> None:
    print(f"{trial.condition:18} {trial.name}  {row['verdict']:14} {row['reason']}", flush=True)
