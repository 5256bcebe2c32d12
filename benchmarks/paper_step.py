"""Time and memory of one training step of preset `paper`: batch 40 at 224x224.

    python benchmarks/paper_step.py --json results/training/paper_step.json

Each batch size runs in a process of its own, whose largest resident set is the step's memory. The
process may take what the machine has free, but for a reserve for others; where the paper's batch
does not fit into that, the next smaller follows. The frames are bundled ones, spread evenly.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

import torch
from measuring import peak_rss_bytes

from hadr.data.samples import open_samples
from hadr.records.provenance import machine_text, provenance
from hadr.records.result_file import write_sealed
from hadr.training.frames.batches import load_frames
from hadr.training.loop import chance
from hadr.training.presets import preset
from hadr.training.tasks.task import Task


def free_mib() -> int:
    """Memory that the machine has available, MiB."""
    lines = Path("/proc/meminfo").read_text(encoding="utf-8").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("MemAvailable")) // 1024


def keep_reserve(reserve_mib: int) -> None:
    """Let this process allocate what is free but for a reserve; more is an error, not a kill."""
    most = max(free_mib() - reserve_mib, 1024) * 2**20
    resource.setrlimit(resource.RLIMIT_DATA, (most, most))


def measure(batch_size: int, steps: int) -> dict[str, object]:
    """Make some steps and tell their time and memory."""
    recipe = preset("paper")
    source = open_samples("train")
    chosen = [source[n] for n in range(0, len(source), len(source) // min(batch_size, 40))]
    frames = load_frames(chosen[:batch_size], recipe.size)
    task = Task(recipe)
    torch.manual_seed(0)
    model = task.build().train()
    optimizer = torch.optim.Adam(model.parameters(), lr=recipe.learning_rate)
    before, seconds, cpu = peak_rss_bytes() / 2**20, [], []
    for step in range(steps):
        started, used = time.perf_counter(), time.process_time()
        batch = frames.take([n % len(frames) for n in range(batch_size)])
        losses = task.losses(model, batch, recipe.true_voxel_epochs, chance(0, 0, step))
        optimizer.zero_grad()
        losses["loss"].backward()
        optimizer.step()
        seconds.append(time.perf_counter() - started)
        cpu.append(time.process_time() - used)
    return {
        "batch_size": batch_size,
        "threads": torch.get_num_threads(),
        "parameters": sum(weight.numel() for weight in model.parameters()),
        "rays": int(batch.inputs.mask.sum()),
        "seconds": seconds,
        "cpu_seconds": cpu,
        "load_average": os.getloadavg()[0],
        "peak_mib": peak_rss_bytes() / 2**20,
        "peak_before_the_step_mib": before,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--batch-sizes", type=int, nargs="+", default=[40, 32, 24, 16, 8, 4])
    parser.add_argument("--steps", type=int, default=2)
    parser.add_argument("--one", type=int, help="measure this batch size in this process")
    parser.add_argument("--reserve-mib", type=int, default=2048, help="left for others (2048)")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    if args.one:
        keep_reserve(args.reserve_mib)
        print(json.dumps(measure(args.one, args.steps)))
        return
    tried = []
    for batch_size in args.batch_sizes:
        command = [sys.executable, __file__, "--one", str(batch_size), "--steps", str(args.steps)]
        command += ["--reserve-mib", str(args.reserve_mib)]
        free = free_mib()
        answer = subprocess.run(command, capture_output=True, text=True, check=False)
        if answer.returncode == 0:
            tried.append(
                {"fits": True, "free_mib": free, **json.loads(answer.stdout.splitlines()[-1])}
            )
            print(tried[-1], flush=True)
            break
        said = answer.stderr.strip().splitlines()
        reason = said[-1] if said else f"ended with status {answer.returncode}"
        tried.append(
            {"fits": False, "free_mib": free, "batch_size": batch_size, "reason": reason[:200]}
        )
        print(tried[-1], flush=True)
    if args.json:
        content = {
            "question": "what does one step of preset paper cost on this machine?",
            "size": list(preset("paper").size),
            "machine": machine_text(),
            "reserve_mib": args.reserve_mib,
            "tried": tried,
            "provenance": provenance(),
        }
        write_sealed(args.json, content)


if __name__ == "__main__":
    main()
