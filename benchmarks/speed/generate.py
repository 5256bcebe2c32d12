"""Measure the generator: seconds a frame by engine, size and part, two workers, the cost.

    OMP_NUM_THREADS=1 python benchmarks/speed/generate.py --json results/generation/benchmark.json

Takes about seven minutes on two quiet cores. Frames carry everything: hold, scene, labels,
colour, raw depth, files; what each part takes is measured in the same run, as seconds of one core.
A first frame of each kind, in which programs are compiled, is made before the clock starts; each
kind has a seed of its own, because a hold that was made once is remembered. What many workers do is
read off the times at which frames were finished.
"""

import argparse
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np

from hadr.records.provenance import provenance
from hadr.records.result_file import write_sealed
from hadr.synthesis.generation import frames as frame_rendering
from hadr.synthesis.generation import generate as generating
from hadr.synthesis.generation.generate import generate
from hadr.synthesis.generation.settings import PRESETS, GenerationSettings
from hadr.synthesis.rendering.shading import RayTracer

PAPER_FRAMES = 14100
SIZES = {(256, 144): 12, (448, 252): 8, (1280, 720): 3}
#: The functions that make each part of a frame.
PARTS = {
    "hold": ((frame_rendering, "recipe_hold"),),
    "scene": ((frame_rendering, "make_scene"),),
    "labels": ((RayTracer, "labels"),),
    "picture": ((frame_rendering, "photograph"), (RayTracer, "picture")),
    "sensor": ((frame_rendering, "capture_depth"),),
    "files": ((generating, "write_frame"),),
}


def settings(engine: str, width: int, height: int, seed: int) -> GenerationSettings:
    base = PRESETS["paper"].settings
    return replace(base, engine=engine, width=width, height=height, seed=seed, variant=None)


@contextmanager
def timed_parts() -> Iterator[dict[str, float]]:
    """Add up the CPU seconds of each part of the frames that are made meanwhile.

    A part that calls another one, as the sensor may cast rays, does not count twice.
    """
    spent, running = dict.fromkeys(PARTS, 0.0), [""]

    def timed(part: str, function):
        def run(*args, **kwargs):
            if running[0]:
                return function(*args, **kwargs)
            running[0], start = part, time.process_time()
            try:
                return function(*args, **kwargs)
            finally:
                spent[part] += time.process_time() - start
                running[0] = ""

        return run

    with ExitStack() as stack:
        for part, places in PARTS.items():
            for owner, name in places:
                stack.enter_context(patch.object(owner, name, timed(part, getattr(owner, name))))
        yield spent


def seconds_a_frame(engine: str, size: tuple[int, int], frames: int, seed: int) -> dict:
    """Frames made one after the other in this process."""
    with tempfile.TemporaryDirectory() as folder:
        generate(Path(folder, "warm"), 1, settings(engine, *size, seed + 1))
        cpu = time.process_time()
        with timed_parts() as parts:
            report = generate(Path(folder, "set"), frames, settings(engine, *size, seed))
        cpu = time.process_time() - cpu
        files = [p for p in Path(folder, "set").rglob("*") if p.is_file()]
        return {
            "engine": engine,
            "width": size[0],
            "height": size[1],
            "frames": frames,
            "seconds_a_frame": report.seconds / frames,
            "cpu_seconds_a_frame": cpu / frames,
            "cpu_seconds_by_part": {name: spent / frames for name, spent in parts.items()},
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
        report = generate(folder, frames, chosen, workers=workers)
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
            table.append(seconds_a_frame(engine, size, frames, args.seed + 10 * len(table)))
            print(
                f"{engine:8s} {size[0]:5d}x{size[1]:<4d} {table[-1]['seconds_a_frame']:7.2f} s "
                f"{table[-1]['kilobytes_a_frame']:7.0f} kB   "
                + ", ".join(f"{k} {v:.2f}" for k, v in table[-1]["cpu_seconds_by_part"].items()),
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
        write_sealed(args.json, report)


if __name__ == "__main__":
    main()
