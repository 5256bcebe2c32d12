"""Frames a second of the whole perception: mask, hand keypoints, restored depth.

    python benchmarks/perception.py [--json results/speed/perception.json] [--threads 2]

The three networks of preset `mini` with random weights (time does not depend on them), the
restoration at 224x224, on sample frames at batch 1. Random masks would be no masks, so each network
does its work on the true ones: segmentation runs, and the true masks go on to the other two. As the
networks are, with half the rays, and run by ONNX Runtime (where it is installed).
"""

from __future__ import annotations

import argparse
import importlib.util
import itertools
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from measuring import interleaved
from torch import Tensor, nn

from hadr.data.samples import open_samples
from hadr.models.exported import (
    ExportedNetwork,
    export_backbone,
    export_network,
    with_exported_backbone,
)
from hadr.models.hadr import HADR
from hadr.models.hand.keypoints import HandKeypointNet, predict_keypoints
from hadr.models.hand.weighted_regression import JointMaps
from hadr.models.segmentation import SegmentationNet
from hadr.models.sparse_rays import SparseRays
from hadr.records.provenance import machine_text, provenance
from hadr.records.result_file import write_sealed
from hadr.training.batches import FrameTensors, load_frames
from hadr.training.presets import preset

SIZE = (224, 224)


class _Maps(nn.Module):
    """The keypoint network with its maps as one tensor."""

    def __init__(self, network: HandKeypointNet) -> None:
        super().__init__()
        self.network = network

    def forward(self, crop: Tensor) -> Tensor:
        return self.network.head(self.network.unet(crop))


class _ExportedKeypoints:
    """Stands where the keypoint network stood."""

    def __init__(self, network: HandKeypointNet, exported: ExportedNetwork) -> None:
        self.config = network.config
        self.exported = exported

    def __call__(self, crop: Tensor) -> JointMaps:
        values = self.exported(crop)
        maps = values.view(1, 21, 5, *values.shape[2:])
        return JointMaps(maps[:, :, :3], maps[:, :, 3], maps[:, :, 4])


def stages(
    segmentation: Callable[[Tensor], Tensor],
    keypoints: Any,
    restoration: Callable[[Any], Any],
    seen: list[FrameTensors],
    full: list[FrameTensors],
) -> dict[str, Callable[[], Any]]:
    """Calls of the three parts and of all, each on the next of the frames."""

    def turning(work: Callable[[int], Any]) -> Callable[[], Any]:
        numbers = itertools.cycle(range(len(full)))
        return lambda: work(next(numbers))

    def mask(number: int) -> Any:
        return segmentation(seen[number].inputs.color) > 0

    def hand(number: int) -> Any:
        return predict_keypoints(keypoints, seen[number].inputs, seen[number].hand_mask)

    def depth(number: int) -> Any:
        return restoration(full[number].inputs)

    return {
        "mask": turning(mask),
        "keypoints": turning(hand),
        "restoration": turning(depth),
        "all": turning(lambda number: (mask(number), hand(number), depth(number))),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--turns", type=int, default=40)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--no-onnx", action="store_true")
    args = parser.parse_args()
    torch.set_num_threads(args.threads)

    recipes = {name: preset("mini", name) for name in ("hadr", "segmentation", "hand-keypoints")}
    seen_size = recipes["segmentation"].size
    chosen = [frame for number, frame in enumerate(open_samples("val")) if number % 12 == 0]
    full, seen = load_frames(chosen, SIZE), load_frames(chosen, seen_size)
    one = ([f.take([n]) for n in range(len(full))] for f in (full, seen))
    full_frames, seen_frames = one
    torch.manual_seed(0)
    network: Any = HADR(recipes["hadr"].model).eval()  # type: ignore[arg-type]
    masks: Any = SegmentationNet(recipes["segmentation"].model).eval()  # type: ignore[arg-type]
    hands: Any = HandKeypointNet(recipes["hand-keypoints"].model).eval()  # type: ignore[arg-type]

    forms: dict[str, tuple[Any, Any, Any]] = {
        "as it is": (masks, hands, network),
        "half the rays": (masks, hands, SparseRays(network)),
    }
    onnx = not args.no_onnx and importlib.util.find_spec("onnxruntime") is not None
    with tempfile.TemporaryDirectory() as name, torch.inference_mode():
        if onnx:
            folder = Path(name)
            width, height = seen_size
            side = hands.config.crop
            fast_masks = ExportedNetwork(
                export_network(masks, (1, 3, height, width), folder / "masks.onnx"), args.threads
            )
            maps = ExportedNetwork(
                export_network(_Maps(hands), (1, 1, side, side), folder / "hands.onnx"),
                args.threads,
            )
            for title, integers in (("ONNX", False), ("ONNX, 8 bit", True)):
                path = export_backbone(
                    network, SIZE, folder / f"{integers}.onnx", integers=integers
                )
                restoration = SparseRays(with_exported_backbone(network, path, args.threads))
                forms[title] = (fast_masks, _ExportedKeypoints(hands, maps), restoration)
        calls = {
            f"{form}, {part}": call
            for form, networks in forms.items()
            for part, call in stages(*networks, seen_frames, full_frames).items()
        }
        times = interleaved(calls, args.turns, args.seconds)
    rates = {
        form: {
            "wall_median": 1e3 / times[f"{form}, all"]["wall_median_ms"],
            "wall_best": 1e3 / times[f"{form}, all"]["wall_min_ms"],
            "cpu_median_one_core": 1e3 / times[f"{form}, all"]["cpu_median_ms"],
        }
        for form in forms
    }
    for title, row in times.items():
        print(
            f"{title:28s} wall {row['wall_median_ms']:6.1f} (least {row['wall_min_ms']:6.1f}) "
            f"cpu {row['cpu_median_ms']:6.1f} (least {row['cpu_min_ms']:6.1f}) ms"
        )
    for form, rate in rates.items():
        print(
            f"{form}: {rate['wall_median']:.1f} frames a second (median; best "
            f"{rate['wall_best']:.1f}); {rate['cpu_median_one_core']:.1f} per second of CPU"
        )
    if args.json:
        write_sealed(
            args.json,
            {
                "what": "Whole perception of one frame at batch 1, networks of preset mini: mask "
                f"and keypoints at {seen_size[0]}x{seen_size[1]}, restoration at 224x224; sample "
                "frames in turns, random weights, true masks handed on",
                "machine": machine_text(),
                "threads": args.threads,
                "times": times,
                "frames_per_second": rates,
                "provenance": provenance(),
            },
        )


if __name__ == "__main__":
    main()
