"""Train the network that finds glass and hand in pictures of the handover's camera.

    python benchmarks/handover_frames.py --out VIEWS --seed 1 --views 8 \\
        --train 576 --val 128 --test 0
    python benchmarks/handover_segmentation.py --data VIEWS --out OUT/handover/segmentation

Its encoder is an EfficientNet-Lite0 with ImageNet's weights, and it looks twice.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import torch

from hadr.training.frames.predicted import read_split
from hadr.training.loop import train
from hadr.training.presets import preset
from hadr.training.recipe import Given

SIZE = preset("mini", "segmentation").size
RECIPE = replace(
    preset("imagenet", "segmentation"), width=SIZE[0], height=SIZE[1], epochs=10, encoder_rate=1.0
)


def main() -> None:
    """Run the script."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="frames of this camera")
    parser.add_argument("--out", type=Path, required=True, help="folder of the training")
    args = parser.parse_args()
    torch.set_num_threads(1)
    given = Given(corruption="erased")
    training = read_split([args.data], "train", RECIPE.size, given)
    if training is None:
        raise FileNotFoundError(f"no folder train in {args.data}")
    validation = read_split([args.data], "val", RECIPE.size, given)
    parts = {"train": training, "val": validation}
    data = {
        **given.record(),
        "folders": [args.data.name],
        "objects": "all",
        "frames": {name: len(part) for name, part in parts.items() if part is not None},
    }
    train(RECIPE, training, validation, folder=args.out, data=data)


if __name__ == "__main__":
    main()
