"""What benchmarks that look at finished runs share: their arguments, their bench, their file."""

import argparse
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import torch

from hadr.experiments.protocol import Experiment
from hadr.experiments.runner import Bench, Run
from hadr.experiments.systems import recipe_of
from hadr.experiments.tables import runs_in
from hadr.records.provenance import provenance
from hadr.records.result_file import write_result_file
from hadr.training.checkpoints import load_checkpoint
from hadr.training.recipe import Preset
from hadr.training.training_folder import LAST


def arguments(description: str | None) -> argparse.ArgumentParser:
    """Give a parser of what all of them take; a benchmark may add its own."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--runs", type=Path, required=True, help="OUT/runs of hadr reproduce")
    parser.add_argument("--data", type=Path, nargs="+", required=True)
    parser.add_argument("--json", type=Path, required=True)
    parser.add_argument("--preset", default="mini", help="of the runs")
    parser.add_argument("--threads", type=int, default=torch.get_num_threads())
    return parser


def open_runs(args: argparse.Namespace) -> Bench:
    """Set the number of threads, and open the bench of the runs."""
    torch.set_num_threads(args.threads)
    return Bench(args.data, args.runs, args.preset)


def trained(
    bench: Bench, split: Experiment, methods: Iterable[str]
) -> Iterator[tuple[Run, Preset, Any]]:
    """Give the finished trainings among some methods: run, recipe, and network to be asked.

    The others are named and left out.
    """
    there = set(runs_in(bench.out))
    for run in (Run(split, method) for method in dict.fromkeys(methods)):
        if run not in there or bench.finished(run) is None:
            print(f"left out, for it is not finished: {run.name}", flush=True)
            continue
        if (recipe := recipe_of(run.method, bench.size)) is not None:
            yield run, recipe, load_checkpoint(bench.out / run.name / LAST)[0].eval()


def finished(bench: Bench, run: Run) -> dict[str, Any]:
    """Give a run's row; SystemExit where it is not finished: nothing is trained here."""
    if (row := bench.finished(run)) is None:
        raise SystemExit(f"{run.name} is not finished in {bench.out}: see hadr reproduce --dry-run")
    return row


def write_rows(path: Path, what: str, rows: Sequence[Mapping[str, Any]], bench: Bench) -> None:
    """Write a result file with where its numbers come from."""
    origin = {**provenance(), "data": bench.data}
    write_result_file(path, what, rows, origin)
