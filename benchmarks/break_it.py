"""Try to break hadr: bad inputs, kills, full disks, two at once, and small probes of security.

    python benchmarks/break_it.py --out results/break_it.json
    python benchmarks/break_it.py --only field --command restore
    python benchmarks/break_it.py --list

Each case starts from a valid call and changes one thing (`break_it/cases.py`, `break_it/found.py`).
A bad input should be refused with exit status 2 and one sentence that names what is wrong; no
traceback, nothing written, nothing lost. All of it works on a copy of the checkout and in
temporary folders, as any user: files that can't be read are left out for root, who reads them all.
The disk is full for a process that may write no file longer than a limit (RLIMIT_FSIZE).
"""

import argparse
import contextlib
import json
import os
import queue
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import psutil
from break_it.cases import CHECKOUT, Case, all_cases
from break_it.fixtures import make_fixtures
from break_it.processes import Bench, Job, all_jobs
from break_it.worker import differences, snapshot

from hadr.records.provenance import provenance
from hadr.records.result_file import write_result_file

TIMEOUT = 30.0
"""After so many seconds of the processor a case has no answer."""
IDLE = 40
"""After so many seconds without work neither."""


class Worker:
    """A process that tries cases; a new one after each that gave no answer or died."""

    def __init__(self, fixtures: Path, environment: dict[str, str]) -> None:
        self.line = [sys.executable, "-P", "-m", "break_it.worker", str(fixtures)]
        self.environment, self.process = environment, None

    def tried(self, case: dict[str, Any], folder: Path, timeout: float) -> dict[str, Any]:
        if self.process is None:
            self.process = subprocess.Popen(
                self.line, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                stderr=subprocess.DEVNULL, env=self.environment, start_new_session=True,
            )  # fmt: skip
        request = json.dumps({"case": case, "folder": str(folder)})
        self.process.stdin.write(request + "\n")
        self.process.stdin.flush()
        if self.answers(timeout):
            answer = self.process.stdout.readline()
            if answer:
                return json.loads(answer)
        died = self.process.poll()
        self.stop()
        if died is not None:
            return {"verdict": "died", "detail": f"exit status {died}"}
        return {
            "verdict": "no answer",
            "detail": f"{timeout:.0f} s of work, or {IDLE} s of waiting",
        }

    def answers(self, timeout: float) -> bool:
        """Whether it has answered before it worked too long, or did nothing for `IDLE` seconds."""
        begun = last = self.worked()
        idle = 0
        while idle < IDLE and last - begun < timeout:
            if select.select([self.process.stdout], [], [], 1)[0]:
                return True
            now = self.worked()
            idle, last = (idle + 1, last) if now - last < 0.01 else (0, now)
        return False

    def worked(self) -> float:
        """Seconds of the processor, its children's with it."""
        with contextlib.suppress(psutil.Error):
            top = psutil.Process(self.process.pid)
            used = [one.cpu_times() for one in (top, *top.children(recursive=True))]
            return sum(t.user + t.system for t in used)
        return 0.0

    def stop(self) -> None:
        if self.process is not None:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()
            self.process = None


def environment_of(work: Path) -> dict[str, str]:
    """What the processes get: the copied checkout, one thread, caches of their own."""
    paths = (work / "checkout", CHECKOUT / "benchmarks")
    return {
        **{k: v for k, v in os.environ.items() if not k.startswith("HADR_")},
        "PYTHONPATH": os.pathsep.join(map(str, paths)), "PYTHONDONTWRITEBYTECODE": "1",
        "OMP_NUM_THREADS": "1", "MPLBACKEND": "Agg", "MPLCONFIGDIR": str(work / "cache"),
        "PIP_NO_INDEX": "1", "PIP_FIND_LINKS": "wheels",  # of the case's own folder
        "XDG_CACHE_HOME": str(work / "cache"), "TMPDIR": str(work / "tmp"),
    }  # fmt: skip


