"""How the benchmarks here measure: interleaved repetitions, CPU time, peak memory.

Several functions are timed in turns, so that whatever else the machine does falls on all of them
alike; what counts is the ratio of two numbers of one run. Two times are taken: the wall's, and the
processor's (`time.process_time`, all threads together), which another program disturbs less.
"""

from __future__ import annotations

import argparse
import functools
import itertools
import json
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from statistics import median
from typing import Any

import torch
from torch import nn
from torch.profiler import ProfilerActivity, profile

from hadr.data.samples import open_samples
from hadr.training.frames.batches import FrameTensors, load_frames


def arguments(
    description: str | None, *, turns: int, seconds: float | None = None, threads: int = 2
) -> argparse.ArgumentParser:
    """Give a parser of what benchmarks of time take; one may add its own."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--threads", type=int, default=threads)
    parser.add_argument("--turns", type=int, default=turns)
    if seconds is not None:
        parser.add_argument(
            "--seconds", type=float, default=seconds, help="for all timings together"
        )
    return parser


def turning(work: Callable[[int], Any], count: int) -> Callable[[], Any]:
    """A call that works on the next of so many things."""
    numbers = itertools.cycle(range(count))
    return lambda: work(next(numbers))


@functools.cache
def sample_frames(size: tuple[int, int] = (224, 224), every: int = 12) -> FrameTensors:
    """Validation frames, of small and large glasses; eight of them with 12."""
    chosen = [frame for number, frame in enumerate(open_samples("val")) if number % every == 0]
    with torch.inference_mode(False):  # the frames are read by threads that know nothing of it
        return load_frames(chosen, size, keep_all=True)


def in_turns(network: nn.Module, size: tuple[int, int] = (224, 224)) -> Callable[[], Any]:
    """A call that restores the next of the sample frames."""
    frames = sample_frames(size)
    inputs = [frames.take([number]).inputs for number in range(len(frames))]
    return turning(lambda number: network(inputs[number]), len(frames))


def interleaved(
    functions: Mapping[str, Callable[[], Any]], repetitions: int, seconds: float = 60.0
) -> dict[str, dict[str, float]]:
    """Time functions in turns, after one warm-up each.

    Args:
        functions: By name.
        repetitions: Most turns.
        seconds: No turn begins after this time, but there are at least five.

    Returns:
        Per function minimum and median of both times, in milliseconds, and the number of turns.
    """
    for function in functions.values():
        function()
    wall: dict[str, list[float]] = {name: [] for name in functions}
    cpu: dict[str, list[float]] = {name: [] for name in functions}
    began = time.perf_counter()
    turns = 0
    while turns < repetitions and (turns < 5 or time.perf_counter() - began < seconds):
        for name, function in functions.items():
            start, used = time.perf_counter(), time.process_time()
            function()
            cpu[name].append(1e3 * (time.process_time() - used))
            wall[name].append(1e3 * (time.perf_counter() - start))
        turns += 1
    return {
        name: {
            "wall_min_ms": min(wall[name]),
            "wall_median_ms": median(wall[name]),
            "cpu_min_ms": min(cpu[name]),
            "cpu_median_ms": median(cpu[name]),
            "turns": turns,
        }
        for name in functions
    }


def peak_tensor_bytes(function: Callable[[], Any]) -> int:
    """Most bytes that torch's tensors held at once during a call, beyond those before it."""
    with profile(activities=[ProfilerActivity.CPU], profile_memory=True) as record:
        function()
    # Each allocation (+) and release (-) of the CPU, which `record.events()` only holds summed up.
    events = [e for e in record.profiler.kineto_results.events() if e.name() == "[memory]"]
    held = peak = 0
    for event in sorted(events, key=lambda e: e.start_ns()):
        held += event.nbytes()
        peak = max(peak, held)
    return peak


def in_a_process(script: str | Path, *arguments: str) -> dict[str, Any]:
    """Run a script in a process of its own and read the JSON of its last line."""
    answer = subprocess.run(
        [sys.executable, "-W", "ignore", str(script), *arguments],
        capture_output=True,
        text=True,
        check=False,
    )
    if answer.returncode:
        raise RuntimeError(f"{script} {' '.join(arguments)} failed:\n{answer.stderr[-2000:]}")
    content: dict[str, Any] = json.loads(answer.stdout.strip().splitlines()[-1])
    return content
