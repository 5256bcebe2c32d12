"""What needs processes of its own: kills, two at once, a full disk, planted modules, open ports."""

# fmt: off
# ruff: noqa: E501

import contextlib
import hashlib
import json
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from break_it.cases import (
    ATTEMPT,
    CALIBRATE,
    COURSE,
    EVALUATE,
    EXECUTED,
    GENERATE,
    HTML,
    NEAREST,
    TRAIN,
    VIEW,
)
from break_it.worker import complaint, differences, snapshot

Row = dict[str, Any]
FRESH = ATTEMPT.words(out="out")
ROWS = ("reproduce", "--out", "out", "--only", "known/raw", "known/nearest", "known/hand-median")


@dataclass(frozen=True)
class Run:
    """A command that writes: what it needs of the valid files, what it makes, how it goes on.

    Two of a kind that `locks` can't work on one folder: the second is refused. Of the others both
    may end, if what they leave is right.
    """

    name: str
    words: tuple[str, ...]
    needs: tuple[str, ...]
    makes: tuple[str, ...] = ("out",)
    goes_on: tuple[str, tuple[str, ...]] = ("", ())
    other: tuple[str, ...] = ()
    locks: bool = False
    kills: int = 5
    limits: tuple[int, ...] = (0, 20_000)

    @property
    def command(self) -> str:
        return self.words[0]

    def line(self, folder: Path, *more: str) -> list[str]:
        there, words = self.goes_on
        again = words if there and (folder / there).exists() else ()
        return [str(Path(sys.executable).with_name("hadr")), *self.words, *again, *more]


RUNS = (
    Run("generate", ("generate", *GENERATE.words(frames="4", recordings=None)), (),
        other=("--seed", "7"), locks=True, kills=8),
    Run("generate, 2 workers", ("generate", *GENERATE.words(frames="6", workers="2", recordings=None)),
        ("recordings",), kills=6, other=("--seed", "7"), locks=True),
    Run("train", ("train", *TRAIN.words(epochs="6")), ("data",), other=("--seed", "7"), locks=True,
        goes_on=("out/last.safetensors", ("--resume",)), kills=10, limits=(0, 20_000, 3_000_000)),
    Run("handover", ("handover", *FRESH), (), locks=True),
    Run("reproduce", ROWS, (), locks=True),
    Run("restore", ("restore", *NEAREST.words()),
        ("rgb.png", "depth.png", "camera.json", "mask.png"), goes_on=("out", ("--overwrite",))),
    Run("evaluate", ("evaluate", *EVALUATE.words()), ("net.safetensors", "data"), ("out.json",),
        limits=(0, 500)),
    Run("calibrate", ("calibrate", *CALIBRATE.words()), ("plus.safetensors", "plus.json", "data"),
        ("out.json", "plus.safetensors", "plus.json")),
    Run("course", ("course", *COURSE.words()), (), kills=4),
    Run("view", ("view", *VIEW.words()), ("restored",), ("restored",), kills=3),
    Run("book", ("book", *HTML.words()), ("build",), ("build",), kills=3),
)
Job = tuple[str, Run, Callable[["Bench"], list[Row]]]
#: Commands that start Pythons of their own, in a folder with modules of others.
PLANTED = ("mitsuba", "jupyter_book", "torch", "numpy", "yaml", "sphinx", "distributed", "ipykernel",
           "hadr", "json", "nbformat", "mujoco", "multiprocessing", "ipykernel_launcher", "struct",
           "asyncio")
PROBES = (
    Run("generate, 2 workers", ("generate", *GENERATE.words(frames="4", workers="2", recordings=None)), ()),
    Run("generate, photo", ("generate", *GENERATE.words(engine="photo", quality=None)), ("recordings",)),
    Run("handover, 2 jobs", ("handover", *ATTEMPT.words(out="out", jobs="2", holds="902\t903")), ()),
    Run("reproduce, a chapter", ("reproduce", "--out", "out", "--only", "00"), ()),
    Run("reproduce, 2 jobs", (*ROWS, "--jobs", "2"), ()),
    Run("book", ("book", *HTML.words()), ("build",), ("build",)),
    Run("course", ("course", *EXECUTED.words()), ("build",)),
)
CLOCK = {"seconds", "wall_seconds", "planning_wall_seconds", "mean_wall_seconds",
         "mean_planning_wall_seconds", "evaluation_s", "duration_s", "provenance", "made_with",
         "created", "sha256", "log_sha256", "config_sha256"}
"""What differs between two runs of the same: wall times, and checksums of what holds some."""
OURS = {".made-by-hadr", ".nojekyll", ".buildinfo", ".doctrees"}


