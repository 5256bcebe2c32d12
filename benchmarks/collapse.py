"""Does HADR's colour encoder survive its training? Four ways to begin, the same frames.

    python benchmarks/collapse.py --json results/training/collapse.json

The 336 bundled training frames, 20 epochs each, measured on the 144 others after each epoch and
before the first (`hadr.training.diagnosis`): in how many directions the features of the encoder's
stages vary, and what it costs to see another frame's colours. One seed; an hour of one core.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import torch

from hadr.data.samples import open_samples
from hadr.models.blocks.efficientnet_lite import LiteConfig
from hadr.models.hadr import HADRConfig
from hadr.models.window import WindowConfig
from hadr.records.provenance import machine_text, provenance
from hadr.records.result_file import write_result_file
from hadr.training.frames.batches import FrameTensors, load_frames
from hadr.training.loop import train
from hadr.training.presets import preset
from hadr.training.recipe import Preset
from hadr.training.tasks.task import Task

EPOCHS = 20
NATIVE = (448, 252)
"""Size of the bundled frames, through a window of which the last two look."""


def ways() -> dict[str, Preset]:
    """Give the recipes by their names."""
    mini = replace(preset("mini"), epochs=EPOCHS, validation_frames=None)
    assert isinstance(mini.model, HADRConfig)
    mended = replace(mini.model, voxel_relu=True)
    lite = replace(mended, lite=LiteConfig(frozen=0, pretrained=False), view=WindowConfig())
    imagenet = replace(lite, lite=LiteConfig())
    wide = replace(mini, width=NATIVE[0], height=NATIVE[1])
    return {
        "Swin, random, one rate": replace(mini, model=mended),
        "Swin, random, a tenth": replace(mini, model=mended, encoder_rate=0.1),
        "Lite0, random, one rate": replace(wide, model=lite),
        "Lite0, ImageNet, a tenth": replace(wide, model=imagenet, encoder_rate=0.1),
    }


def learn(name: str, recipe: Preset) -> dict[str, object]:
    """Train one way and keep what was measured after each epoch."""
    frames = load_frames(open_samples("train"), recipe.size)
    others = [load_frames(open_samples(split), recipe.size) for split in ("val", "test")]
    probed = FrameTensors.join(others)
    task, began = Task(recipe), time.perf_counter()
    torch.manual_seed(0)
    before = task.validate(task.build().eval(), probed, recipe.batch_size)
    trained = train(recipe, frames, probed, seed=0)
    kept = [before, *({key: row[key] for key in before} for row in trained.history)]
    last = {key: round(value, 4) for key, value in kept[-1].items()}
    print(f"{name}: {last}", flush=True)
    return {
        "way": name,
        "recipe": recipe.to_dict(),
        "frames": {"learned": len(frames), "measured": len(probed)},
        "steps_an_epoch": -(-len(frames) // recipe.batch_size),
        "seconds": time.perf_counter() - began,
        "epochs": kept,
    }


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, required=True, help="file of the results")
    parser.add_argument("--threads", type=int, default=torch.get_num_threads())
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    what = "the encoder's rank and the worth of colours while HADR learns, four ways to begin"
    about = {**provenance(), "machine": machine_text(), "threads": args.threads}
    rows = []
    for name, recipe in ways().items():
        rows.append(learn(name, recipe))
        write_result_file(args.json, what, rows, about)


if __name__ == "__main__":
    main()
