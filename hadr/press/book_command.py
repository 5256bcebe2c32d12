"""`hadr book`: execute the chapters, or take those of the last time, and build the HTML book."""

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from hadr.experiments.steps import seconds_text
from hadr.press import chapters
from hadr.press.chapter_record import keep_results
from hadr.press.chapters import ChapterRun, chapter_paths
from hadr.records.checkout import checkout_root
from hadr.records.option_words import CHAPTER, FOLDER, LARGEST_SEED, MOST_JOBS, check_range
from hadr.records.output_folder import (
    check_file,
    check_output_folder,
    check_own,
    check_removable,
    make_output_folder,
)
from hadr.records.provenance import IF_CHANGED, machine_text, usable_cores
from hadr.records.reading import structured
from hadr.records.writing import sole_owner

EPILOG = """
examples
  hadr book                             all chapters and the book, into build/
  hadr book --only 03 04                two chapters, to look at while writing
  hadr book --html-only                 the pages again, nothing is executed

exit status
  0 done   2 a chapter or the build failed, or a wrong call   130 interrupted"""


@dataclass(frozen=True)
class Options:
    """Execute the chapters and build the HTML book from them."""

    build: Annotated[Path, FOLDER] = Path("build")
    """Folder that takes all that is made."""
    preset: Literal["tiny", "mini", "paper"] = "tiny"
    """How much the chapters compute."""
    seed: int = 0
    """The chapters' seed."""
    only: Annotated[tuple[str, ...], CHAPTER] = ()
    """Only these chapters, such as `03 04`; links to the others are not checked."""
    jobs: int = min(2, usable_cores())
    """Chapters at a time; 1 for run times that nothing beside them lengthens."""
    html_only: bool = False
    """Build from the notebooks executed last time."""
    readme_times: bool = False
    """Write the measured times into README.md, and build nothing."""


def run(options: Options) -> int:
    """Build the book as the options say: 0 when it stands; 2 when a chapter or the build failed."""
    from hadr.press.book import build_html, readme_table, stage_book, update_readme

    root, say = checkout_root(), partial(print, flush=True)
    try:
        check_range("seed", options.seed, 0, LARGEST_SEED)
        check_range("jobs", options.jobs, 1, MOST_JOBS)
        build = check_output_folder(options.build)
        if options.readme_times:
            update_readme(root / "README.md", readme_table(build, root))
            return 0
        check_own(options.build)
        check_removable(build / "book")
        check_file(build / "results.json")  # one that is not of a run is kept beside it
        every = chapter_paths(root / "notebooks")
        paths = chapter_paths(root / "notebooks", options.only)
        make_output_folder(build)
        started = time.perf_counter()
        with sole_owner(build, "hadr book"):
            if options.html_only:
                runs = _runs_of_last_time(build, paths)
            else:
                say(f"executing {len(paths)} notebooks, preset {options.preset}")
                preset, seed, jobs = options.preset, options.seed, options.jobs
                runs = chapters.run_notebooks(
                    paths, build, preset=preset, seed=seed, say=say, jobs=jobs
                )
                keep_results(build, every, preset, seed, say=say)
            say("building the HTML book")
            staged = stage_book(root / "book", runs, build / "book")
            index = build_html(staged, build / "html", strict=not options.only)
    except RuntimeError as error:
        print(f"hadr book: error: {error}", file=sys.stderr)
        return 2
    print(f"\n{chapters.run_time_table(runs)}\n")
    print(f"everything took {seconds_text(time.perf_counter() - started)} on {machine_text()}")
    print(f"the book: {index}")
    return 0


@dataclass(frozen=True)
class _Times:
    """What papermill notes in a notebook, seconds."""

    duration: float | None = field(default=None, metadata=IF_CHANGED)


def _runs_of_last_time(build: Path, paths: Sequence[Path]) -> list[ChapterRun]:
    runs = []
    for path in paths:
        executed = build / "executed" / path.name
        if not executed.exists():
            raise FileNotFoundError(f"{executed} is missing: run without --html-only first")
        told = chapters.read_notebook(executed).metadata.get("papermill", {})
        times = structured(told, _Times, executed, further=True)
        runs.append(ChapterRun(executed, times.duration or 0.0))
    return runs
