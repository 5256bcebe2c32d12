"""Kill the generator at random moments, start it again, and compare with an uninterrupted run.

    python benchmarks/kill_generator.py --kills 10 --workers 2 --json results/generation/killed.json

After each kill every frame that has a log must be whole, byte for byte; at the end the whole tree
must have the hash of the uninterrupted run's.
"""

import argparse
import hashlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from hadr.records.provenance import provenance
from hadr.records.result_file import write_sealed


def tree(root: Path) -> dict[str, str]:
    """SHA-256 of each file below a folder."""
    files = (p for p in root.rglob("*") if p.is_file())
    return {
        p.relative_to(root).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest() for p in files
    }


def tree_hash(root: Path) -> str:
    """One hash of all names and contents."""
    return hashlib.sha256(json.dumps(sorted(tree(root).items())).encode()).hexdigest()


def stems(files: dict[str, str], ending: str = "") -> set[str]:
    """The frames of which there are files (with this ending)."""
    return {Path(f).stem for f in files if f.count("/") > 2 and f.endswith(ending)}


def logs(root: Path) -> int:
    """How many frames have a log."""
    splits = (root / name for name in ("train", "val", "test"))
    return sum(len(list(split.glob("*/depth/log_json/*.json"))) for split in splits)


def command(root: Path, frames: int, workers: int, options: list[str]) -> list[str]:
    line = ["-m", "hadr.cli", "generate", "--preset", "tiny", "--out", str(root)]
    line += ["--frames", str(frames), "--workers", str(workers), *options]
    return [sys.executable, *line]


def kill_once(line: list[str], root: Path, after: int, jitter: float) -> bool:
    """Start the generator, and kill it and its workers a moment after so many frames."""
    process = subprocess.Popen(
        line, start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        while process.poll() is None and logs(root) < after:
            time.sleep(0.002)
        time.sleep(jitter)
        running = process.poll() is None
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    return running


def check_frames(root: Path, whole: dict[str, str]) -> tuple[int, int]:
    """Frames with a log, and half ones without; a frame with a log must be as it should."""
    found = tree(root)
    done = stems(found, ".json")
    for name, digest in whole.items():
        if Path(name).stem in done and name.count("/") > 2 and found.get(name) != digest:
            raise SystemExit(f"frame {Path(name).stem} has a log, but {name} is not as it should")
    visible = {f: d for f, d in found.items() if not f.startswith(".")}
    return len(done), len(stems(visible) - done)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--frames", type=int, default=32)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path)
    parser.add_argument("options", nargs="*", help="more options of hadr generate, after --")
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    with tempfile.TemporaryDirectory() as folder:
        straight, killed = Path(folder, "straight"), Path(folder, "killed")
        start = time.perf_counter()
        subprocess.run(
            command(straight, args.frames, args.workers, args.options),
            check=True,
            stderr=subprocess.DEVNULL,
        )
        a_frame = (time.perf_counter() - start) / args.frames
        whole, kills, done = tree(straight), [], 0
        line = command(killed, args.frames, args.workers, args.options)
        for number in range(args.kills):
            most = max((args.frames - 2 - done) // (args.kills - number), 0)
            after = done + int(rng.integers(0, most + 1))
            running = kill_once(line, killed, after, float(rng.uniform(0, 2 * a_frame)))
            done, half = check_frames(killed, whole)
            kills.append({"running": running, "whole_frames": done, "half_frames": half})
            print(f"kill {number + 1}: {done} whole frames, {half} half ones", flush=True)
        subprocess.run(line, check=True, stderr=subprocess.DEVNULL)
        same = tree_hash(straight) == tree_hash(killed)
        report = {
            "question": "is the tree the same after kills at random moments?",
            "frames": args.frames,
            "workers": args.workers,
            "kills": kills,
            "frames_at_the_end": check_frames(killed, whole)[0],
            "hash_uninterrupted": tree_hash(straight),
            "hash_killed": tree_hash(killed),
            "same": same,
            "provenance": provenance(),
        }
    print("the trees are the same" if same else "the trees differ")
    if args.json:
        write_sealed(args.json, report)
    raise SystemExit(0 if same else 1)


if __name__ == "__main__":
    main()
