"""``hadr course``: everything a teacher hands out, made from the chapters."""

import contextlib
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from hadr.press.chapters import chapter_paths, run_notebooks
from hadr.press.course.chapter import Chapter, plain_markdown, read_chapters, short_citations
from hadr.press.course.slides import build_slides, missing_packages
from hadr.records.caches import file_sha256
from hadr.records.checkout import checkout_root
from hadr.records.option_words import CHAPTER, FOLDER, LARGEST_SEED, check_range
from hadr.records.output_folder import check_output_folder, wrote
from hadr.records.reading import read_json
from hadr.records.result_file import seal_row
from hadr.records.writing import whole_folder

MANIFEST = "course.json"
"""Checksums of what was written: a later run knows its own files from changed and foreign ones."""
MADE_BY = "hadr course"
EPILOG = """\
examples
  hadr course --out course                     all chapters, some minutes
  hadr course --out course --no-slides         the notebooks alone, seconds
  hadr course --out week2 --only 3 4           two chapters
  hadr course --out course --executed build    figures from the last `hadr book`

exit status
  0 done   2 a chapter failed, or the folder cannot be used"""


@dataclass(frozen=True)
class Options:
    """Write what a teacher needs into one folder.

    It gets student/ (notebooks with solutions removed and check cells kept), solutions/ (with the
    solutions filled in), tests/ (for otter-grader), slides/ (one reveal.js deck per chapter, which
    needs no network) and instructor.md (plans for 2, 6 and 12 hours, goals, marks, common
    mistakes). The notebooks carry nbgrader's metadata.

    For the slides' figures the solutions are executed, which takes about as long as `hadr book`,
    and which also proves that each solution passes its check. The same chapters give the same
    files.
    """

    out: Annotated[Path, FOLDER]
    """A new folder, or one that this command wrote and nobody changed."""
    only: Annotated[tuple[str, ...], CHAPTER] = ()
    """Only these chapters, such as `3 4`."""
    preset: Literal["tiny", "mini", "paper"] = "tiny"
    """The notebooks' parameter of this name: how much chapter 6 trains."""
    seed: int = 0
    """The notebooks' seed."""
    executed: Annotated[Path | None, FOLDER] = None
    """Take figures from the chapters that `hadr book --build` executed here; execute nothing."""
    no_slides: bool = False
    """Write no slides, execute nothing."""


def run(options: Options) -> int:
    """Write a course as the options say."""
    from hadr.press.course.teaching import NBGRADER_CONFIG, instructor_text

    if options.no_slides and options.executed is not None:
        raise ValueError("--executed has the figures of slides: it does not go with --no-slides")
    check_range("seed", options.seed, 0, LARGEST_SEED)
    root = checkout_root()
    check_target(options.out)
    every = read_chapters(root)
    wanted = {path.stem for path in chapter_paths(root / "notebooks", options.only)}
    chapters = [chapter for chapter in every if chapter.name in wanted]
    if not options.no_slides and (missing := missing_packages()):
        raise ValueError(
            f"slides need {', '.join(missing)}: pip install -e '.[book]', or --no-slides"
        )
    plain = plainer(root)
    about = {"preset": options.preset, "seed": options.seed, "chapters": [c.name for c in chapters]}
    try:
        with written_whole(options.out, about) as folder:
            write_notebooks(folder, chapters, options, plain)
            text = plain(instructor_text(chapters, every))
            (folder / "instructor.md").write_text(text, encoding="utf-8")
            (folder / "nbgrader_config.py").write_text(NBGRADER_CONFIG, encoding="utf-8")
            if not options.no_slides:
                with tempfile.TemporaryDirectory() as work:
                    executed = _executed(options, chapters, folder / "solutions", Path(work))
                    slides = Path(work) / "slides"
                    build_slides(chapters, executed, plain, slides, folder / "slides")
    except RuntimeError as error:
        raise ValueError(str(error)) from error
    marks = [exercise.marks for chapter in chapters for exercise in chapter.exercises]
    count = "1 chapter" if len(chapters) == 1 else f"{len(chapters)} chapters"
    print(f"{count}, {len(marks)} exercises, {sum(marks)} marks: {options.out}")
    return 0


