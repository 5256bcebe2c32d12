"""What is run for a table, how long it will take, and the table itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from hadr.experiments.runner import Bench, Run, table_rows
from hadr.experiments.scoring import EVALUATION_SIZE
from hadr.experiments.splits import EXPERIMENTS
from hadr.experiments.systems import CHEAP, METHODS, system
from hadr.provenance import machine_text, provenance
from hadr.result_file import write_result_file

SECONDS_A_FRAME = {
    "tiny": {
        "hadr": 0.02,
        "hadr-plus": 0.01,
        "unet-hand": 0.01,
        "lidf": 0.024,
        "dfnet": 0.034,
        "swindrnet": 0.018,
        "tode": 0.02,
    },
    "mini": {
        "hadr": 0.037,
        "hadr-plus": 0.019,
        "unet-hand": 0.032,
        "lidf": 0.035,
        "dfnet": 0.038,
        "swindrnet": 0.036,
        "tode": 0.033,
    },
    "paper": {
        "hadr": 1.15,
        "hadr-plus": 0.08,
        "unet-hand": 0.18,
        "lidf": 1.0,
        "dfnet": 0.9,
        "swindrnet": 6.1,
        "tode": 1.1,
    },
}
"""Rough training seconds a frame and epoch on one CPU core, for a plan's estimate alone."""


def plan(only: Sequence[str] = (), seeds: Sequence[int] = (0,)) -> list[Run]:
    """List the runs of the tables, in the order in which they are made.

    Args:
        only: Beginnings of names such as ``known``, ``known/hadr`` or ``unknown/raw``, or bare
            methods such as ``hadr-plus``; a name that is a run's whole method or more takes that
            method alone (``known/hadr`` does not take ``known/hadr-plus``). Empty takes all.
        seeds: Seeds of the trainings.

    Returns:
        The runs: what learns nothing first, then the trainings.

    Raises:
        ValueError: A wish fits no run.
    """
    runs = [
        Run(experiment, method, seed)
        for method in METHODS
        for experiment in EXPERIMENTS
        for seed in ((0,) if method in CHEAP else seeds)
    ]
    if not only:
        return runs
    chosen = []
    for wish in only:
        words = wish.strip("/").split("/")
        fitting = [
            run
            for run in runs
            if run.name.split("/")[: len(words)] == words
            or (len(words) == 1 and run.method == wish)
        ]
        if not fitting:
            raise ValueError(
                f"no run fits {wish!r}; runs are EXPERIMENT/METHOD with {', '.join(EXPERIMENTS)} "
                f"and {', '.join(METHODS)}"
            )
        chosen += fitting
    return [run for run in runs if run in chosen]


def estimated_minutes(bench: Bench, run: Run) -> float:
    """Estimate a run's minutes on one CPU core; 0 where it is finished.

    Args:
        bench: Where it runs.
        run: The run.
    """
    if bench.finished(run) is not None:
        return 0.0
    recipe = system(run.method, bench.size).recipe
    if recipe is None:
        return 0.5
    frames = bench.count(run, "train")
    return recipe.epochs * frames * SECONDS_A_FRAME[bench.size][recipe.network] / 60 + 0.5


def plan_text(bench: Bench, runs: Sequence[Run]) -> str:
    """Set the plan as a table: each run with what is left of it, and the sum."""
    lines = [f"{'run':<32} {'epochs':>6} {'minutes':>8}"]
    total = 0.0
    for run in runs:
        recipe = system(run.method, bench.size).recipe
        minutes = estimated_minutes(bench, run)
        total += minutes
        left = "done" if minutes == 0 else f"{minutes:.1f}"
        lines.append(f"{run.name:<32} {recipe.epochs if recipe else '-':>6} {left:>8}")
    hours, rest = divmod(round(total), 60)
    lines.append(f"{'together, on one CPU core':<32} {'':>6} {hours} h {rest:02d} min")
    return "\n".join(lines)


def measure_all(
    bench: Bench, runs: Sequence[Run], table: str | Path, say: Callable[[str], None] = print
) -> None:
    """Make the runs that are missing, and write the table after each.

    Args:
        bench: Where they run.
        runs: The runs.
        table: The result file; it holds every run of the bench that is finished, also those
            that were not asked for.
        say: Receives a line a run.
    """
    for number, run in enumerate(runs, start=1):
        done = bench.finished(run)
        row = bench.measure(run)
        state = "was there" if done else f"{row.get('training_s', 0) / 60:.1f} min of training"
        say(
            f"[{number}/{len(runs)}] {run.name:<28} RMSE {row['rmse_m']:.4f} m, "
            f"δ1.05 {row['delta_105']:.2f} % ({state})"
        )
        write_table(bench, table)


def write_table(bench: Bench, table: str | Path) -> None:
    """Write the result file from all finished runs of a bench.

    Raises:
        ValueError: No run is finished.
    """
    names = sorted(path.parent.name for path in bench.out.glob("*/*/seed-*/row.json"))
    seeds = sorted({int(name.removeprefix("seed-")) for name in names})
    rows = [
        {**row, "curve": bench.curve(run)}
        for run in plan(seeds=seeds or (0,))
        if (row := bench.finished(run)) is not None
    ]
    width, height = EVALUATION_SIZE
    what = (
        f"Depth of the glass restored from one frame (preset {bench.size}, corruption "
        f"{bench.corruption}, true masks and keypoints), scored on the object's pixels at "
        f"{width}x{height}: means over the frames, pooled values beside; a pixel that a method "
        "leaves out takes the depth of the restored ones around it, and is 0 in a frame without "
        "any. Standard errors are over holds: frames of one hold are alike"
    )
    holds = {
        row["split"]: bench.holds(row["split"], row["per_frame"]["stems"]) for row in rows[::-1]
    }
    write_result_file(
        table,
        what,
        table_rows(rows, holds),
        {**provenance(), "machine": machine_text(), "data": bench.data},
    )
