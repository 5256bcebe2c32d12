"""What becomes of a network if one thing in its recipe is changed: a short training for each.

    python benchmarks/networks/switches.py ledger --json results/training/switches.json
    python benchmarks/networks/switches.py collapse --json results/training/collapse.json
    python benchmarks/networks/switches.py plus --data DIR data_samples/frames \\
        --json results/mini/hadr-plus-ablation.json

`ledger`: HADR with the ledger's switches, one at a time, on the 336 bundled training frames, scored
on the 144 others as the tables score, with true and with predicted keypoints. What stays is the
recipe in which its encoder does not collapse: EfficientNet-Lite0 from ImageNet's weights at a tenth
of the rate, behind a window of 96 pixels. Its three seeds show what chance is worth.
`collapse`: four ways to begin on the same frames, measured after each epoch and before the first
(`hadr.training.tasks.diagnosis`): in how many directions the features of the encoder's stages
vary, and what it costs to see another frame's colours. One seed; an hour of one core.
`plus`: HADR-plus with one part taken out, on the training frames of DIR (which `hadr generate
--preset mini` has made), scored on validation frames; no test frame is read.

A row that the file has, of the same recipe, data and code (what stands here aside), is not run
again, so a stopped run goes on.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import torch
from frame_errors import frame_error
from torch import Tensor, nn
from torch.nn import functional

from hadr.data.folders import FrameSource, data_digest
from hadr.data.samples import open_samples, samples_dir
from hadr.experiments.averages import paired
from hadr.experiments.protocol import open_part
from hadr.experiments.runner import code_of
from hadr.experiments.scoring import (
    EVALUATION_SIZE,
    restored_depth,
    score_depth,
    score_network,
)
from hadr.models.blocks.efficientnet_lite import LiteConfig
from hadr.models.hadr import HADROutput
from hadr.models.window import WindowConfig
from hadr.ray_voxels import VoxelGrid
from hadr.records.provenance import plain, provenance
from hadr.records.result_file import digest, read_result_file, write_result_file
from hadr.training.frames.batches import FrameTensors, load_frames
from hadr.training.frames.predicted import with_predicted
from hadr.training.loop import evenly, train
from hadr.training.losses import (
    CODED,
    LossTerms,
    LossWeights,
    hadr_losses,
    image_points,
    mean_where,
    normals_apart,
)
from hadr.training.presets import preset
from hadr.training.recipe import Given, Preset
from hadr.training.tasks.diagnosis import diagnose
from hadr.training.tasks.task import Task

NATIVE = {"width": 320, "height": 180}
"""Size of the bundled frames, through a window of which a network looks."""
RANDOM_LITE = LiteConfig(frozen=0, pretrained=False)
SEES = {"voxel_relu": True, "lite": LiteConfig(), "encoder_rate": 0.1, **NATIVE}
"""With ImageNet's weights at a tenth of the rate HADR's encoder doesn't collapse."""


@dataclass(frozen=True)
class Change:
    """A row: what is changed, and in which row of the ledger it stands (0: in none)."""

    turned: str
    fields: dict[str, Any] = field(default_factory=dict)
    """Fields that change, of the recipe or of its network's configuration."""
    row: int = 0
    predicted: bool = False
    """Learn from predicted keypoints."""
    begin: Callable[[Any], None] | None = None
    """Changes the weights with which the network begins."""
    instead: dict[str, Callable[..., Any]] = field(default_factory=dict)
    """What stands in the place of the library's functions while the row is measured."""


def changed(recipe: Preset, fields: dict[str, Any]) -> Preset:
    """Give a recipe in which some fields differ, of its own or of the network's configuration."""
    own = {name: value for name, value in fields.items() if hasattr(recipe, name)}
    rest = {name: value for name, value in fields.items() if name not in own}
    model: Any = recipe.model
    return replace(recipe, **own, model=replace(model, **rest))


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


def enlarge_as_published(features: Tensor, factor: int, size: Sequence[int]) -> Tensor:
    """Enlarge a map so that its outermost cells' centres lie on the outermost pixels."""
    large = functional.interpolate(
        features, scale_factor=factor, mode="bilinear", align_corners=True
    )
    return large[:, :, : size[0], : size[1]]


