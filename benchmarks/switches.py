"""What the ledger's switches are worth: HADR trained once for each, on the bundled frames.

    python benchmarks/switches.py --json results/training/switches.json

The recipe is that of `benchmarks/collapse.py` whose encoder does not collapse: EfficientNet-Lite0
from ImageNet's weights at a tenth of the rate, behind a (smaller) window. Each row turns one switch of it,
learns from the 336 training frames, and is scored on the 144 others as the tables score, with true
and with predicted keypoints. A row that the file has is not run again, so a stopped run goes on.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from torch import nn

from hadr.data.folders import FrameSource
from hadr.data.samples import open_samples, samples_dir
from hadr.experiments.errors import frame_error
from hadr.experiments.scoring import EVALUATION_SIZE, restored_depth, score_depth
from hadr.models.blocks.efficientnet_lite import LiteConfig
from hadr.models.hadr import HADRConfig
from hadr.models.window import WindowConfig
from hadr.ray_voxels import VoxelGrid
from hadr.records.provenance import machine_text, plain, provenance
from hadr.records.result_file import read_result_file, write_result_file
from hadr.training.diagnosis import diagnose
from hadr.training.frames.batches import FrameTensors, load_frames
from hadr.training.frames.predicted import with_predicted
from hadr.training.loop import train
from hadr.training.losses import CODED, LossWeights
from hadr.training.presets import preset
from hadr.training.recipe import Given, Preset
from hadr.training.tasks.task import Task

BASE = "as it is"
NATIVE = (448, 252)
"""Size of the bundled frames, through a window of which the network looks."""
SQUASHED = (96, 96)
"""Size of the whole picture where there is no window, as many pixels as that has."""

WHAT = (
    "HADR with one switch of the ledger turned at a time, {} epochs of the bundled training "
    "frames, scored on the bundled validation and test frames (means over frames, metres)"
)


@dataclass(frozen=True)
class Switch:
    """A row: what is turned, and in which row of the ledger it stands (0: in none)."""

    row: int
    turned: str
    recipe: dict[str, Any]
    """Fields of the recipe that change."""
    model: dict[str, Any]
    """Fields of the network's configuration that change."""
    predicted: bool = False
    """Learn from predicted keypoints."""
    begin: Callable[[Any], None] | None = None
    """Changes the weights with which the network begins."""


def begin_as_published(network: Any) -> None:
    """Begin with the published code's weights: Kaiming's fan-out form, and deviations of 0.02."""
    for layer in network.backbone.aggregation.modules():
        if isinstance(layer, nn.Conv2d):
            nn.init.kaiming_normal_(layer.weight, mode="fan_out")
    for decoder in (network.probability_decoder, network.offset_decoder):
        for layer in decoder.modules():
            if isinstance(layer, nn.Linear):
                nn.init.normal_(layer.weight, std=0.02)
                nn.init.zeros_(layer.bias)


SWITCHES = (
    Switch(0, BASE, {}, {}),
    Switch(1, "loss weights as coded", {"weights": CODED}, {}),
    Switch(28, "no ReLU on voxels", {}, {"voxel_relu": False}),
    Switch(29, "encoder from random weights", {}, {"lite": LiteConfig(frozen=0, pretrained=False)}),
    Switch(29, "one rate for all layers", {"encoder_rate": 1.0}, {}),
    Switch(32, "predicted keypoints in training", {}, {}, predicted=True),
    Switch(3, "6 cells", {}, {"grid": VoxelGrid(cells=6)}),
    Switch(2, "depth loss over z alone", {"weights": LossWeights(depth_over="z")}, {}),
    Switch(10, "no epochs with the true voxel", {"true_voxel_epochs": 0}, {}),
    Switch(
        12,
        "whole picture, squashed",
        dict(zip(("width", "height"), SQUASHED, strict=True)),
        {"view": None},
    ),
    Switch(4, "offset in one step", {}, {"offset_steps": 1}),
    Switch(32, "keypoints with 1 cm of noise", {"keypoint_noise": 0.01}, {}),
    Switch(31, "other layers begin as published", {}, {}, begin=begin_as_published),
    Switch(3, "12 cells", {}, {"grid": VoxelGrid(cells=12)}),
    Switch(10, "10,000 points", {}, {"max_points": 10_000}),
    Switch(4, "probability clamped", {}, {"clamp_probability": True}),
    Switch(7, "wrist frame without rotation", {}, {"wrist_rotation": False}),
    Switch(0, "no hand", {}, {"hand": "none"}),
    Switch(0, "colours not augmented", {"augment": False}, {}),
)
RUNS = (
    (BASE, 0),
    *((switch.turned, 0) for switch in SWITCHES[1:6]),
    (BASE, 1),
    *((switch.turned, 0) for switch in SWITCHES[6:8]),
    (BASE, 2),
    *((switch.turned, 0) for switch in SWITCHES[8:]),
)
"""What is run, in this order: name and seed."""


