"""Kill a training at random moments, resume it, and compare with an uninterrupted one.

    python benchmarks/kill_training.py --kills 10 --json results/training/killed.json

Half of the kills come at random times, half while the epoch's files are being written. After each
kill the folder must hold a whole checkpoint or none; at the end weights, the optimiser's state, the
best epoch's weights and the history must be those of the uninterrupted training, bit for bit.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import safe_open
from safetensors.torch import load_file

from hadr.records.provenance import provenance
from hadr.records.result_file import write_sealed
from hadr.training.training_folder import BEST, LAST, best_epoch

HEADER = "hadr"


def command(folder: Path, options: list[str], *, resume: bool) -> list[str]:
    """The command of a tiny training."""
    line = [sys.executable, "-m", "hadr.cli", "train", "--preset", "tiny", "--out", str(folder)]
    return [*line, *options, *(["--resume"] if resume else [])]


def record(path: Path) -> dict[str, Any]:
    """The record in a checkpoint's header; an error if the file is not whole."""
    with safe_open(path, framework="pt") as file:
        for name in file.keys():  # noqa: SIM118  not a mapping
            file.get_tensor(name)
        found: dict[str, Any] = json.loads(file.metadata()[HEADER])
    return found


def look(folder: Path) -> dict[str, Any]:
    """What a killed training left: epochs, and whether best and history lag behind."""
    if not (folder / LAST).is_file():
        return {"epochs": 0}
    last = record(folder / LAST)
    assert_same(len(last["history"]), last["epochs"], "rows of the history")
    best = record(folder / BEST)["epochs"] if (folder / BEST).is_file() else None
    table = folder / "history.csv"
    rows = len(table.read_text(encoding="utf-8").splitlines()) - 1 if table.is_file() else 0
    return {
        "epochs": last["epochs"],
        "best_lags": best != best_epoch(last["history"], last["score"]),
        "history_lags": rows != last["epochs"],
        "half_files": len([p for p in folder.glob(".*") if p.is_file()]),
    }


def assert_same(one: object, two: object, what: str) -> None:
    """Stop where two things differ."""
    if one != two:
        raise SystemExit(f"{what}: {one} and {two} differ")


def written(path: Path) -> int:
    """When a file was written, nanoseconds; 0 where there is none."""
    return path.stat().st_mtime_ns if path.is_file() else 0


def kill_once(line: list[str], folder: Path, epochs: int, wait: float, watched: str) -> bool:
    """Start a training, let so many more epochs through, and kill it: whether it was running.

    It is killed after so many seconds, or while the checkpoint `watched` is being written.
    """
    process = subprocess.Popen(
        line, start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        for _ in range(epochs):
            before = written(folder / LAST)
            while process.poll() is None and written(folder / LAST) == before:
                time.sleep(0.0005)
        before, started = written(folder / LAST), time.perf_counter()
        stale = set(folder.glob(".*"))
        while process.poll() is None:
            if not watched and time.perf_counter() - started > wait:
                break
            if watched and set(folder.glob(f".{watched}.*")) - stale:
                break
            if watched == BEST and written(folder / LAST) > before:
                break  # the new last checkpoint is there, the best one perhaps not yet
            time.sleep(0.0005)
        running = process.poll() is None
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    return running


def compare(one: Path, two: Path) -> dict[str, bool]:
    """What is the same in two finished trainings."""
    histories = []
    for folder in (one, two):
        rows = record(folder / LAST)["history"]
        histories.append([{k: v for k, v in row.items() if k != "seconds"} for row in rows])
    tensors = {name: (load_file(one / name), load_file(two / name)) for name in (LAST, BEST)}
    same = {
        name: set(a) == set(b) and all(a[key].equal(b[key]) for key in a)
        for name, (a, b) in tensors.items()
    }
    epochs = [record(folder / BEST)["epochs"] for folder in (one, two)]
    pictures = [
        {p.name: p.read_bytes() for p in folder.glob("pictures/*.png")} for folder in (one, two)
    ]
    return {
        "weights_and_optimiser": same[LAST],
        "best_weights": same[BEST],
        "best_epoch": epochs[0] == epochs[1],
        "history": histories[0] == histories[1],
        "pictures": pictures[0] == pictures[1] and len(pictures[0]) > 0,
        "no_half_files": not any(p.is_file() for p in two.glob(".*")),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--epochs", type=int, default=24)
    parser.add_argument("--objects", nargs="+", default=["0000"])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    options = ["--epochs", str(args.epochs), "--objects", *args.objects]
    with tempfile.TemporaryDirectory() as folder:
        straight, killed = Path(folder, "straight"), Path(folder, "killed")
        started = time.perf_counter()
        quiet = {"check": True, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        subprocess.run(command(straight, options, resume=False), **quiet)
        whole = time.perf_counter() - started
        an_epoch = float(np.mean([r["seconds"] for r in record(straight / LAST)["history"]]))
        start = whole - args.epochs * an_epoch
        print(f"uninterrupted: {whole:.0f} s, an epoch {an_epoch:.1f} s", flush=True)
        line, kills, done = command(killed, options, resume=True), [], 0
        for number in range(args.kills):
            most = max((args.epochs - 2 - done) // (args.kills - number), 0)
            epochs = int(rng.integers(0, max(most, 1)))
            wait = float(rng.uniform(0, an_epoch if epochs else start + an_epoch))
            watched = ("", LAST, "", BEST)[number % 4]
            running = kill_once(line, killed, epochs, wait, watched)
            found = look(killed) if killed.is_dir() else {"epochs": 0}
            done = found["epochs"]
            kills.append({"running": running, "while_saving": watched or False, **found})
            print(f"kill {number + 1}: {kills[-1]}", flush=True)
        subprocess.run(line, **quiet)
        same = compare(straight, killed)
    print(same)
    if args.json:
        content = {
            "question": "does a training that is killed at random moments end as one that is not?",
            "command": "hadr train --preset tiny " + " ".join(options),
            "threads": os.environ.get("OMP_NUM_THREADS", "default"),
            "kills": kills,
            "same": same,
            "provenance": provenance(),
        }
        write_sealed(args.json, content)
    raise SystemExit(0 if all(same.values()) else 1)


if __name__ == "__main__":
    main()
