"""Time, memory and weights of all methods that restore depth, one frame at a time, side by side.

    python benchmarks/speed/side_by_side.py [--json results/speed/side_by_side.json] [--threads 2]

Each network with its recipes `paper`, `mini` and `imagenet`, at the recipe's own input size, random
weights (the time does not depend on them), on validation samples in turns; the methods that learn
nothing at 224x224. Memory is that of a process of its own, beyond what it held before the network
was built; Linux tells it, elsewhere it is left out.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from measuring import (
    arguments,
    in_a_process,
    in_turns,
    interleaved,
    peak_tensor_bytes,
    sample_frames,
    turning,
)
from torch import nn

from hadr.models.networks import DEPTH_NETWORKS
from hadr.records.provenance import provenance
from hadr.records.result_file import write_result_file
from hadr.training.evaluation import CLASSICAL
from hadr.training.presets import preset
from hadr.training.tasks.task import Task

SIZES = ("paper", "mini", "imagenet")


def build(network: str, size: str) -> nn.Module:
    """The preset's network as it restores, random weights; LIDF with its refinement."""
    torch.manual_seed(0)
    model = Task(preset(size, network)).build().eval()
    if network == "lidf":
        model.set_stage(2)
    return model


def cheap_in_turns(method: str) -> Callable[[], Any]:
    """A call that restores the next of the frames without a network."""
    frames = sample_frames((224, 224))
    return turning(lambda number: CLASSICAL[method](frames, number), len(frames))


def resident_peak(*, restart: bool = False) -> int | None:
    """Most memory that this process has held, from now on with `restart`; None if nobody knows."""
    try:
        if restart:
            Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith("VmHWM")), None)


def memory(network: str, size: str) -> dict[str, Any]:
    """Resident and tensor memory of restoring one frame, in this process."""
    frames = sample_frames(preset(size, network).size)
    before = resident_peak(restart=True)
    model = build(network, size)
    call = in_turns(model, preset(size, network).size)
    for _ in range(len(frames)):
        call()
    after = resident_peak()
    return {
        "parameters": sum(p.numel() for p in model.parameters()),
        "peak_rss_bytes": None if before is None or after is None else after - before,
        "peak_tensor_bytes": max(peak_tensor_bytes(call) for _ in range(len(frames))),
    }


def main() -> None:
    """Run the benchmark."""
    parser = arguments(__doc__, turns=24, seconds=240.0)
    parser.add_argument("--measure", nargs=2, help=argparse.SUPPRESS)
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    with torch.inference_mode():
        if args.measure:
            print(json.dumps(memory(*args.measure)))
            return
        pairs = [(network, size) for size in SIZES for network in DEPTH_NETWORKS]
        calls = {
            f"{network}, {size}": in_turns(build(network, size), preset(size, network).size)
            for network, size in pairs
        }
        calls |= {method: cheap_in_turns(method) for method in CLASSICAL}
        times = interleaved(calls, args.turns, args.seconds)
    rows = []
    for network, size in pairs:
        recipe = preset(size, network)
        needed = in_a_process(__file__, "--threads", str(args.threads), "--measure", network, size)
        rows.append({
            "method": network,
            "preset": size,
            "input": list(recipe.size),
            **times[f"{network}, {size}"],
            **needed,
        })  # fmt: skip
    rows += [
        {"method": method, "preset": None, "input": [224, 224], "parameters": 0, **times[method]}
        for method in CLASSICAL
    ]
    for row in rows:
        print(
            f"{row['method']:12s} {row['preset'] or '-':8s} {row['wall_median_ms']:8.1f} ms, "
            f"{row['parameters'] / 1e6:7.2f} M, "
            f"{(row.get('peak_rss_bytes') or 0) / 2**20:7.0f} MiB"
        )
    if args.json:
        write_result_file(
            args.json,
            "Restoring one frame at batch 1, networks alone, all in turns in one run: the median "
            "over the turns; memory of the network and one frame in a process of its own",
            rows,
            {**provenance(), "threads": args.threads},
        )


if __name__ == "__main__":
    main()
