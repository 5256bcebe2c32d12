"""``hadr reproduce``: tables, handover and chapters without a user's hand; the plan comes first.

OUT/tables, OUT/report.md        the tables, and these beside the paper's
OUT/handover                     the attempts
OUT/executed, OUT/results        the chapters, and what each measured
OUT/results.json                 all of that with its provenance
OUT/run_times.json               how long each step took
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from hadr.corruption import Corruption
from hadr.experiments.steps import NAME, Step, keep_run_times, last_run_times, steps_text
from hadr.press.chapter_record import keep_results
from hadr.press.chapters import WHOLE, chapter_paths, chapter_steps, run_notebooks, run_time_table
from hadr.records.checkout import checkout_root
from hadr.records.option_words import FOLDER, LARGEST_SEED, MOST_JOBS, check_range
from hadr.records.output_folder import check_own, make_output_folder
from hadr.records.result_file import is_sealed_page, sealed_page
from hadr.records.writing import set_aside, sole_owner, write_whole
from hadr.simulation.trials.command import check_packages
from hadr.training.recipe import Accelerator

if TYPE_CHECKING:
    from hadr.experiments.runner import Bench

EPILOG = """
examples
  The plan, what of it is done, and how long the last run took:
    hadr reproduce --out build --dry-run
  The tables of chapter 9; frames: hadr generate --preset mini
  --no-sensor --frames 3000 --out frames
    hadr reproduce --preset imagenet --data frames --out build/imagenet
  One row of a table; one row of a result file once more:
    hadr reproduce --only known/hadr --out build
    hadr reproduce --again results/mini/known.json hadr --preset mini \\
        --data frames data_samples/frames --out build/again

exit status
  0 done   1 a row that was run again gave other numbers
  2 a chapter or a training failed, or a wrong call   130 interrupted"""

NEAR_FRAMES = 3000
"""Frames of the generator's preset mini from which preset imagenet learns."""
TINY_FRAMES = 48
"""Frames of each part in preset tiny, which shows that everything runs and no more."""


@dataclass(frozen=True)
class Options:
    """Make the tables, the attempts of the handover and the chapters, and collect the results.

    The plan is printed first. What is finished is not repeated; what was stopped goes on.
    """

    out: Annotated[Path, FOLDER]
    """Folder for notebooks and results."""
    preset: Literal["tiny", "mini", "imagenet", "paper"] = "tiny"
    """Size of networks and data; tiny takes minutes on a laptop, imagenet has tables alone."""
    seed: int = 0
    """Seed of every chapter and of the attempts."""
    only: Annotated[tuple[str, ...], tyro.conf.arg(metavar="PART")] = ()
    """Chapters (03 04), rows (known/hadr raw), or a part: tables, handover, chapters."""
    dry_run: bool = False
    """Print the plan with what is done, and stop."""
    data: Annotated[tuple[Path, ...], FOLDER] = ()
    """Data for the tables, from `hadr generate`; tiny takes the bundled samples."""
    seeds: tuple[int, ...] | None = None
    """Seeds of the trainings; unset: 0, and 0 1 2 for HADR and no-hand on unknown objects."""
    jobs: int = 1
    """Trainings, attempts or chapters at a time; trainings of several have one thread each."""
    accelerator: Accelerator = "auto"
    """auto: cuda if any; numbers of a GPU are near to those of a CPU, not equal to them."""
    again: Annotated[tuple[str, str] | None, tyro.conf.arg(metavar="FILE METHOD")] = None
    """Result file and method: run that row once more as it is recorded there, and compare."""
    corruption: Corruption = "oracle"
    """How the depth is corrupted, inside the glass and around it."""
    keep_trained: bool = False
    """Score finished trainings of other code too, and train only what is missing."""


def run(options: Options) -> int:
    """Carry out ``hadr reproduce``: print the plan, do what is left of it, give the status."""
    from hadr.experiments import plan

    out, preset = options.out, options.preset
    check_own(out)
    check_range("jobs", options.jobs, 1, MOST_JOBS)
    check_range("seed", options.seed, 0, LARGEST_SEED)
    seeds = options.seeds or ()
    for seed in seeds:
        check_range("seeds", seed, 0, LARGEST_SEED)
        if seeds.count(seed) > 1:
            raise ValueError(f"--seeds names {seed} twice")
    if options.again:
        return _run_again(options, *options.again)
    asked = set(options.only)
    if preset == "imagenet":
        asked = asked or {"tables"}
        if others := [wish for wish in asked if wish != "tables" and not is_table_wish(wish)]:
            raise ValueError(f"preset imagenet has tables alone, got --only {' '.join(others)}")
    rows = [wish for wish in options.only if is_table_wish(wish)]
    chapters = [w for w in options.only if w not in WHOLE and w not in rows]
    bench = runs = attempts = None
    paths: Sequence[Path] = ()
    if not asked or rows or "tables" in asked:
        bench = open_bench(options)
        runs = plan.plan([] if "tables" in asked else rows, options.seeds, preset)
    if not asked or "handover" in asked:
        try:
            check_packages()
        except ValueError as error:
            raise ValueError(f"{error}; or leave it out: --only tables chapters") from error
        attempts = plan.planned_attempts(preset, options.seed)
    if not asked or chapters or "chapters" in asked:
        paths = chapter_paths(checkout_root() / "notebooks", chapters)

    def steps() -> list[Step]:
        times, found = last_run_times(out, preset), list[Step]()
        if bench is not None and runs is not None:
            found += [] if bench.roots else [_data_step(preset, times)]
            found += plan.table_steps(bench, runs, times)
        if attempts is not None:
            found += plan.handover_steps(attempts, out, times)
        return found + chapter_steps(paths, out, preset, options.seed, times)

    print(f"preset {preset}, seed {options.seed}; everything goes to {out}\n")
    print(steps_text(steps()), flush=True)
    if options.dry_run:
        return 0
    print()
    make_output_folder(out)
    with sole_owner(out, "hadr reproduce"):
        try:
            if bench is not None and runs is not None:
                plan.measure_all(bench, runs, out / "tables", jobs=options.jobs)
            if attempts is not None:
                plan.make_handover_table(attempts, out, options.jobs)
            if bench is not None or attempts is not None:
                write_report(out, preset)
            if paths:
                done = run_notebooks(
                    paths, out, preset=preset, seed=options.seed, resume=True, jobs=options.jobs
                )
                every = chapter_paths(checkout_root() / "notebooks")
                keep_results(out, every, preset, options.seed)
                print(f"\n{run_time_table(done)}\n\nresults: {out / 'results.json'}")
        except RuntimeError as error:
            print(f"hadr reproduce: error: {error}", file=sys.stderr)
            return 2
        keep_run_times(out, steps())
    print(f"how long each step took: {out / NAME}")
    return 0