def plainer(root: Path) -> Callable[[str], str]:
    """What turns the book's Markdown into such as any Jupyter shows."""
    from hadr.press.notebook_twins import repository

    citations = short_citations((root / "book" / "references.bib").read_text(encoding="utf-8"))
    pages = f"{repository(root / 'book')['url']}/blob/main/book"
    return lambda text: plain_markdown(text, citations, pages)


def write_notebooks(
    folder: Path, chapters: Sequence[Chapter], options: Options, plain: Callable[[str], str]
) -> None:
    """Write ``student/``, ``solutions/`` and ``tests/`` into a folder."""
    from hadr.press.course.graded import course_notebook, otter_test

    for chapter in chapters:
        for part, solved in (("student", False), ("solutions", True)):
            text = course_notebook(
                chapter, solved=solved, preset=options.preset, seed=options.seed, plain=plain
            )
            (folder / part).mkdir(exist_ok=True)
            (folder / part / f"{chapter.name}.ipynb").write_text(text, encoding="utf-8")
        tests = folder / "tests" / chapter.name
        tests.mkdir(parents=True)
        for exercise in chapter.exercises:
            (tests / f"{exercise.label}.py").write_text(otter_test(exercise), encoding="utf-8")


def _executed(
    options: Options, chapters: Sequence[Chapter], solutions: Path, work: Path
) -> dict[str, Path]:
    """The executed notebook of each chapter, by name."""
    if options.executed is not None:
        folder = options.executed / "executed"
        found = {chapter.name: folder / f"{chapter.name}.ipynb" for chapter in chapters}
        for path in found.values():
            if not path.exists():
                raise FileNotFoundError(f"{path} is missing: run `hadr book` first")
        return found
    print(f"executing {len(chapters)} solutions, preset {options.preset}", flush=True)
    paths = [solutions / f"{chapter.name}.ipynb" for chapter in chapters]
    runs = run_notebooks(paths, work / "run", preset=options.preset, seed=options.seed)
    return {run.name: run.notebook for run in runs}


def _checksums(folder: Path) -> dict[str, str]:
    paths = sorted(p for p in folder.rglob("*") if p.is_file() and p != folder / MANIFEST)
    return {path.relative_to(folder).as_posix(): file_sha256(path) for path in paths}


def check_target(out: Path) -> None:
    """Refuse a folder that is neither missing, nor empty, nor as an earlier run left it."""
    check_output_folder(out)
    if not out.exists() or not any(out.iterdir()):
        return
    if not wrote(out / MANIFEST, made_by=MADE_BY, files=""):
        raise ValueError(
            f"--out {out} is not empty, and `{MADE_BY}` did not write it; name a new folder"
        )
    files = read_json(out / MANIFEST)["files"]
    if changed := sorted(name for name, sha in _checksums(out).items() if files.get(name) != sha):
        listed = ", ".join(changed[:3]) + (f" and {len(changed) - 3} more" if changed[3:] else "")
        raise ValueError(
            f"--out {out} holds files that were added or changed since `{MADE_BY}` wrote it: "
            f"{listed}; move them away or name a new folder"
        )


@contextlib.contextmanager
def written_whole(out: Path, about: Mapping[str, Any]) -> Iterator[Path]:
    """Give a folder to write into that becomes ``out`` with a list of checksums, or nothing does.

    ``about`` is what else the list says.
    """
    with whole_folder(out, MADE_BY, partial(check_target, out)) as fresh:
        yield fresh
        content = {"made_by": MADE_BY, **about, "files": _checksums(fresh)}
        seal_row(fresh / MANIFEST, content)
