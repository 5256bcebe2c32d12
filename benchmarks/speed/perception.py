"""Frames a second of the whole perception: mask, hand keypoints, restored depth.

    python benchmarks/speed/perception.py [--json results/speed/perception.json] [--threads 2]

Sample frames at batch 1. Each network does its work on the true masks: segmentation runs, and the
true masks go on to the other two. First the three networks of preset `mini` with random weights
(time does not depend on them, and random masks would be none), the restoration at 224x224; then the
bundled networks at their own size.
"""

from __future__ import annotations

from typing import Any

import torch
from measuring import arguments, interleaved, sample_frames, turning

from hadr.data.samples import samples_dir
from hadr.models.hadr import HADR
from hadr.models.hand.keypoints import HandKeypointNet, predict_keypoints
from hadr.models.segmentation import SegmentationNet, predict_logits
from hadr.records.provenance import provenance
from hadr.records.result_file import write_sealed
from hadr.training.checkpoints import for_inference, load_checkpoint
from hadr.training.presets import preset

SIZE = (224, 224)


def perception(
    masks: Any, hands: Any, network: Any, seen_size: tuple[int, int], size: tuple[int, int]
) -> Any:
    """A call that perceives the next of the sample frames."""
    seen, full = sample_frames(seen_size), sample_frames(size)
    seen_frames, full_frames = ([f.take([n]) for n in range(len(f))] for f in (seen, full))

    def perceive(number: int) -> None:
        inputs = seen_frames[number].inputs
        predict_logits(masks, inputs.color)
        predict_keypoints(hands, inputs, seen_frames[number].hand_mask)
        network(full_frames[number].inputs)

    return turning(perceive, len(full))


def main() -> None:
    args = arguments(__doc__, turns=40, seconds=120.0).parse_args()
    torch.set_num_threads(args.threads)

    recipes = {name: preset("mini", name) for name in ("hadr", "segmentation", "hand-keypoints")}
    seen_size = recipes["segmentation"].size
    torch.manual_seed(0)
    small: tuple[Any, ...] = (
        SegmentationNet(recipes["segmentation"].model),  # type: ignore[arg-type]
        HandKeypointNet(recipes["hand-keypoints"].model),  # type: ignore[arg-type]
        HADR(recipes["hadr"].model),  # type: ignore[arg-type]
    )
    masks, hands, network = map(for_inference, small)
    calls = {"as it is": perception(masks, hands, network, seen_size, SIZE)}
    folder = samples_dir() / "checkpoints"
    kinds = ("segmentation", "hand-keypoints", "hadr", "hadr-plus")
    loaded = [load_checkpoint(folder / f"{kind}-imagenet.safetensors") for kind in kinds]
    masks, hands, *networks = (for_inference(network) for network, _ in loaded)
    size = loaded[0][1]["width"], loaded[0][1]["height"]
    for kind, network in zip(kinds[2:], networks, strict=True):
        calls[f"bundled {kind}"] = perception(masks, hands, network, size, size)
    with torch.inference_mode():
        times = interleaved(calls, args.turns, args.seconds)
    rates = {
        name: {"wall_median": 1e3 / t["wall_median_ms"], "wall_best": 1e3 / t["wall_min_ms"]}
        for name, t in times.items()
    }
    for name, rate in rates.items():
        print(
            f"{name}: {rate['wall_median']:.1f} frames a second (median; best "
            f"{rate['wall_best']:.1f})"
        )
    if args.json:
        write_sealed(
            args.json,
            {
                "what": "Whole perception of one frame at batch 1; sample frames in turns, true "
                "masks handed on. 'as it is': networks of preset mini with random weights, mask "
                f"and keypoints at {seen_size[0]}x{seen_size[1]}, restoration at 224x224. "
                f"'bundled': the bundled networks at {size[0]}x{size[1]}",
                "threads": args.threads,
                "times": times,
                "frames_per_second": rates,
                "provenance": provenance(),
            },
        )


if __name__ == "__main__":
    main()
