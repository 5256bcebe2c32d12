"""Run the chapters with papermill and time them; a failure says where, and keeps what was done.

They run on kernels of this very Python, out of reach of a user's settings.
"""

import contextlib
import json
import os
import re
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

from hadr.experiments.steps import Step, seconds_text
from hadr.press import chapter_record
from hadr.records.output_folder import CACHE
from hadr.records.reading import parse_json, read_bytes

CELL_TIMEOUT_S = 3600
"""A cell that takes longer hangs; the longest takes a minute, or many on a busy machine."""
WHOLE = ("tables", "handover", "chapters")
"""What ``--only`` takes as a whole, in the order in which it is made."""
_RUNNING: set[Any] = set()  # nbclient's clients
_ANSI = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


@dataclass(frozen=True)
class ChapterRun:
    """One executed chapter: its notebook, and the seconds that it took."""

    notebook: Path
    duration_s: float

    @property
    def name(self) -> str:
        """Such as ``03_ray_voxels``."""
        return self.notebook.stem


class ChapterError(RuntimeError):
    """A chapter stopped with an error; the text says where, and where the notebook was kept."""


def chapter_paths(notebooks: Path, only: Sequence[str] = ()) -> list[Path]:
    """The chapters' notebooks, NN_name.ipynb of a folder, in the book's order.

    `only` has numbers or beginnings of names (``03``, ``3``, ``03_ray``); empty takes all.
    ValueError where one is empty or fits no chapter, or there is no chapter at all.
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
                f"no chapter begins with {wish!r}; the chapters are {names} (hadr reproduce also "
                f"takes {', '.join(WHOLE)}, or a run of the tables, EXPERIMENT/METHOD)"
            )
        wanted += fitting
    return sorted(set(wanted)) if only else paths


def run_notebooks(
    notebooks: Sequence[Path],
    out_dir: Path,
    *,
    preset: str = "tiny",
    seed: int = 0,
    say: Callable[[str], None] = print,
    resume: bool = False,
    jobs: int = 1,
) -> list[ChapterRun]:
    """Execute notebooks with papermill, each on a kernel of its own, `jobs` at a time.

    The folder takes ``executed/NAME.ipynb`` and, as each notebook's own ``out_dir``,
    ``results/NAME/``. To resume leaves out those that were executed already, if since then neither
    they nor the library nor the data that they read have changed.

    Raises:
        ChapterError: A cell raised, took too long, or its kernel died. The half-executed
            notebook is kept.
    """
    out_dir = out_dir.resolve()

    def run(notebook: Path) -> tuple[ChapterRun, bool]:
        target, folder, results = _places(notebook, out_dir)
        configuration = chapter_record.chapter_configuration(notebook, preset, seed)
        made = folder, configuration, target, results
        duration = chapter_record.finished_chapter(*made) if resume else None
        was_there = duration is not None
        if duration is None:
            folder.mkdir(parents=True, exist_ok=True)
            target.parent.mkdir(parents=True, exist_ok=True)
            chapter_record.keep_changed(folder, target, results)
            for stale in (results, folder / chapter_record.RECORD):
                stale.unlink(missing_ok=True)
            parameters = {"preset": preset, "seed": seed, "out_dir": str(folder)}
            try:
                duration = _execute(notebook, target, parameters, shown=jobs == 1)
            except BaseException:
                with contextlib.suppress(OSError):  # such as a full disk, which is told already
                    chapter_record.keep_unfinished(folder, target, results)
                raise
            chapter_record.keep_chapter(folder, configuration, duration, target, results)
        return ChapterRun(target, duration), was_there

    runs = []
    with private_jupyter(out_dir / CACHE), ThreadPoolExecutor(jobs) as pool:
        waiting = [pool.submit(run, notebook) for notebook in notebooks]
        try:
            for number, done in enumerate(waiting, start=1):
                chapter, was_there = done.result()
                label = f"[{number:2d}/{len(notebooks)}] {chapter.name}"
                say(f"{label:<40} {chapter.duration_s:6.1f} s" + " (was there)" * was_there)
                runs.append(chapter)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            while not all(one.done() for one in waiting):
                end_kernels()
                time.sleep(0.2)
            raise
    return runs


def _places(notebook: Path, out_dir: Path) -> tuple[Path, Path, Path]:
    """The executed notebook, the folder of what it measures, and its ``results.json``."""
    folder = out_dir / "results" / notebook.stem
    return out_dir / "executed" / notebook.name, folder, folder / "results.json"


def _execute(source: Path, target: Path, parameters: dict[str, Any], shown: bool) -> float:
    import papermill
    from nbclient.exceptions import CellTimeoutError, DeadKernelError
    from papermill.exceptions import PapermillExecutionError

    progress = {
        "desc": source.stem, "leave": False, "disable": None if shown else True, "file": sys.stderr
    }  # fmt: skip
    try:
        done = papermill.execute_notebook(
            *(re.sub(r"[{}]", r"\g<0>\g<0>", str(path)) for path in (source, target)),  # it formats
            parameters=parameters,
            engine_name=register_engine(),
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
    return float(done.metadata.papermill.duration)


@contextlib.contextmanager
def private_jupyter(folder: Path) -> Iterator[None]:
    """Keep a user's kernels, start-up files and caches out, and need no writable HOME."""
    kernel = folder / "jupyter" / "kernels" / "python3"
    kernel.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}",
               "--log-level=CRITICAL"]  # fmt: skip
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
        # Beside other work, threads that spin keep the processor from those they wait for: two
        # epochs of preset tiny beside four busy loops on two cores took 145 s, and 18 s so.
        "OMP_WAIT_POLICY": os.environ.get("OMP_WAIT_POLICY", "PASSIVE"),
    }
    with patch.dict(os.environ, changes):
        os.environ.pop("MPLBACKEND", None)
        yield


