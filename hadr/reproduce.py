"""Run the chapters with papermill, time them, and collect what they measured.

``hadr reproduce --preset tiny --out DIR`` executes every notebook without a user's hand and
leaves in DIR the executed notebooks, each chapter's ``results.json``, and one ``results.json``
over all of them with its provenance.
"""

import argparse
import contextlib
import json
import os
import re
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hadr.provenance import plain, provenance, write_json

CELL_TIMEOUT_S = 900
_ANSI = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


@dataclass(frozen=True)
class ChapterRun:
    """One executed chapter.

    Args:
        name: The notebook's name without suffix, such as ``03_ray_voxels``.
        duration_s: Wall-clock time that papermill measured, seconds.
        notebook: The executed notebook.
        results: The chapter's ``results.json``, or None where it wrote none.
    """

    name: str
    duration_s: float
    notebook: Path
    results: Path | None


class ChapterError(RuntimeError):
    """A chapter stopped with an error; the text says where, and where the notebook was kept."""


def checkout_root() -> Path:
    """The folder of the checkout that holds ``notebooks/`` and ``book/``.

    Raises:
        FileNotFoundError: The library was installed without its checkout.
    """
    root = Path(__file__).resolve().parents[1]
    if not (root / "notebooks").is_dir():
        raise FileNotFoundError(
            f"no folder 'notebooks' in {root}: chapters are run from a checkout of the "
            "repository; clone it and install it with `pip install -e .`"
        )
    return root


def chapter_paths(notebooks: Path, only: Sequence[str] = ()) -> list[Path]:
    """The chapters' notebooks in the book's order.

    Args:
        notebooks: Folder with NN_name.ipynb.
        only: Numbers or beginnings of names (``03``, ``3``, ``03_ray``); empty takes all.

    Raises:
        ValueError: A wish is empty or fits no chapter, or there is no chapter at all.
    """
    paths = sorted(notebooks.glob("[0-9][0-9]_*.ipynb"))
    if not paths:
        raise ValueError(f"no notebook named NN_name.ipynb in {notebooks}")
    wanted = []
    for wish in only:
        if not wish.strip():
            raise ValueError("--only has an empty word; leave --only out to take everything")
        beginning = wish.zfill(2) if wish.isdigit() else wish
        fitting = [path for path in paths if path.stem.startswith(beginning)]
        if not fitting:
            names = ", ".join(path.stem for path in paths)
            raise ValueError(
                f"{wish!r} is no run of the tables (EXPERIMENT/METHOD) and no chapter begins with "
                f"it; the chapters are {names}"
            )
        wanted += fitting
    return sorted(set(wanted)) if only else paths


@contextlib.contextmanager
def _private_jupyter(folder: Path) -> Iterator[None]:
    """Keep a user's kernels, start-up files and caches out, and need no writable HOME."""
    kernel = folder / "jupyter" / "kernels" / "python3"
    kernel.mkdir(parents=True, exist_ok=True)
    command = [
        sys.executable,
        "-m",
        "ipykernel_launcher",
        "-f",
        "{connection_file}",
        "--log-level=CRITICAL",
    ]
    specification = {"argv": command, "display_name": "Python 3", "language": "python"}
    (kernel / "kernel.json").write_text(json.dumps(specification), encoding="utf-8")
    changes = {
        "JUPYTER_PATH": str(folder / "jupyter"),
        "JUPYTER_CONFIG_DIR": str(folder / "jupyter" / "config"),
        "JUPYTER_RUNTIME_DIR": str(folder / "jupyter" / "runtime"),
        "JUPYTER_PLATFORM_DIRS": "1",
        "IPYTHONDIR": str(folder / "ipython"),
        "MPLCONFIGDIR": str(folder / "matplotlib"),
        "PYDEVD_DISABLE_FILE_VALIDATION": "1",
    }
    before = {key: os.environ.get(key) for key in [*changes, "MPLBACKEND"]}
    os.environ.update(changes)
    os.environ.pop("MPLBACKEND", None)
    try:
        yield
    finally:
        for key, value in before.items():
            if value is None:
                os.environ.pop(key, None)
            else:
                os.environ[key] = value