def recipe_of(switch: Switch, epochs: int) -> Preset:
    """Give the recipe of a row."""
    mini = preset("mini")
    assert isinstance(mini.model, HADRConfig)
    model = replace(mini.model, voxel_relu=True, lite=LiteConfig(), view=WindowConfig(SQUASHED[0]))
    base = replace(
        mini,
        epochs=epochs,
        width=NATIVE[0],
        height=NATIVE[1],
        true_voxel_epochs=1,
        encoder_rate=0.1,
    )
    return replace(base, **switch.recipe, model=replace(model, **switch.model))


class Frames:
    """The bundled frames at each size that is asked for, with true and predicted keypoints."""

    def __init__(self) -> None:
        keypoints = samples_dir() / "checkpoints" / "hand-keypoints-mini.safetensors"
        self.given = Given(keypoints=str(keypoints))
        self.learned = FrameSource([open_samples("train")])
        self.others = FrameSource([open_samples(split) for split in ("val", "test")])
        self.kept: dict[Any, FrameTensors] = {}

    def read(self, part: str, size: tuple[int, int], *, predicted: bool = False) -> FrameTensors:
        """Give the frames "learned" or "others"."""
        if (part, size, predicted) not in self.kept:
            source: FrameSource = getattr(self, part)
            if predicted:
                frames = with_predicted(self.read(part, size), source, self.given)
            else:
                frames = load_frames(source, size, keep_all=part == "others")
            self.kept[part, size, predicted] = frames
        return self.kept[part, size, predicted]


def measure(network: Any, frames: FrameTensors, truth: FrameTensors) -> dict[str, Any]:
    """Score a network as the tables do, and take each frame's error apart."""
    depth, restored = restored_depth(network, frames, truth)
    masks, true = truth.object_mask.numpy(), truth.true_depth.numpy()
    parts = [
        frame_error(stem.split("/")[0], depth[n], true[n], masks[n])
        for n, stem in enumerate(truth.stems)
    ]
    scores = score_depth(depth, truth, restored).columns()
    wanted = ("rmse_m", "mae_m", "delta_105", "coverage")
    errors = {
        name: [round(getattr(part, name), 5) for part in parts]
        for name in ("rmse_m", "place_m", "shape_m")
    }
    means = {name: sum(errors[name]) / len(parts) for name in ("place_m", "shape_m")}
    del errors["place_m"]
    return {**{name: scores[name] for name in wanted}, **means, "per_frame": errors}


def learn(switch: Switch, seed: int, recipe: Preset, frames: Frames) -> dict[str, Any]:
    """Train one row and score it."""
    began = time.perf_counter()
    task, start = Task(recipe), None
    if switch.begin is not None:
        torch.manual_seed(seed)
        start = task.build()
        switch.begin(start)
    learned = frames.read("learned", recipe.size, predicted=switch.predicted)
    trained = train(recipe, learned, seed=seed, start=start, progress=False)
    seconds = time.perf_counter() - began
    truth = frames.read("others", EVALUATION_SIZE)
    given = {
        "true keypoints": frames.read("others", recipe.size),
        "predicted keypoints": frames.read("others", recipe.size, predicted=True),
    }
    row = {
        "turned": switch.turned,
        "row": switch.row,
        "seed": seed,
        "recipe": recipe.to_dict(),
        "seconds": round(seconds, 1),
        "loss": trained.history[-1]["loss"],
        "given": {name: measure(trained.model, each, truth) for name, each in given.items()},
        "sees": diagnose(trained.model, task.kind, given["true keypoints"], recipe.batch_size),
    }
    rmse = [f"{100 * each['rmse_m']:.3f}" for each in row["given"].values()]
    print(f"{switch.turned}, seed {seed}: {rmse} cm after {seconds:.0f} s", flush=True)
    return row


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, required=True, help="file of the results")
    parser.add_argument("--epochs", type=int, default=6)
    parser.add_argument("--most", type=int, default=len(RUNS), help="rows to run at most")
    args = parser.parse_args()
    torch.set_num_threads(1)
    frames, known = Frames(), {switch.turned: switch for switch in SWITCHES}
    truth = frames.read("others", EVALUATION_SIZE)
    rows = list(read_result_file(args.json).rows) if args.json.exists() else []
    about = {
        **provenance(),
        "machine": machine_text(),
        "learned": len(frames.learned),
        "measured": list(truth.stems),
        "holds": frames.others.holds(truth.stems),
    }
    ran = 0
    for turned, seed in RUNS:
        recipe = recipe_of(known[turned], args.epochs)
        same = {"turned": turned, "seed": seed, "recipe": plain(recipe.to_dict())}
        if any(same.items() <= row.items() for row in rows) or ran == args.most:
            continue
        rows.append(learn(known[turned], seed, recipe, frames))
        ran += 1
        write_result_file(args.json, WHAT.format(args.epochs), rows, about)


if __name__ == "__main__":
    main()