def register_engine() -> str:
    """Register a papermill engine that never waits in vain for a widget's cell; gives its name.

    nbclient's stand-in for an output widget writes to the socket on which the reply of the cell is
    awaited, and the reply that comes meanwhile may go unnoticed: measured on 400 cells, 0.70 s a
    cell instead of 0.02, and on a busy machine sometimes for ever. Without the stand-in, what a
    widget's function draws is output of its cell.
    """
    from papermill.clientwrap import PapermillNotebookClient
    from papermill.engines import Engine, papermill_engines

    class Client(PapermillNotebookClient):  # type: ignore[misc]
        def on_comm_open_jupyter_widget(self, msg: dict[str, Any]) -> None:
            """No stand-in for any widget."""

    class WidgetsApart(Engine):  # type: ignore[misc]
        @classmethod
        def execute_managed_notebook(
            cls, nb_man: Any, kernel_name: str, *, execution_timeout: int, **_: Any
        ) -> None:
            client = Client(nb_man, kernel_name=kernel_name, timeout=execution_timeout)
            _RUNNING.add(client)
            try:
                client.execute()
            finally:
                _RUNNING.discard(client)

    papermill_engines.register("hadr", WidgetsApart)
    return "hadr"


def end_kernels() -> None:
    """End all kernels under way; their notebooks fail with "the kernel died"."""
    for client in tuple(_RUNNING):
        with contextlib.suppress(AttributeError, TypeError, ProcessLookupError):  # not there
            os.kill(client.km.provisioner.pid, signal.SIGKILL)


def read_notebook(path: Path) -> Any:
    """Read a notebook; ValueError names one that is none of a known version."""
    import nbformat

    content = parse_json(read_bytes(path), path)
    try:
        nbformat.validate(content)
        return nbformat.reads(json.dumps(content), 4)
    except Exception as error:  # nbformat raises whatever it stumbles over
        words = str(error).splitlines() or [type(error).__name__]
        raise ValueError(f"{path} is no notebook: {words[0]:.200}") from error


def _cell_under_way(executed: Path) -> tuple[str, str]:
    """The last code cell that was begun, for a kernel that left no error output."""
    begun = [
        (index, cell)
        for index, cell in enumerate(read_notebook(executed).cells)
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
    """The measured run times as a Markdown table, perhaps with titles by the notebooks' names."""
    lines = ["| chapter | measured run time |", "| :-- | --: |"]
    for run in runs:
        title = (titles or {}).get(run.name, run.name)
        lines.append(f"| {title} | {seconds_text(run.duration_s)} |")
    lines.append(f"| together | {seconds_text(sum(run.duration_s for run in runs))} |")
    return "\n".join(lines)


def chapter_steps(
    notebooks: Sequence[Path], out_dir: Path, preset: str, seed: int, times: Mapping[str, float]
) -> list[Step]:
    """Describe the chapters as steps of a plan."""
    steps = []
    for notebook in notebooks:
        target, folder, results = _places(notebook, out_dir)
        configuration = chapter_record.chapter_configuration(notebook, preset, seed)
        took = chapter_record.finished_chapter(folder, configuration, target, results)
        left, seconds = ("execution", times.get(notebook.stem)) if took is None else ("done", took)
        steps.append(Step("chapters", notebook.stem, left, seconds, f"executed/{notebook.name}"))
    return steps