def run_notebooks(
    notebooks: Sequence[Path],
    out_dir: Path,
    *,
    preset: str = "tiny",
    seed: int = 0,
    say: Callable[[str], None] = print,
) -> list[ChapterRun]:
    """Execute notebooks with papermill, one after the other.

    Args:
        notebooks: Notebooks to execute; their files are not changed.
        out_dir: Takes ``executed/NAME.ipynb`` and, as each notebook's own ``out_dir``,
            ``results/NAME/``.
        preset: Value of the notebooks' parameter ``preset``.
        seed: Value of the notebooks' parameter ``seed``.
        say: Receives one line per notebook.

    Returns:
        One entry per notebook, in order.

    Raises:
        ChapterError: A cell raised, took too long, or its kernel died. The half-executed
            notebook is kept.
    """
    out_dir = out_dir.resolve()
    executed = out_dir / "executed"
    executed.mkdir(parents=True, exist_ok=True)
    runs = []
    with _private_jupyter(out_dir / "cache"):
        for number, notebook in enumerate(notebooks, start=1):
            label = f"[{number:2d}/{len(notebooks)}] {notebook.stem}"
            results_dir = out_dir / "results" / notebook.stem
            results_dir.mkdir(parents=True, exist_ok=True)
            (results_dir / "results.json").unlink(missing_ok=True)
            parameters = {"preset": preset, "seed": seed, "out_dir": str(results_dir)}
            target = executed / notebook.name
            duration = _execute(notebook, target, parameters, label)
            say(f"{label:<40} {duration:6.1f} s")
            results = results_dir / "results.json"
            found = results if results.exists() else None
            runs.append(ChapterRun(notebook.stem, duration, target, found))
    return runs


def _execute(source: Path, target: Path, parameters: dict[str, Any], label: str) -> float:
    import papermill
    from nbclient.exceptions import CellTimeoutError, DeadKernelError
    from papermill.exceptions import PapermillExecutionError

    progress = {"desc": label, "leave": False, "disable": None, "file": sys.stderr}
    started = time.perf_counter()
    try:
        done = papermill.execute_notebook(
            str(source),
            str(target),
            parameters=parameters,
            kernel_name="python3",
            language="python",
            progress_bar=progress,
            cwd=str(target.parent),
            execution_timeout=CELL_TIMEOUT_S,
        )
    except PapermillExecutionError as error:
        where = f"cell {error.cell_index} (In [{error.exec_count}])"
        trace = "\n".join(error.traceback) or f"{error.ename}: {error.evalue}"
        raise ChapterError(failure_text(source, where, error.source, trace, target)) from error
    except (DeadKernelError, CellTimeoutError) as error:
        where, cell = _cell_under_way(target)
        raise ChapterError(failure_text(source, where, cell, str(error), target)) from error
    duration = done.metadata.get("papermill", {}).get("duration")
    return float(duration) if duration else time.perf_counter() - started


def _cell_under_way(executed: Path) -> tuple[str, str]:
    """The last code cell that was begun, for a kernel that left no error output."""
    import nbformat

    begun = [
        (index, cell)
        for index, cell in enumerate(nbformat.read(executed, 4).cells)
        if cell.cell_type == "code" and cell.metadata.get("papermill", {}).get("start_time")
    ]
    if begun:
        return f"cell {begun[-1][0]}", str(begun[-1][1].source)
    return "an unknown cell", ""


def failure_text(notebook: Path, where: str, source: str, trace: str, kept: Path) -> str:
    """What a reader needs to mend a chapter: name, cell, traceback, and the kept notebook."""
    rule = "-" * 78
    cell = "\n".join(f"    {line}" for line in source.splitlines())
    return (
        f"{rule}\n{notebook.name} failed in {where}:\n\n{cell}\n\n"
        f"{without_ansi(trace).rstrip()}\n\n"
        f"The notebook as far as it was executed: {kept}\n{rule}"
    )


def without_ansi(text: str) -> str:
    """Text without the colour codes of a terminal."""
    return _ANSI.sub("", text)


def run_time_table(runs: Sequence[ChapterRun], titles: Mapping[str, str] | None = None) -> str:
    """The measured run times as a Markdown table.

    Args:
        runs: Executed chapters.
        titles: Optional titles by notebook name.
    """
    lines = ["| chapter | measured run time |", "| :-- | --: |"]
    for run in runs:
        title = (titles or {}).get(run.name, run.name)
        lines.append(f"| {title} | {seconds_text(run.duration_s)} |")
    lines.append(f"| together | {seconds_text(sum(run.duration_s for run in runs))} |")
    return "\n".join(lines)


