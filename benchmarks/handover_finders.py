"""Train the networks that find glass, hand and keypoints in pictures of the handover's camera.

    python benchmarks/handover_frames.py --out CAMERA --seed 1 --views 8 \\
        --train 576 --val 128 --test 0
    python benchmarks/handover_finders.py --data CAMERA --out OUT/handover

The segmentation has an EfficientNet-Lite0 with ImageNet's weights and looks twice; the keypoints'
network goes on from the bundled one of this camera.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import torch

from hadr.data.samples import samples_dir
from hadr.models.blocks.efficientnet_lite import LiteConfig
from hadr.models.blocks.resnet import UNetConfig
from hadr.models.segmentation import SegmentationConfig
from hadr.models.window import WindowConfig
from hadr.training.frames.predicted import read_split
from hadr.training.loop import train
from hadr.training.presets import preset
from hadr.training.recipe import Given, Preset
from hadr.training.train_command import starting_weights

START = {"hand-keypoints": "hand-keypoints-handover.safetensors"}
"""Bundled networks that go on."""


def recipe_of(network: str, epochs: int) -> Preset:
    """The recipe of a network."""
    mini = replace(preset("mini", network), epochs=epochs, precision="32-true")
    if network == "hand-keypoints":
        return replace(mini, learning_rate=1e-3, average_decay=0.99, roll_deg=20.0)
    model = SegmentationConfig(
        UNetConfig(decoder=(64, 32, 24, 16)),
        lite=LiteConfig(stages=4),
        view=WindowConfig(size=128, margin=2.0, jitter=0.2, hand=False, whole=0.3),
    )
    return replace(
        mini, model=model, optimizer="adamw", weight_decay=0.01, average_decay=0.98, batch_size=8
    )


def main() -> None:
    """Run the script."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="frames of this camera")
    parser.add_argument("--out", type=Path, required=True, help="folder of the trainings")
    parser.add_argument("--only", nargs="+", default=["segmentation", "hand-keypoints"])
    parser.add_argument("--epochs", type=int, default=12, help="of each network")
    args = parser.parse_args()
    torch.set_num_threads(1)
    given = Given(corruption="erased")
    for network in args.only:
        recipe = recipe_of(network, args.epochs)
        parts = {
            part: read_split([args.data], part, recipe.size, given) for part in ("train", "val")
        }
        if parts["train"] is None:
            raise FileNotFoundError(f"no folder train in {args.data}")
        data = {
            **given.record(),
            "folders": [args.data.name],
            "objects": "all",
            "frames": {name: len(part) for name, part in parts.items() if part is not None},
        }
        start = None
        if network in START:
            data["start_from"] = START[network]
            start = starting_weights(samples_dir() / "checkpoints" / START[network], recipe)
        train(
            recipe,
            parts["train"],
            parts["val"],
            folder=args.out / network,
            data=data,
            start=start,
            progress=False,
        )


if __name__ == "__main__":
    main()