@dataclass
class Bench:
    """A folder with valid files, in which a run is tried."""

    fixtures: Path
    environment: dict[str, str]
    work: Path
    before: dict[str, str] = field(default_factory=dict)

    def folder(self, run: Run, name: str) -> Path:
        folder = self.work / name
        folder.mkdir(parents=True)
        for needed in run.needs:
            source = self.fixtures / needed
            (shutil.copytree if source.is_dir() else shutil.copy)(source, folder / needed)
        self.before = snapshot(folder)
        return folder

    def start(self, line: Sequence[str], folder: Path, **more: Any) -> subprocess.Popen[str]:
        return subprocess.Popen(
            line, cwd=folder, env=self.environment, text=True, stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE, start_new_session=True, **more,
        )

    def ended(self, process: subprocess.Popen[str], timeout: float = 900) -> tuple[int, str]:
        """Exit status and stderr; after the time limit it is killed."""
        try:
            told = process.communicate(timeout=timeout)[1]
        except subprocess.TimeoutExpired:
            kill(process)
            return -9, "no answer"
        return process.returncode, told

    def harm(self, run: Run, folder: Path, *, swept: bool) -> str:
        """What a run has left that it should not: lost inputs, half files, temporary ones."""
        lost = [n for n in differences(self.before, snapshot(folder))[0]
                if n.split("/")[0] not in run.makes]
        half = [str(p.relative_to(folder)) for p in visible(folder) if not whole(p)]
        hidden = [str(p.relative_to(folder)) for p in folder.rglob(".*") if p.name not in OURS]
        if lost or half:
            return f"lost or changed: {lost[:5]}, half-written: {half[:5]}"
        return f"left over: {sorted(hidden)[:5]}" if hidden and swept else ""


def kill(process: subprocess.Popen[str]) -> bool:
    """Kill a command and what it started; whether it was still running."""
    running = process.poll() is None
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    return running


def visible(folder: Path) -> list[Path]:
    files = [p for p in folder.rglob("*") if p.is_file() and not p.is_symlink()]
    return [p for p in files if not any(x.startswith(".") for x in p.relative_to(folder).parts)]


def whole(path: Path) -> bool:
    """Whether a file can be read from begin to end."""
    import cv2

    try:
        if path.suffix in (".json", ".ipynb"):
            json.loads(path.read_text())
        elif path.suffix in (".npz", ".npy"):
            found = np.load(path)
            for name in getattr(found, "files", ()):
                found[name]
        elif path.suffix in (".png", ".jpg"):
            return cv2.imread(str(path), cv2.IMREAD_UNCHANGED) is not None
        elif path.suffix == ".safetensors":
            return bool(tensors(path))
    except Exception:
        return False
    return path.suffix not in (".csv", ".md", ".yaml") or path.stat().st_size > 0


def tensors(path: Path) -> dict[str, str]:
    from safetensors.numpy import load_file

    return {n: hashlib.sha256(v.tobytes()).hexdigest() for n, v in load_file(path).items()}


def without_clock(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: without_clock(v) for k, v in value.items() if k not in CLOCK}
    return [without_clock(v) for v in value] if isinstance(value, list) else value


def essence(folder: Path) -> dict[str, Any]:
    """What must be the same in two runs of a command: contents without the clock's numbers."""
    found: dict[str, Any] = {}
    for path in visible(folder):
        name = path.relative_to(folder).as_posix()
        if path.suffix in (".json", ".ipynb"):
            found[name] = without_clock(json.loads(path.read_text()))
        elif path.suffix == ".safetensors":
            found[name] = tensors(path)
        elif path.suffix in (".png", ".npy", ".npz", ".jpg", ".txt", ".ply"):
            found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
        else:
            found[name] = "there"
    return found


def row(kind: str, run: Run, name: str, verdict: str, detail: str = "") -> Row:
    places = re.findall(r'/(hadr/[\w/]+\.py)", line (\d+)', detail)
    return {"kind": kind, "command": run.command, "name": f"{run.name}: {name}", "verdict": verdict,
            "detail": detail.strip()[-600:], "expect": "safe",
            "place": ":".join(places[-1]) if places else ""}


def refused(run: Run, status: int, told: str) -> tuple[str, str]:
    """The verdict on a run that could not go on."""
    if "Traceback (most recent call last)" in told:
        return "traceback", told
    if status not in (1, 2):
        return "wrong status", f"exit status {status}: {told}"
    wrong = complaint("", told, [], run.command)
    return ("unclear", wrong) if wrong else ("fine", "")


