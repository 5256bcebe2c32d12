"""Frames a second of the whole perception: mask, hand keypoints, restored depth.

    python benchmarks/perception.py [--json results/speed/perception.json] [--threads 2]

The three networks of preset `mini` with random weights (time does not depend on them), the
restoration at 224x224, on sample frames at batch 1. Random masks would be no masks, so each network
does its work on the true ones: segmentation runs, and the true masks go on to the other two.
"""

from __future__ import annotations

from typing import Any

import torch
from measuring import arguments, interleaved, turning

from hadr.data.samples import open_samples
from hadr.models.hadr import HADR
from hadr.models.hand.keypoints import HandKeypointNet, predict_keypoints
from hadr.models.segmentation import SegmentationNet
from hadr.records.provenance import machine_text, provenance
from hadr.records.result_file import write_sealed
from hadr.training.frames.batches import load_frames
from hadr.training.presets import preset

SIZE = (224, 224)


def main() -> None:
    args = arguments(__doc__, turns=40, seconds=60.0).parse_args()
    torch.set_num_threads(args.threads)

    recipes = {name: preset("mini", name) for name in ("hadr", "segmentation", "hand-keypoints")}
    seen_size = recipes["segmentation"].size
    chosen = [frame for number, frame in enumerate(open_samples("val")) if number % 12 == 0]
    full, seen = load_frames(chosen, SIZE), load_frames(chosen, seen_size)
    full_frames, seen_frames = ([f.take([n]) for n in range(len(full))] for f in (full, seen))
    torch.manual_seed(0)
    network: Any = HADR(recipes["hadr"].model).eval()  # type: ignore[arg-type]
    masks: Any = SegmentationNet(recipes["segmentation"].model).eval()  # type: ignore[arg-type]
    hands: Any = HandKeypointNet(recipes["hand-keypoints"].model).eval()  # type: ignore[arg-type]

    def perceive(number: int) -> None:
        inputs = seen_frames[number].inputs
        _ = masks(inputs.color) > 0
        predict_keypoints(hands, inputs, seen_frames[number].hand_mask)
        network(full_frames[number].inputs)

    with torch.inference_mode():
        calls = {"as it is, all": turning(perceive, len(full))}
        times = interleaved(calls, args.turns, args.seconds)
    rate = {
        "wall_median": 1e3 / times["as it is, all"]["wall_median_ms"],
        "wall_best": 1e3 / times["as it is, all"]["wall_min_ms"],
    }
    print(f"{rate['wall_median']:.1f} frames a second (median; best {rate['wall_best']:.1f})")
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