def try_all(cases: list[Case], work: Path, workers: int, timeout: float) -> list[dict[str, Any]]:
    """Try cases in a few processes."""
    waiting: queue.SimpleQueue[tuple[int, Case]] = queue.SimpleQueue()
    for pair in enumerate(cases):
        waiting.put(pair)
    answers: dict[int, dict[str, Any]] = {}

    def work_on() -> None:
        worker = Worker(work / "fixtures", environment_of(work))
        while True:
            try:
                number, case = waiting.get_nowait()
            except queue.Empty:
                return worker.stop()
            folder = work / f"case-{os.getpid()}-{number}"
            folder.mkdir()
            text = json.dumps(case.to_dict()).replace("{checkout}", str(work / "checkout"))
            started = time.perf_counter()
            patience = timeout if worker.process else timeout + 30  # it imports first
            patience *= 16 if case.expect == "works" else 1
            answer = worker.tried(json.loads(text), folder, patience)
            seconds = round(time.perf_counter() - started, 2)
            answers[number] = {**case.to_dict(), **answer, "seconds": seconds}
            shutil.rmtree(folder, ignore_errors=True)
            if len(answers) % 100 == 0:
                print(f"{len(answers)} of {len(cases)}", file=sys.stderr, flush=True)

    threads = [threading.Thread(target=work_on) for _ in range(workers)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return [answers[n] for n in range(len(cases))]


def do_all(jobs: list[Job], work: Path, workers: int) -> list[dict[str, Any]]:
    """Do what needs processes of its own, some at a time."""

    def do(number: int) -> list[dict[str, Any]]:
        kind, run, job = jobs[number]
        folder, started = work / f"job-{os.getpid()}-{number}", time.perf_counter()
        rows = job(Bench(work / "fixtures", environment_of(work), folder))
        seconds = time.perf_counter() - started
        shutil.rmtree(folder, ignore_errors=True)
        print(f"{kind}, {run.name}: {seconds:.0f} s", file=sys.stderr, flush=True)
        return [{**row, "seconds": round(seconds / len(rows), 1)} for row in rows]

    with ThreadPoolExecutor(workers) as pool:
        return [row for rows in pool.map(do, range(len(jobs))) for row in rows]


def summary(tried: list[dict[str, Any]]) -> dict[str, dict[str, int]]:
    """How many ended how, by command."""
    table: dict[str, dict[str, int]] = {}
    for command in (*sorted({t["command"] for t in tried}), "all"):
        some = [t for t in tried if command in (t["command"], "all")]
        killed = sum(t["kind"] == "kill" and t["name"][-1].isdigit() for t in some)  # in time
        table[command] = {
            "tried": len(some),
            "kills": killed,
            **Counter(t["verdict"] for t in some),
        }
    return table


def summary_text(table: dict[str, dict[str, int]]) -> str:
    first = ["tried", "kills", "fine"]
    columns = [*first, *sorted({name for row in table.values() for name in row} - {*first})]
    lines = ["".join(["".ljust(22), *(f"{name:>12}" for name in columns)])]
    for command, row in table.items():
        lines.append(command.ljust(22) + "".join(f"{row.get(name, 0):12d}" for name in columns))
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", help="cases of these classes")
    parser.add_argument("--command", nargs="+", help="cases of these commands or readers")
    parser.add_argument("--out", type=Path, help="result file of the summary and what failed")
    parser.add_argument("--list", action="store_true", help="print the cases and stop")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--timeout", type=float, default=TIMEOUT)
    parser.add_argument("--work", type=Path, help="keep the valid files here, and take them again")
    args = parser.parse_args()

    def wanted(kind: str, command: str) -> bool:
        return kind in (args.only or [kind]) and command in (args.command or [command])

    cases = [case for case in all_cases() if wanted(case.kind, case.command)]
    jobs = [job for job in all_jobs() if wanted(job[0], job[1].command)]
    if os.geteuid() == 0:
        cases = [case for case in cases if case.kind != "unreadable"]
    if args.list:
        for case in cases:
            print(f"{case.kind:14} {case.command:20} {case.expect:8} {case.name!r}")
        for kind, run, _ in jobs:
            print(f"{kind:14} {run.command:20} {'':8} {run.name!r}")
        kills = sum(run.kills for kind, run, _ in jobs if kind == "kill")
        print(f"{len(cases)} bad inputs, {kills} kills, {len(jobs)} tasks with processes")
        return
    started = time.perf_counter()
    with contextlib.ExitStack() as left:
        folder = args.work or left.enter_context(tempfile.TemporaryDirectory(prefix="break-it-"))
        work = Path(folder).resolve()
        sources = make_fixtures(work, environment_of(work))
        made = time.perf_counter()
        print(f"fixtures: {made - started:.0f} s", file=sys.stderr, flush=True)
        tried = try_all(cases, work, args.workers, args.timeout)
        tried += do_all(jobs, work, args.workers)
        lost, new = differences(sources, snapshot(work / "checkout"))
    lost = [name for name in lost if name != "README.md"]  # `book --readme-times` writes it
    new = [name for name in new if "__pycache__" not in name]
    failed = [t for t in tried if t["verdict"] != "fine"]
    table = summary(tried)
    for one in failed:
        print(f"{one['verdict']:12} {one['command']} [{one['kind']}] {one['name']!r}: "
              f"{one.get('place', '')} {one['detail'][:160]!r}")  # fmt: skip
    print(summary_text(table))
    print(f"sources changed: {lost[:9]}, new among them: {new[:9]}")
    seconds = time.perf_counter() - started
    print(f"{len(tried)} cases, {len(failed)} failed, {seconds:.0f} s")
    if args.out:
        what = (
            "bad inputs, kills, full disks, two at once: by command, how many were tried, how many "
            "of these were kills of a running command, and how many ended as they should; what "
            "failed is named"
        )
        rows = [
            {"command": command, **row, "failed": [
                {name: str(one[name])[:200] for name in ("kind", "name", "verdict", "detail")}
                for one in failed
                if command == one["command"]
            ]}
            for command, row in table.items()
        ]  # fmt: skip
        about = {**provenance(), "workers": args.workers}
        write_result_file(args.out, what, rows, about | {"seconds": round(seconds)})
    raise SystemExit(1 if failed or lost or new else 0)


if __name__ == "__main__":
    main()
