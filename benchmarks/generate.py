"""Measure the generator: seconds a frame by engine and size, two workers against one, the cost.

    OMP_NUM_THREADS=1 python benchmarks/generate.py --json results/generation/benchmark.json

Takes about seven minutes on two quiet cores. Frames carry everything: hold, scene, labels,
colour, raw depth, files. A first frame of each kind, in which programs are compiled, is made
before the clock starts. What many workers do is read off the times at which frames were finished.
"""

import argparse
import json
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from hadr.provenance import provenance
from hadr.synthesis.generate import generate_frames
from hadr.synthesis.generation_presets import PRESETS, GenerationSettings

PAPER_FRAMES = 14100
SIZES = {(256, 144): 12, (448, 252): 8, (1280, 720): 3}


def settings(engine: str, width: int, height: int, seed: int) -> GenerationSettings:
    base = PRESETS["paper"].settings
    return replace(base, engine=engine, width=width, height=height, seed=seed, variant=None)


def seconds_a_frame(engine: str, size: tuple[int, int], frames: int, seed: int) -> dict:
    """Frames made one after the other in this process."""
    with tempfile.TemporaryDirectory() as folder:
        generate_frames(Path(folder, "warm"), 1, settings(engine, *size, seed + 1))
        cpu = time.process_time()
        report = generate_frames(Path(folder, "set"), frames, settings(engine, *size, seed))
        cpu = time.process_time() - cpu
        files = [p for p in Path(folder, "set").rglob("*") if p.is_file()]
        return {
            "engine": engine,
            "width": size[0],
            "height": size[1],
            "frames": frames,
            "seconds_a_frame": report.seconds / frames,
            "cpu_seconds_a_frame": cpu / frames,
            "kilobytes_a_frame": sum(p.stat().st_size for p in files) / frames / 1000,
        }


def finish_times(root: Path) -> np.ndarray:
    """When each frame was finished, seconds, in order: its log is written last."""
    logs = root.glob("*/*/depth/log_json/*.json")
    return np.sort([p.stat().st_mtime_ns / 1e9 for p in logs])


def rate(workers: int, frames: int, seed: int) -> dict:
    """Frames a second of so many workers, from start to end and once all are at work."""
    chosen = replace(settings("photo", 256, 144, seed), frames_per_hold=1)
    with tempfile.TemporaryDirectory() as folder:
        report = generate_frames(folder, frames, chosen, workers=workers)
        times = finish_times(Path(folder))
    # Two frames of each worker to warm up, and none at the end, where a worker may be idle.
    window = times[2 * workers - 1 : len(times) - workers + 1]
    return {
        "workers": workers,
        "frames": frames,
        "seconds": report.seconds,
        "frames_a_second": frames / report.seconds,
        "frames_a_second_at_work": (len(window) - 1) / (window[-1] - window[0]),
    }


def cost(seconds: float, efficiency: float) -> list[dict]:
    """Hours for the paper's number of frames, if many cores work as well as two."""
    rows = []
    for cores in (1, 16, 256):
        share = 1.0 if cores == 1 else efficiency
        hours = PAPER_FRAMES * seconds / 3600 / cores / share
        rows.append({"cores": cores, "hours": hours, "core_hours": hours * cores})
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path)
    parser.add_argument("--frames", type=int, default=60, help="frames a worker count (60)")
    parser.add_argument("--seed", type=int, default=900)
    args = parser.parse_args()
    start, table = time.perf_counter(), []
    for engine in ("photo", "raycast"):
        for size, frames in SIZES.items():
            table.append(seconds_a_frame(engine, size, frames, args.seed))
            print(
                f"{engine:8s} {size[0]:5d}x{size[1]:<4d} {table[-1]['seconds_a_frame']:7.2f} s "
                f"{table[-1]['kilobytes_a_frame']:7.0f} kB",
                flush=True,
            )
    rates = [rate(workers, args.frames, args.seed) for workers in (1, 2)]
    whole, work = (
        rates[1][key] / rates[0][key] / 2 for key in ("frames_a_second", "frames_a_second_at_work")
    )
    print(f"efficiency of 2 workers: {work:.3f} at work, {whole:.3f} with starting them")
    large = next(r for r in table if r["engine"] == "photo" and r["width"] == 1280)
    costs = cost(large["seconds_a_frame"], min(work, 1.0))
    for line in costs:
        print(f"{PAPER_FRAMES} frames on {line['cores']} cores: {line['hours']:.1f} h")
    report = {
        "question": "what does a frame cost, and what do 14,100 of 1280x720 cost?",
        "seconds_a_frame": table,
        "workers": rates,
        "efficiency_of_2_workers": {"at_work": work, "with_start": whole, "goal": 0.85},
        "paper_frames": {
            "frames": PAPER_FRAMES,
            "size": [1280, 720],
            "cost": costs,
            "megabytes": large["kilobytes_a_frame"] * PAPER_FRAMES / 1000,
            "assumption": "16 and 256 cores work as well as the 2 that were measured; frames of "
            "different holds share nothing but the disk",
        },
        "seconds": time.perf_counter() - start,
        "provenance": provenance(),
    }
    if args.json:
        args.json.parent.mkdir(parents=True, exist_ok=True)
        args.json.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