def seconds_text(seconds: float) -> str:
    """A duration for readers: ``0.8 s``, ``14 s``, ``2 min 05 s``."""
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    return f"{whole} s" if whole < 60 else f"{whole // 60} min {whole % 60:02d} s"


def write_results(
    out_dir: str | Path, name: str, results: Mapping[str, Any], **parameters: str | int
) -> dict[str, Any]:
    """Keep what a chapter measured, as ``results.json`` with its provenance.

    Args:
        out_dir: Folder for the file; empty writes nothing, for readers who only look.
        name: The chapter's name, such as ``03_ray_voxels``.
        results: Numbers, strings, lists, arrays, nested as you like.
        **parameters: The run's parameters worth keeping, such as ``preset`` and ``seed``.

    Returns:
        What was, or would have been, written.
    """
    content: dict[str, Any] = {
        "chapter": name,
        "parameters": parameters,
        "results": plain(results),
        "provenance": provenance(),
    }
    if str(out_dir):
        write_json(Path(out_dir) / "results.json", content)
    return content


def collect_results(runs: Sequence[ChapterRun], preset: str, seed: int) -> dict[str, Any]:
    """All chapters' results and run times in one mapping.

    Args:
        runs: Executed chapters.
        preset: The preset they ran with.
        seed: The seed they ran with.
    """
    chapters = {}
    for run in runs:
        entry: dict[str, Any] = {"duration_s": round(run.duration_s, 3), "results": None}
        if run.results is not None:
            entry["results"] = json.loads(run.results.read_text(encoding="utf-8"))["results"]
        chapters[run.name] = entry
    parameters = {"preset": preset, "seed": seed}
    return {"parameters": parameters, "chapters": chapters, "provenance": provenance()}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe ``hadr reproduce`` to a command line parser."""
    from hadr.experiments.command import add_table_arguments

    parser.description = (
        "Train and score the systems of the tables, then execute the book's chapters and collect "
        "what they measure. A run that is finished is not repeated; one that was stopped goes on."
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
        "known/hadr unknown raw`), or all of either: `chapters`, `tables` (default: both)",
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder for notebooks and results"
    )
    parser.add_argument(
        "--dry-run", action="store_true", help="say what would be done and how long, and stop"
    )
    add_table_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Carry out ``hadr reproduce``.

    Returns:
        0 when all was done, 1 when a row that was run again gave other numbers, 2 when a chapter
        failed or a wish fits nothing.
    """
    from hadr.experiments.command import is_table_wish, run_again, run_tables

    wanted = set(args.only)
    runs = [wish for wish in args.only if is_table_wish(wish)]
    chapters = [w for w in args.only if w not in ("tables", "chapters") and w not in runs]
    try:
        if args.again:
            return run_again(args)
        paths = []
        if not wanted or chapters or "chapters" in wanted:
            paths = chapter_paths(checkout_root() / "notebooks", chapters)
        if not wanted or runs or "tables" in wanted:
            run_tables(args, [] if "tables" in wanted else runs)
    except (ValueError, FileNotFoundError, RuntimeError) as error:
        print(f"hadr reproduce: {error}", file=sys.stderr)
        return 2
    if args.dry_run:
        if paths:
            print(f"chapters, preset {args.preset}, seed {args.seed}; results go to {args.out}")
            print("\n".join(path.stem for path in paths))
        return 0
    if not paths:
        return 0
    try:
        executed = run_notebooks(paths, args.out, preset=args.preset, seed=args.seed)
    except ChapterError as error:
        print(error, file=sys.stderr)
        return 2
    write_json(args.out / "results.json", collect_results(executed, args.preset, args.seed))
    print(f"\n{run_time_table(executed)}\n\nresults: {args.out / 'results.json'}")
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run ``hadr reproduce`` without the rest of the command line."""
    parser = argparse.ArgumentParser(prog="python -m hadr.reproduce")
    add_arguments(parser)
    return run(parser.parse_args(arguments))


if __name__ == "__main__":
    raise SystemExit(main())
