"""The tables' part of `hadr reproduce`: its arguments, its plan, its run."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from hadr.data.samples import samples_dir
from hadr.experiments.again import measure_again, row_to_run
from hadr.experiments.nominal_data import NominalBench
from hadr.experiments.plan import TABLE_RUNS, measure_all
from hadr.experiments.runner import Bench, Run
from hadr.experiments.splits import EXPERIMENTS
from hadr.experiments.systems import METHODS, PARTS, SWITCHES
from hadr.press.paper_report import TITLES, report
from hadr.records.checkout import checkout_root
from hadr.records.output_folder import check_folder
from hadr.training.accelerator import add_accelerator, chosen_accelerator
from hadr.training.batches import CORRUPTIONS

TINY_FRAMES = 48
"""Frames of each part in preset tiny, which shows that everything runs and no more."""


def add_table_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what concerns the tables."""
    parser.add_argument(
        "--data",
        nargs="+",
        type=Path,
        default=[],
        metavar="DIR",
        help="data folders for the tables; preset tiny takes the bundled samples, mini and paper "
        "need a set that `hadr generate --preset mini` or paper has made",
    )
    parser.add_argument(
        "--seeds",
        nargs="+",
        type=int,
        metavar="N",
        help="seeds of the trainings (0; with mini and paper 0 1 2 for HADR with and without the "
        "hand on unknown objects)",
    )
    parser.add_argument(
        "--jobs",
        type=int,
        default=1,
        metavar="N",
        help="so many trainings at a time, each in a process with one thread (1: one, with all "
        "threads; exact numbers repeat for the same number of threads only)",
    )
    add_accelerator(parser)
    parser.add_argument(
        "--again",
        nargs=2,
        metavar=("FILE", "METHOD"),
        help="run a row of a result file once more from its recorded configuration, and compare",
    )
    parser.add_argument(
        "--corruption", default="oracle", choices=tuple(CORRUPTIONS), help="depth inside the glass"
    )


def is_table_wish(wish: str) -> bool:
    """Say whether a word of ``--only`` means a table's run and not a chapter."""
    names = (*EXPERIMENTS, *METHODS, *PARTS, *SWITCHES, *TABLE_RUNS, "full")
    return "/" in wish or wish.lower() in names


def open_bench(args: argparse.Namespace) -> Bench:
    """Open the bench that the arguments describe; for a dry run without its data, one that plans.

    Raises:
        ValueError: No data folder is named, and the preset has none of its own.
        FileNotFoundError: A data folder is not there.
    """
    check_folder(args.out)
    if args.seeds and min(args.seeds) < 0:
        raise ValueError(f"--seeds must be at least 0, got {min(args.seeds)}")
    if args.jobs < 1:
        raise ValueError(f"--jobs must be at least 1, got {args.jobs}")
    roots: Sequence[Path] = args.data
    missing = tuple(root for root in roots if not root.is_dir())
    if args.dry_run and not args.again and args.preset != "tiny" and (missing or not roots):
        return NominalBench(args.out / "runs", args.preset, missing)
    if not roots:
        if args.preset != "tiny":
            raise ValueError(
                f"the tables of preset {args.preset} need --data DIR; make one with "
                f"'hadr generate --preset {args.preset} --out DIR', and name data_samples/frames "
                "beside it for more training frames"
            )
        roots = [samples_dir() / "frames"]
    for root in roots:
        if not root.is_dir():
            raise FileNotFoundError(f"there is no data folder {root}")
        if not (root / "train").is_dir():
            raise FileNotFoundError(f"{root} has no folder 'train': it is none of TransHand's form")
    limit = TINY_FRAMES if args.preset == "tiny" else None
    accelerator = chosen_accelerator(args.accelerator)
    return Bench(roots, args.out / "runs", args.preset, args.corruption, limit, accelerator)


def run_again(args: argparse.Namespace) -> int:
    """Run ``hadr reproduce --again``.

    Returns:
        0 where the numbers agree, 1 where they don't.

    Raises:
        ValueError: As `hadr.experiments.again.measure_again`.
        FileNotFoundError: The result file or a data folder is not there.
    """
    file, method = args.again
    bench = open_bench(args)
    if args.dry_run:
        row_to_run(bench, file, method)  # raises where it can't be run
        print(f"row {method!r} of {file} would be run again in {args.out}")
        return 0
    found = measure_again(bench, file, method)
    print(found.text())
    if not found.same and found.device != bench.device:
        print(f"it was trained on {found.device} and now on {bench.device}: their sums differ in "
              "the last digits, and trainings with them")  # fmt: skip
    elif not found.same:
        print("another processor or another version of PyTorch sums in another order, and with the "
              "last digits trainings differ; the row's provenance names both")  # fmt: skip
    return 0 if found.same else 1


def measure_tables(args: argparse.Namespace, bench: Bench, runs: Sequence[Run]) -> None:
    """Measure those runs of the tables that are missing.

    Args:
        args: Arguments of `hadr reproduce`.
        bench: What `open_bench` gave for them.
        runs: The runs.

    Raises:
        RuntimeError: As `hadr.experiments.plan.measure_all`.
    """
    measure_all(bench, runs, args.out / "tables", jobs=args.jobs)


def write_report(out: Path, size: str) -> None:
    """Write the report of a folder's tables, beside the paper's where these are at hand."""
    try:
        published = checkout_root() / "results" / "paper_tables.json"
    except FileNotFoundError:
        return
    if published.exists() and any((out / "tables" / f"{name}.json").exists() for name in TITLES):
        text = f"# The paper's tables, and ours\n\n{report(out / 'tables', published, size)}"
        (out / "report.md").write_text(text, encoding="utf-8")
        print(f"the report: {out / 'report.md'}")
