"""``hadr reproduce``: tables, handover and chapters without a user's hand; the plan comes first.

OUT/tables, OUT/report.md        the tables, and these beside the paper's
OUT/handover                     the attempts
OUT/executed, OUT/results        the chapters, and what each measured
OUT/results.json                 all of that with its provenance
OUT/run_times.json               how long each step took
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from hadr.data.samples import samples_dir
from hadr.experiments.again import measure_again, row_to_run
from hadr.experiments.handover_table import (
    handover_steps,
    make_handover_table,
    planned_attempts,
)
from hadr.experiments.plan import TABLE_RUNS, measure_all, plan, table_steps
from hadr.experiments.runner import Bench
from hadr.experiments.splits import EXPERIMENTS
from hadr.experiments.steps import NAME, Step, keep_run_times, last_run_times, steps_text
from hadr.experiments.systems import METHODS, PARTS, SWITCHES
from hadr.press.chapter_record import keep_results
from hadr.press.chapters import (
    ChapterError,
    chapter_paths,
    chapter_steps,
    run_notebooks,
    run_time_table,
)
from hadr.press.paper_report import TITLES, report
from hadr.records.checkout import checkout_root
from hadr.records.output_folder import check_output_folder, make_output_folder
from hadr.simulation.trials.command import check_packages
from hadr.training.accelerator import add_accelerator, chosen_accelerator
from hadr.training.batches import CORRUPTIONS

TINY_FRAMES = 48
"""Frames of each part in preset tiny, which shows that everything runs and no more."""
WHOLE = ("tables", "handover", "chapters")
"""What ``--only`` takes as a whole, in the order in which it is made."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe ``hadr reproduce`` to a command line parser."""
    parser.description = (
        "Train and score the systems of the tables, make the attempts of the handover, execute the "
        "book's chapters and collect what they measure. The plan is printed first. A step that is "
        "finished is not repeated; one that was stopped goes on."
    )
    parser.add_argument(
        "--preset",
        choices=("tiny", "mini", "paper"),
        default="tiny",
        help="size of networks and data (default: tiny, minutes on a laptop)",
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of every chapter (default: 0)")
    parser.add_argument(
        "--only",
        nargs="+",
        default=[],
        metavar="WHAT",
        help="chapters by number or name (`--only 03 04`), runs of the tables (`--only "
        "known/hadr unknown raw`), or all of a part: `tables`, `handover`, `chapters` (default: "
        "everything)",
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder for notebooks and results"
    )
    parser.add_argument(
        "--dry-run", action="store_true", help="print the plan with what is done, and stop"
    )
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


def run(args: argparse.Namespace) -> int:
    """Carry out ``hadr reproduce``: print the plan, then do what is left of it.

    Returns:
        0 when all was done, 1 when a row that was run again gave other numbers, 2 when a chapter
        or a training failed.

    Raises:
        ValueError: A wish fits nothing, an option is out of range, or data are missing.
        FileNotFoundError: A data folder is not there.
    """
    check_output_folder(args.out)
    for option, least in (("jobs", 1), ("seed", 0), ("seeds", 0)):
        given = getattr(args, option)
        for number in (
            given if isinstance(given, list | tuple) else [least if given is None else given]
        ):
            if number < least:
                raise ValueError(f"--{option} must be at least {least}, got {number}")
    if args.again:
        return _run_again(args)
    asked = set(args.only)
    rows = [wish for wish in args.only if is_table_wish(wish)]
    chapters = [w for w in args.only if w not in WHOLE and w not in rows]
    bench = runs = attempts = None
    paths: Sequence[Path] = ()
    if not asked or rows or "tables" in asked:
        bench = open_bench(args)
        runs = plan([] if "tables" in asked else rows, args.seeds, args.preset)
    if not asked or "handover" in asked:
        try:
            check_packages()
        except ValueError as error:
            raise ValueError(f"{error}; or leave it out: --only tables chapters") from error
        attempts = planned_attempts(args.preset, args.seed)
    if not asked or chapters or "chapters" in asked:
        paths = chapter_paths(checkout_root() / "notebooks", chapters)

    def steps() -> list[Step]:
        times, found = last_run_times(args.out, args.preset), list[Step]()
        if bench is not None and runs is not None:
            found += [] if bench.roots else [_data_step(args.preset, times)]
            found += table_steps(bench, runs, times)
        if attempts is not None:
            found += handover_steps(attempts, args.out, times)
        return found + chapter_steps(paths, args.out, args.preset, args.seed, times)

    print(f"preset {args.preset}, seed {args.seed}; everything goes to {args.out}\n")
    print(steps_text(steps()), flush=True)
    if args.dry_run:
        return 0
    print()
    make_output_folder(args.out)
    try:
        if bench is not None and runs is not None:
            measure_all(bench, runs, args.out / "tables", jobs=args.jobs)
        if attempts is not None:
            make_handover_table(attempts, args.out, args.jobs)
        if bench is not None or attempts is not None:
            write_report(args.out, args.preset)
        if paths:
            done = run_notebooks(paths, args.out, preset=args.preset, seed=args.seed, resume=True)
            every = chapter_paths(checkout_root() / "notebooks")
            keep_results(args.out, every, args.preset, args.seed)
            print(f"\n{run_time_table(done)}\n\nresults: {args.out / 'results.json'}")
    except (ChapterError, RuntimeError) as error:
        print(error, file=sys.stderr)
        return 2
    keep_run_times(args.out, steps())
    print(f"how long each step took: {args.out / NAME}")
    return 0


def is_table_wish(wish: str) -> bool:
    """Say whether a word of ``--only`` means a table's run and not a chapter."""
    names = (*EXPERIMENTS, *METHODS, *PARTS, *SWITCHES, *TABLE_RUNS, "full")
    return "/" in wish or wish.lower() in names


def open_bench(args: argparse.Namespace) -> Bench:
    """Open the bench that the options describe; for a plan alone, its data may be missing.

    Raises:
        ValueError: No data folder is named, and the preset has none of its own.
        FileNotFoundError: A data folder is not there.
    """
    roots: Sequence[Path] = args.data
    tiny = args.preset == "tiny"
    if args.dry_run and not args.again and not (tiny or all(root.is_dir() for root in roots)):
        roots = []
    elif not roots and tiny:
        roots = [samples_dir() / "frames"]
    elif not roots and not args.dry_run:
        raise ValueError(
            f"the tables of preset {args.preset} need --data DIR; make one with "
            f"'hadr generate --preset {args.preset} --out DIR', and name data_samples/frames "
            "beside it for more training frames"
        )
    for root in roots:
        if not root.is_dir():
            raise FileNotFoundError(f"there is no data folder {root}")
        if not (root / "train").is_dir():
            raise FileNotFoundError(f"{root} has no folder 'train': it is none of TransHand's form")
    limit = TINY_FRAMES if tiny else None
    accelerator = chosen_accelerator(args.accelerator)
    return Bench(roots, args.out / "runs", args.preset, args.corruption, limit, accelerator)


def _data_step(size: str, times: dict[str, float]) -> Step:
    """The step that makes the data of a preset, for a plan without them: nothing else is done."""
    from hadr.synthesis.generation.presets import PRESETS

    name = f"hadr generate --preset {size} --out DIR"
    return Step(
        "data", name, f"{PRESETS[size].frames:,} frames", times.get(name), "DIR, for --data"
    )


def _run_again(args: argparse.Namespace) -> int:
    """Run ``hadr reproduce --again``: 0 where the numbers agree, 1 where they don't."""
    file, method = args.again
    bench = open_bench(args)
    if args.dry_run:
        row_to_run(bench, file, method)  # raises where it can't be run
        print(f"row {method!r} of {file} would be run again in {args.out}")
        return 0
    return 0 if measure_again(bench, file, method) else 1


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
