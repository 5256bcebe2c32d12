"""Time of restoring one 224x224 frame at batch 1, in full and by part.

    python benchmarks/speed/restoration.py [--json results/speed/restoration.json] [--threads 2]

Presets `mini` and `paper` with random weights (the time does not depend on them) on sample frames,
against a plain Swin-T in the same run.
"""

from __future__ import annotations

import argparse
import functools
import time
from collections.abc import Callable
from typing import Any
from unittest.mock import patch

import torch
from measuring import arguments, in_turns, interleaved, sample_frames

import hadr.models.hadr as steps
from hadr.models.backbone import BackboneConfig, build_swin
from hadr.models.hadr import HADR
from hadr.records.provenance import provenance
from hadr.records.result_file import write_sealed
from hadr.training.presets import preset

SIZE = (224, 224)
PRESETS = ("mini", "paper")
PARTS = {
    "backbone": ("backbone.swin",),
    "fusion": ("backbone.aggregation",),
    "points and voxels": ("select_points", "ray_points", "occupied_voxels"),
    "pairing": ("masked_rays", "ray_voxel_pairs"),
    "voxel features": ("features_at", "voxel_features", "_hand_feature"),
    "ray features": ("ray_features", "encode_position"),
    "decoders": ("probability_decoder", "offset_decoder", "segment_softmax", "segment_argmax"),
}
"""Which functions and modules of `HADR.forward` belong to which part."""


def build(name: str) -> HADR:
    """The preset's network, random weights."""
    torch.manual_seed(0)
    config = preset(name).model
    return HADR(config).eval()  # type: ignore[arg-type]


def by_part(network: HADR, turns: int) -> dict[str, float]:
    """Processor time of each part in ms, the median over turns; "rest" is what is left."""
    spent: dict[str, float] = {}
    depth = 0

    def timed(part: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **kwargs: Any) -> Any:
            nonlocal depth
            depth += 1
            start = time.process_time()
            try:
                return function(*args, **kwargs)
            finally:
                depth -= 1
                if depth == 0:  # a part within a part counts to the outer one
                    spent[part] = spent.get(part, 0) + time.process_time() - start

        return call

    rows = []
    call = in_turns(network)
    with Clocks(network, timed):
        for _ in range(turns + 1):
            spent.clear()
            start = time.process_time()
            call()
            total = time.process_time() - start
            rows.append({**spent, "rest": total - sum(spent.values()), "all": total})
    return {
        part: 1e3 * float(torch.tensor([r[part] for r in rows[1:]]).median()) for part in rows[1]
    }


class Clocks:
    """Puts clocks around the steps of the network, and takes them away again."""

    def __init__(self, network: HADR, timed: Callable[..., Any]) -> None:
        self.patches = []
        for part, names in PARTS.items():
            for name in names:
                if hasattr(steps, name) and not isinstance(getattr(steps, name), type):
                    self.patches.append(
                        patch.object(steps, name, timed(part, getattr(steps, name)))
                    )
                    continue
                owner: Any = functools.reduce(getattr, name.split(".")[:-1], network)
                target = getattr(owner, name.split(".")[-1])
                methods = {"probability_decoder": ["begin", "finish"]}
                if name.startswith("_"):
                    self.patches.append(patch.object(owner, name, timed(part, target)))
                    continue
                for method in methods.get(name, ["forward"]):
                    clocked = timed(part, getattr(target, method))
                    self.patches.append(patch.object(target, method, clocked))

    def __enter__(self) -> None:
        for one in self.patches:
            one.start()

    def __exit__(self, *_: object) -> None:
        for one in self.patches:
            one.stop()


def main() -> None:
    args = arguments(__doc__, turns=40, seconds=40.0).parse_args()
    torch.set_num_threads(args.threads)
    with torch.inference_mode():
        content = run(args)
    if args.json:
        write_sealed(args.json, content)


def run(args: argparse.Namespace) -> dict[str, Any]:
    swin = build_swin(BackboneConfig()).eval()
    color = sample_frames().take([0]).inputs.color
    calls: dict[str, Callable[[], Any]] = {"Swin-T": lambda: swin(color)}
    parts = {}
    for recipe in PRESETS:
        network = build(recipe)
        calls[f"{recipe}, all rays"] = in_turns(network)
        parts[recipe] = by_part(network, 16)
    times = interleaved(calls, args.turns, args.seconds)
    against = {
        key: {title: row[key] / times["Swin-T"][key] for title, row in times.items()}
        for key in ("wall_min_ms", "wall_median_ms", "cpu_min_ms", "cpu_median_ms")
    }
    for title, row in times.items():
        print(
            f"{title:24s} wall {row['wall_min_ms']:6.1f} (median {row['wall_median_ms']:6.1f}) "
            f"cpu {row['cpu_min_ms']:6.1f} (median {row['cpu_median_ms']:6.1f}) ms, "
            f"{against['cpu_median_ms'][title]:.2f} of Swin-T's processor time"
        )
    print(parts, flush=True)
    return {
        "what": "Restoring one 224x224 frame at batch 1: sample frames in turns, random weights; "
        "ratios against a plain Swin-T forward in the same run",
        "threads": args.threads,
        "rays_mean": float(sample_frames().inputs.mask.flatten(1).sum(dim=1).float().mean()),
        "times": times,
        "against_swin": against,
        "parts_cpu_ms": parts,
        "provenance": provenance(),
    }


if __name__ == "__main__":
    main()