def is_table_wish(wish: str) -> bool:
    """Say whether a word of ``--only`` means a table's run and not a chapter."""
    from hadr.experiments.plan import TABLE_RUNS
    from hadr.experiments.protocol import EXPERIMENTS
    from hadr.experiments.systems import ALL_METHODS

    names = (*EXPERIMENTS, *ALL_METHODS, *TABLE_RUNS, "full")
    return "/" in wish or wish.lower() in names


def open_bench(options: Options) -> Bench:
    """Open the bench that the options describe; for a plan alone, its data may be missing."""
    from hadr.data.folder_checks import check_data
    from hadr.data.folders import check_folders, has_split
    from hadr.data.samples import samples_dir
    from hadr.data.transhand import SPLITS
    from hadr.experiments.runner import Bench
    from hadr.training.loop import chosen_device

    for path in sorted((options.out / "tables").glob("*.json")):
        found = re.search(r"\(preset (\w+)\)", path.read_text(encoding="utf-8"))
        if found and found[1] != options.preset:
            raise ValueError(
                f"{path} is of preset {found[1]}, not {options.preset}: give each its own --out"
            )
    roots: Sequence[Path] = options.data
    tiny = options.preset == "tiny"
    if options.dry_run and not options.again and not (tiny or all(root.is_dir() for root in roots)):
        roots = []
    elif not roots and tiny:
        roots = [samples_dir() / "frames"]
    elif not roots and not options.dry_run:
        raise ValueError(
            f"the tables of preset {options.preset} need --data DIR; make one with "
            f"'{_generate(options.preset)} --out DIR'"
        )
    check_folders(roots)
    for root in roots:
        if not has_split(root, "train"):
            raise FileNotFoundError(f"{root} has no split 'train': its layout is not known")
    if roots and not options.dry_run:
        check_data(roots, SPLITS)
    limit = TINY_FRAMES if tiny else None
    accelerator = chosen_device(options.accelerator)
    out, corruption, keep = options.out / "runs", options.corruption, options.keep_trained
    return Bench(roots, out, options.preset, corruption, limit, accelerator, keep)


def _data_step(size: str, times: dict[str, float]) -> Step:
    """The step that makes the data of a preset, for a plan without them: nothing else is done."""
    from hadr.synthesis.generation.settings import PRESETS

    name = f"{_generate(size)} --out DIR"
    frames = f"{NEAR_FRAMES if size == 'imagenet' else PRESETS[size].frames:,} frames"
    return Step("data", name, frames, times.get(name), "DIR, for --data")


def _generate(size: str) -> str:
    """The command that makes the frames that a preset of networks learns from."""
    wish = f"mini --no-sensor --frames {NEAR_FRAMES}" if size == "imagenet" else size
    return f"hadr generate --preset {wish}"


def _run_again(options: Options, file: str, method: str) -> int:
    """Run ``hadr reproduce --again``: 0 where the numbers agree, 1 where they don't."""
    from hadr.experiments.again import measure_again, row_to_run

    bench = open_bench(options)
    if options.dry_run:
        row_to_run(bench, file, method)  # raises where it can't be run
        print(f"row {method!r} of {file} would be run again in {options.out}")
        return 0
    with sole_owner(options.out, "hadr reproduce"):
        return 0 if measure_again(bench, file, method) else 1


def write_report(out: Path, size: str) -> None:
    """Write the report of a folder's tables, beside the paper's where these are at hand."""
    from hadr.press.paper_report import TITLES, report

    try:
        published = checkout_root() / "results" / "paper_tables.json"
    except FileNotFoundError:
        return
    if published.exists() and any((out / "tables" / f"{name}.json").exists() for name in TITLES):
        text = f"# The paper's tables, and ours\n\n{report(out / 'tables', published, size)}"
        path = out / "report.md"
        if path.is_file() and not is_sealed_page(path):
            set_aside(path)
        write_whole(path, sealed_page(text))
        print(f"the report: {path}")
