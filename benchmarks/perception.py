"""Frames a second of the whole perception: mask, hand keypoints, restored depth.

    python benchmarks/perception.py [--json results/speed/perception.json] [--threads 2]

The three networks of preset `mini` with random weights (time does not depend on them), the
restoration at 224x224, on sample frames at batch 1. Random masks would be no masks, so each network
does its work on the true ones: segmentation runs, and the true masks go on to the other two.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from measuring import arguments, interleaved, turning
from torch import Tensor

from hadr.data.samples import open_samples
from hadr.models.hadr import HADR
from hadr.models.hand.keypoints import HandKeypointNet, predict_keypoints
from hadr.models.segmentation import SegmentationNet
from hadr.records.provenance import machine_text, provenance
from hadr.records.result_file import write_sealed
from hadr.training.frames.batches import FrameTensors, load_frames
from hadr.training.presets import preset

SIZE = (224, 224)


def stages(
    segmentation: Callable[[Tensor], Tensor],
    keypoints: Any,
    restoration: Callable[[Any], Any],
    seen: list[FrameTensors],
    full: list[FrameTensors],
) -> dict[str, Callable[[], Any]]:
    """Calls of the three parts and of all, each on the next of the frames."""

    def mask(number: int) -> Any:
        return segmentation(seen[number].inputs.color) > 0

    def hand(number: int) -> Any:
        return predict_keypoints(keypoints, seen[number].inputs, seen[number].hand_mask)

    def depth(number: int) -> Any:
        return restoration(full[number].inputs)

    works: dict[str, Callable[[int], Any]] = {
        "mask": mask,
        "keypoints": hand,
        "restoration": depth,
        "all": lambda number: (mask(number), hand(number), depth(number)),
    }
    return {name: turning(work, len(full)) for name, work in works.items()}


def main() -> None:
    args = arguments(__doc__, turns=40, seconds=60.0).parse_args()
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

    with torch.inference_mode():
        calls = {
            f"as it is, {part}": call
            for part, call in stages(masks, hands, network, seen_frames, full_frames).items()
        }
        times = interleaved(calls, args.turns, args.seconds)
    whole = times["as it is, all"]
    rate = {
        "wall_median": 1e3 / whole["wall_median_ms"],
        "wall_best": 1e3 / whole["wall_min_ms"],
        "cpu_median_one_core": 1e3 / whole["cpu_median_ms"],
    }
    for title, row in times.items():
        print(
            f"{title:28s} wall {row['wall_median_ms']:6.1f} (least {row['wall_min_ms']:6.1f}) "
            f"cpu {row['cpu_median_ms']:6.1f} (least {row['cpu_min_ms']:6.1f}) ms"
        )
    print(
        f"{rate['wall_median']:.1f} frames a second (median; best {rate['wall_best']:.1f}); "
        f"{rate['cpu_median_one_core']:.1f} per second of CPU"
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
                "frames_per_second": {"as it is": rate},
                "provenance": provenance(),
            },
        )


if __name__ == "__main__":
    main()
