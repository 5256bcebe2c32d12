"""Time and memory of restoring one 224x224 frame at batch 1, in full and by part.

    python benchmarks/restoration.py [--json results/speed/restoration.json] [--threads 2]

Presets `mini` and `paper` with random weights (the time does not depend on them) on sample frames,
against a plain Swin-T in the same run: as the network is, with half the rays, and with the backbone
run by ONNX Runtime (where it is installed), exact and in 8-bit products. What the approximations
cost is measured on the validation samples with the committed checkpoint.
"""

from __future__ import annotations

import argparse
import functools
import importlib.util
import json
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import patch

import torch
from measuring import (
    in_a_process,
    in_turns,
    interleaved,
    peak_rss_bytes,
    peak_tensor_bytes,
    sample_frames,
)
from torch import nn

import hadr.models.hadr as steps
from hadr.data.samples import samples_dir
from hadr.metrics import mean_over_frames
from hadr.models.backbone import BackboneConfig, build_swin
from hadr.models.exported import export_backbone, with_exported_backbone
from hadr.models.hadr import HADR
from hadr.models.sparse_rays import SparseRays
from hadr.records.provenance import machine_text, provenance
from hadr.records.result_file import write_sealed
from hadr.training.checkpoints import load_checkpoint
from hadr.training.evaluation import score
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


def variants(name: str, folder: Path, threads: int, onnx: bool) -> dict[str, nn.Module]:
    """The preset's network in its forms."""
    network = build(name)
    forms: dict[str, nn.Module] = {"all rays": network, "half the rays": SparseRays(network)}
    if onnx:
        for title, integers in (("ONNX", False), ("ONNX, 8 bit", True)):
            path = export_backbone(
                network, SIZE, folder / f"{name}{integers}.onnx", integers=integers
            )
            fast = with_exported_backbone(network, path, threads)
            forms[title] = SparseRays(fast)
    return forms


def accuracy(folder: Path, every: int, onnx: bool) -> dict[str, Any]:
    """Error on validation samples with the committed checkpoint, by form."""
    network, _ = load_checkpoint(samples_dir() / "checkpoints" / "hadr-mini.safetensors")
    frames = sample_frames(every=every)
    forms: dict[str, nn.Module] = {"all rays": network.eval(), "half the rays": SparseRays(network)}
    if onnx:
        for title, integers in (("ONNX", False), ("ONNX, 8 bit", True)):
            path = export_backbone(network, SIZE, folder / f"c{integers}.onnx", integers=integers)
            forms[title] = SparseRays(with_exported_backbone(network, path))
    rows = {}
    for title, form in forms.items():
        depth = []
        for number in range(len(frames)):
            inputs = frames.take([number]).inputs
            depth.append(torch.where(inputs.mask, form(inputs).depth, inputs.depth))
        rows[title] = mean_over_frames(score(torch.cat(depth).numpy(), frames)).rmse_m
    exact = rows["all rays"]
    return {
        "frames": len(frames),
        "size": list(SIZE),
        "rmse_m": rows,
        "change_percent": {title: 100 * (rmse / exact - 1) for title, rmse in rows.items()},
    }


def memory(name: str, form: str) -> dict[str, Any]:
    """Resident and tensor memory of restoring one frame, in this process."""
    before = peak_rss_bytes()
    network: nn.Module
    if name == "swin":
        network = build_swin(BackboneConfig()).eval()
        color = sample_frames().take([0]).inputs.color
        call: Callable[[], Any] = functools.partial(network, color)
    else:
        network = build(name)
        call = in_turns(network if form == "all rays" else SparseRays(network))
    call()
    weights = sum(p.numel() * p.element_size() for p in network.parameters())
    return {
        "rss_bytes": peak_rss_bytes() - before,
        "tensor_bytes": peak_tensor_bytes(call),
        "weight_bytes": weights,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--turns", type=int, default=40)
    parser.add_argument("--seconds", type=float, default=40.0, help="for all timings together")
    parser.add_argument("--accuracy-every", type=int, default=2, help="every n-th validation frame")
    parser.add_argument("--no-onnx", action="store_true")
    parser.add_argument("--measure", help=argparse.SUPPRESS)
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    with torch.inference_mode():
        if args.measure:
            print(json.dumps(memory(*args.measure.split(","))))
            return
        content = run(args)
    if args.json:
        write_sealed(args.json, content)


def run(args: argparse.Namespace) -> dict[str, Any]:
    onnx = not args.no_onnx and importlib.util.find_spec("onnxruntime") is not None
    swin = build_swin(BackboneConfig()).eval()
    color = sample_frames().take([0]).inputs.color
    calls: dict[str, Callable[[], Any]] = {"Swin-T": lambda: swin(color)}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        parts = {}
        for recipe in PRESETS:
            forms = variants(recipe, folder, args.threads, onnx)
            calls.update({f"{recipe}, {title}": in_turns(form) for title, form in forms.items()})
            parts[recipe] = by_part(forms["all rays"], 16)  # type: ignore[arg-type]
        times = interleaved(calls, args.turns, args.seconds)
        cost = accuracy(folder, args.accuracy_every, onnx)
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
    print(parts, cost["change_percent"], sep="\n", flush=True)
    needed = {"Swin-T": in_a_process(__file__, "--measure", "swin,")}
    for recipe in PRESETS:
        for form in ("all rays", "half the rays"):
            title = f"{recipe}, {form}"
            needed[title] = in_a_process(__file__, "--measure", f"{recipe},{form}")
    return {
        "what": "Restoring one 224x224 frame at batch 1: sample frames in turns, random weights; "
        "ratios against a plain Swin-T forward in the same run. Approximations: RMSE on the "
        "validation samples with the committed checkpoint",
        "machine": machine_text(),
        "threads": args.threads,
        "rays_mean": float(sample_frames().inputs.mask.flatten(1).sum(dim=1).float().mean()),
        "times": times,
        "against_swin": against,
        "parts_cpu_ms": parts,
        "accuracy": cost,
        "memory": needed,
        "provenance": provenance(),
    }


if __name__ == "__main__":
    main()