def kills(run: Run, bench: Bench) -> list[Row]:
    """Kill a run at random moments, go on with it, and compare with one that was left alone."""
    rng, straight = random.Random(run.name), bench.folder(run, "straight")
    started = time.perf_counter()
    status, told = bench.ended(bench.start(run.line(straight), straight))
    seconds = time.perf_counter() - started
    if status:
        return [row("kill", run, "left alone", "refused a right one", told)]
    folder, rows = bench.folder(run, "killed"), []
    for number in range(run.kills):
        process = bench.start(run.line(folder), folder)
        time.sleep(rng.uniform(0.2, 0.9) * seconds)
        running = kill(process)
        harm = bench.harm(run, folder, swept=False)
        if not running:  # nothing is left to kill: the next one begins anew
            shutil.rmtree(folder)
            bench.folder(run, "killed")
        name = f"kill {number + 1}" + ("" if running else ", came too late")
        rows.append(row("kill", run, name, "damaged" if harm else "fine", harm))
    status, told = bench.ended(bench.start(run.line(folder), folder))
    harm = bench.harm(run, folder, swept=True)
    if status:
        rows.append(row("kill", run, "the end", "refused a right one", told))
    elif harm:
        rows.append(row("kill", run, "the end", harm.split(":")[0], harm))
    else:
        one, two = essence(straight), essence(folder)
        other = [n for n in {**one, **two} if one.get(n) != two.get(n)]
        rows.append(row("kill", run, "the end", "other result" if other else "fine", str(other[:5])))
    return rows


def pair(run: Run, bench: Bench) -> list[Row]:
    """Start two of a command in one folder at once."""
    folder = bench.folder(run, "pair")
    both = [bench.start(run.line(folder, *more), folder) for more in ((), run.other)]
    ends = [bench.ended(process) for process in both]
    harm = bench.harm(run, folder, swept=True)
    statuses = [status for status, _ in ends]
    verdicts = [refused(run, *end) for end in ends if end[0]]
    wrong = [v for v in verdicts if v[0] != "fine"]
    if harm:
        found = (harm.split(":")[0].replace("lost or changed", "damaged"), harm)
    elif wrong:
        found = wrong[0]
    elif 0 not in statuses:
        found = ("no result", " ".join(told for _, told in ends))
    elif run.locks and statuses == [0, 0]:
        found = ("accepted", "both worked on one folder")
    else:
        found = ("fine", "")
    return [row("two at once", run, f"exit {statuses}", *found)]


def full(run: Run, limit: int, bench: Bench) -> list[Row]:
    """Let no file grow longer than a limit."""
    folder = bench.folder(run, f"full-{limit}")

    def small() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    status, told = bench.ended(bench.start(run.line(folder), folder, preexec_fn=small))
    harm = bench.harm(run, folder, swept=True)
    verdict = ("fine", "") if status == 0 else refused(run, status, told)
    if verdict[0] == "fine" and harm:
        verdict = harm.split(":")[0].replace("lost or changed", "damaged"), harm
    if status == 0 and limit == 0:
        verdict = "accepted", "ended with 0, but could write nothing"
    return [row("full disk", run, f"{limit} bytes", *verdict)]


def probe(run: Run, bench: Bench) -> list[Row]:
    """Run among planted modules, and look at the ports that are opened meanwhile."""
    import psutil

    folder = bench.folder(run, "probe")
    for name in PLANTED:
        mark = folder / f"executed-{name}"
        (folder / f"{name}.py").write_text(f"open({str(mark)!r}, 'w').close()\n")
    process, ports = bench.start(run.line(folder), folder), set[str]()
    told, deadline = "", time.monotonic() + 400
    while process.poll() is None and time.monotonic() < deadline:
        with contextlib.suppress(psutil.Error):
            top = psutil.Process(process.pid)
            for one in (top, *top.children(recursive=True)):
                with contextlib.suppress(psutil.Error):
                    for link in one.net_connections("inet"):
                        if link.status == psutil.CONN_LISTEN:
                            ports.add(link.laddr.ip)
        with contextlib.suppress(subprocess.TimeoutExpired):
            told = process.communicate(timeout=0.2)[1]
    kill(process)
    executed = sorted(p.name for p in folder.glob("executed-*"))
    far = sorted(ports - {"127.0.0.1", "::1"})
    status = process.returncode
    return [
        row("planted module", run, "", "executed" if executed else "fine", str(executed)),
        row("open port", run, "", "open port" if far else "fine", f"listens on {far}"),
        row("probe ends", run, "", "refused a right one" if status else "fine", told if status else ""),
    ]


def all_jobs() -> list[Job]:
    """Everything that needs processes: its kind, its run and what does it."""
    found: list[Job] = []
    for run in RUNS:
        found.append(("kill", run, partial(kills, run)))
        found.append(("two at once", run, partial(pair, run)))
        found += [("full disk", run, partial(full, run, limit)) for limit in run.limits]
    return found + [("probe", run, partial(probe, run)) for run in PROBES]