def losses_with_border(
    output: HADROutput, true_depth: Tensor, intrinsics: Tensor, *args: Any, **further: Any
) -> LossTerms:
    """Give HADR's losses with the normals' taken over the whole mask.

    A neighbour outside of it is the true point there, of the restored cloud as well.
    """
    terms = hadr_losses(output, true_depth, intrinsics, *args, **further)
    stride: int = further.get("ray_stride", 1)
    there = output.chosen >= 0
    rays, points = output.rays[there], output.points[there]
    row, column = (output.rays[0, 1:] % stride).tolist()  # every n-th, from a place by chance
    cell = (rays[:, 0], rays[:, 1] // stride, rays[:, 2] // stride)
    depth = true_depth[:, row::stride, column::stride]
    truth = image_points(true_depth, intrinsics)[:, row::stride, column::stride]
    apart, known = normals_apart(truth.index_put(cell, points), truth, depth > 0)
    mask = torch.zeros_like(depth, dtype=torch.bool).index_put(cell, there[there])
    return replace(terms, normals=mean_where(apart / 2, known & mask[:, :-1, :-1]))


BASE = Change("as it is")
LEDGER = (
    BASE,
    Change("loss weights as coded", {"weights": CODED}, 1),
    Change("no ReLU on voxels", {"voxel_relu": False}, 28),
    Change("encoder from random weights", {"lite": RANDOM_LITE}, 29),
    Change("one rate for all layers", {"encoder_rate": 1.0}, 29),
    Change("predicted keypoints in training", {}, 32, predicted=True),
    Change(
        "maps enlarged as published",
        row=30,
        instead={"hadr.models.backbone.enlarge": enlarge_as_published},
    ),
    Change("other layers begin as published", row=31, begin=begin_as_published),
    Change(
        "normals up to the mask's border",
        row=33,
        instead={"hadr.training.tasks.hadr.hadr_losses": losses_with_border},
    ),
    Change("6 cells", {"grid": VoxelGrid(cells=6)}, 3),
    Change("cells begin at 0 m", {"grid": VoxelGrid((-1.0, -1.0, 0.125), (1.0, 1.0, 2.125))}, 3),
    Change("depth loss over z alone", {"weights": LossWeights(depth_over="z")}, 2),
    Change("no epochs with the true voxel", {"true_voxel_epochs": 0}, 10),
    Change("whole picture, squashed", {"width": 96, "height": 96, "view": None}, 12),
    Change("offset in one step", {"offset_steps": 1}, 4),
    Change("keypoints with 1 cm of noise", {"keypoint_noise": 0.01}, 32),
    Change("12 cells", {"grid": VoxelGrid(cells=12)}, 3),
    Change("10,000 points", {"max_points": 10_000}, 10),
    Change("probability clamped", {"clamp_probability": True}, 4),
    Change("wrist frame without rotation", {"wrist_rotation": False}, 7),
    Change("no hand", {"hand": "none"}),
    Change("colours not augmented", {"augment": False}),
)
LEDGER_RUNS = [(change, 0) for change in LEDGER]
LEDGER_RUNS[1:1] = [(BASE, 1), (BASE, 2)]
WAYS = (
    Change("Swin, random, one rate", {"voxel_relu": True}),
    Change("Swin, random, a tenth", {"voxel_relu": True, "encoder_rate": 0.1}),
    Change(
        "Lite0, random, one rate",
        {**SEES, "lite": RANDOM_LITE, "view": WindowConfig(), "encoder_rate": 1.0},
    ),
    Change("Lite0, ImageNet, a tenth", {**SEES, "view": WindowConfig()}),
)
PLUS = (
    Change("full"),
    Change("no plane", {"plane": False}),
    Change("no hand vector", {"hand_vector": False}),
    Change("no keypoint maps", {"keypoint_maps": False}),
    Change("no hand at all", {"hand_vector": False, "keypoint_maps": False}),
    Change("no depth relative to the hand's", {"hand_depth": False}),
    Change("no metric crop", {"metric_crop": False}),
    Change("one candidate", {"candidates": 1}),
    Change("no colour", {"color": False}),
    Change("no mirror, no roll", {"mirror": 0.0, "roll_deg": 0.0}),
)


class Frames:
    """The frames of a benchmark at each size that is asked for; keypoints true or predicted."""

    def __init__(
        self,
        roots: Sequence[Path],
        learned: FrameSource,
        others: FrameSource,
        most: int | None = None,
    ) -> None:
        self.roots, self.most = roots, most
        keypoints = samples_dir() / "checkpoints" / "hand-keypoints-imagenet.safetensors"
        self.given = Given(keypoints=str(keypoints))
        self.sources = {"learned": learned, "others": others}
        self.kept: dict[Any, FrameTensors] = {}

    def read(self, part: str, size: tuple[int, int], *, predicted: bool = False) -> FrameTensors:
        """Give the frames "learned", at most so many of them, or "others"."""
        key = (part, size, predicted)
        if key not in self.kept:
            if predicted:
                known = self.read(part, size)
                self.kept[key] = with_predicted(known, self.sources[part], self.given)
            else:
                every = part == "others"
                loaded = load_frames(self.sources[part], size, keep_all=every)
                self.kept[key] = loaded if every else evenly(loaded, self.most)
        return self.kept[key]

    def origin(self) -> dict[str, Any]:
        """Which frames are measured, and the hold of each."""
        stems = self.read("others", EVALUATION_SIZE).stems
        return {
            "data": {"sha256": digest([data_digest(root) for root in self.roots])},
            "learned": min(len(self.sources["learned"]), self.most or sys.maxsize),
            "measured": list(stems),
            "holds": self.sources["others"].holds(stems),
        }


def taken_apart(network: Any, frames: FrameTensors, truth: FrameTensors) -> dict[str, Any]:
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


def ledger_row(change: Change, seed: int, recipe: Preset, frames: Frames) -> dict[str, Any]:
    """Train a row of the ledger and score it."""
    began = time.perf_counter()
    task, start = Task(recipe), None
    if change.begin is not None:
        torch.manual_seed(seed)
        start = task.build()
        change.begin(start)
    learned = frames.read("learned", recipe.size, predicted=change.predicted)
    trained = train(recipe, learned, seed=seed, start=start, progress=False)
    seconds = time.perf_counter() - began
    truth = frames.read("others", EVALUATION_SIZE)
    given = {
        "true keypoints": frames.read("others", recipe.size),
        "predicted keypoints": frames.read("others", recipe.size, predicted=True),
    }
    return {
        "row": change.row,
        "seconds": round(seconds, 1),
        "loss": trained.history[-1]["loss"],
        "given": {name: taken_apart(trained.model, each, truth) for name, each in given.items()},
        "sees": diagnose(trained.model, task.kind, given["true keypoints"], recipe.batch_size),
    }


def way_row(change: Change, seed: int, recipe: Preset, frames: Frames) -> dict[str, Any]:
    """Train one way to begin and keep what was measured after each epoch."""
    learned, probed = (frames.read(part, recipe.size) for part in ("learned", "others"))
    task, began = Task(recipe), time.perf_counter()
    torch.manual_seed(seed)
    before = task.validate(task.build().eval(), probed, recipe.batch_size)
    history = train(recipe, learned, probed, seed=seed).history
    return {
        "way": change.turned,
        "frames": {"learned": len(learned), "measured": len(probed)},
        "steps_an_epoch": -(-len(learned) // recipe.batch_size),
        "seconds": time.perf_counter() - began,
        "epochs": [before, *({key: row[key] for key in before} for row in history)],
    }


def plus_row(change: Change, seed: int, recipe: Preset, frames: Frames) -> dict[str, Any]:
    """Train HADR-plus without a part and score it."""
    began = time.perf_counter()
    trained = train(recipe, frames.read("learned", recipe.size), seed=seed)
    seconds = time.perf_counter() - began
    given, truth = (frames.read("others", size) for size in (recipe.size, EVALUATION_SIZE))
    scores = score_network(trained.model, given, truth)
    return {
        "network": change.turned,
        "out": change.fields,
        "parameters": sum(p.numel() for p in trained.model.parameters()),
        "training_s": round(seconds, 1),
        **scores.columns(),
        "per_frame": scores.per_frame(),
    }


@dataclass(frozen=True)
class Bench:
    """One of the benchmarks here."""

    what: str
    recipe: Callable[[Change, int], Preset]
    """Gives a row's recipe, from the number of epochs."""
    runs: list[tuple[Change, int]]
    measure: Callable[[Change, int, Preset, Frames], dict[str, Any]]
    epochs: int


def changes_of(base: Preset) -> Callable[[Change, int], Preset]:
    """Give what changes a recipe and its number of epochs."""
    return lambda change, epochs: replace(changed(base, change.fields), epochs=epochs)


BENCHES = {
    "ledger": Bench(
        "HADR with one switch of the ledger turned at a time, {} epochs of the bundled training "
        "frames, scored on the bundled validation and test frames (means over frames, metres)",
        changes_of(
            changed(preset("mini"), {**SEES, "view": WindowConfig(96), "true_voxel_epochs": 1})
        ),
        LEDGER_RUNS,
        ledger_row,
        epochs=6,
    ),
    "collapse": Bench(
        "the encoder's rank and the worth of colours while HADR learns, four ways to begin, {} "
        "epochs",
        changes_of(replace(preset("mini"), validation_frames=None)),
        [(way, 0) for way in WAYS],
        way_row,
        epochs=20,
    ),
    "plus": Bench(
        "HADR-plus of preset mini trained for {} epochs on the known objects' training frames, one "
        "part taken out, scored on their validation frames (means over frames, metres); one seed",
        changes_of(preset("mini", "hadr-plus")),
        [(change, 0) for change in PLUS],
        plus_row,
        epochs=4,
    ),
}


def run(bench: Bench, frames: Frames, path: Path, epochs: int | None) -> None:
    """Run what the file has not yet, and write all rows each time there is one more."""
    torch.set_num_threads(1)
    epochs, origin = epochs or bench.epochs, frames.origin()
    about = {**provenance(), "threads": 1, **origin}
    known = read_result_file(path).rows if path.exists() else ()
    kept = {row.get("config_sha256"): row for row in known}
    wanted = {}
    for change, seed in bench.runs:
        recipe = bench.recipe(change, epochs)
        row = {"turned": change.turned, "seed": seed, "recipe": plain(recipe.to_dict())}
        code = code_of(recipe.network, "hadr.experiments.runner")
        wanted[digest([row, origin["data"], code])] = change, seed, recipe, row
    for key, (change, seed, recipe, row) in wanted.items():
        if key in kept:
            continue
        with ExitStack() as swapped:
            for name, function in change.instead.items():
                swapped.enter_context(patch(name, function))
            measured = bench.measure(change, seed, recipe, frames)
        kept[key] = {**row, "config_sha256": key, **measured}
        rows = [kept[key] for key in wanted if key in kept]
        for one in rows:
            if "per_frame" in one:
                first = rows[0]["per_frame"]
                one["against_full"] = paired(one["per_frame"], first, origin["holds"])
        write_result_file(path, bench.what.format(epochs), rows, about)
        print(f"{change.turned}, seed {seed}", flush=True)


def main() -> None:
    """Run a benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bench", choices=BENCHES)
    parser.add_argument("--json", type=Path, required=True, help="file of the results")
    parser.add_argument("--data", type=Path, nargs="+", help="of plus: folders with its frames")
    parser.add_argument("--epochs", type=int)
    args = parser.parse_args()
    if args.bench == "plus":
        roots = args.data or []
        frames = Frames(roots, *(open_part(roots, "known", part) for part in ("train", "val")))
    else:
        parts = (open_samples("train"),), (open_samples("val"), open_samples("test"))
        frames = Frames([samples_dir() / "frames"], *map(FrameSource, parts))
    run(BENCHES[args.bench], frames, args.json, args.epochs)


if __name__ == "__main__":
    main()
