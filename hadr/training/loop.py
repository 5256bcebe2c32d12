"""The training loop: one pass after another over frames in memory, resumable, readable downwards.

Every random choice of an epoch follows from the seed and the epoch's number. A training that was
stopped and resumed therefore ends with the same weights as one that ran through.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from tqdm import tqdm

from hadr.metrics import mean_over_frames
from hadr.models.hadr import HADR, masked_rays
from hadr.provenance import provenance
from hadr.training.batches import (
    CORRUPTIONS,
    FrameTensors,
    augment_batch,
    batches,
    load_frames,
)
from hadr.training.checkpoints import (
    adam_state,
    load_checkpoint,
    load_training_state,
    restore_adam,
    save_checkpoint,
)
from hadr.training.evaluation import evaluate
from hadr.training.losses import CODED, hadr_losses
from hadr.training.presets import Preset, preset

LAST = "last.safetensors"
BEST = "best.safetensors"
TERMS = ("depth", "probability", "normals", "voxel_accuracy", "without_true_voxel")


@dataclass(frozen=True)
class Trained:
    """What a training gives.

    Attributes:
        model: The network after the last epoch, in evaluation mode.
        history: One row of numbers an epoch.
    """

    model: HADR
    history: list[dict[str, float]]


def train(
    recipe: Preset,
    frames: FrameTensors,
    validation: FrameTensors | None = None,
    *,
    folder: str | Path | None = None,
    seed: int = 0,
    data: Mapping[str, Any] | None = None,
    resume: bool = False,
    stop_after: int | None = None,
    progress: bool = True,
    watch: Callable[[int, HADR], None] | None = None,
) -> Trained:
    """Train the network.

    Args:
        recipe: What to train, and how.
        frames: Training frames at the recipe's size.
        validation: Frames that are only scored, after each epoch.
        folder: Where `last.safetensors`, `best.safetensors` (the smallest validation error),
            their records and `history.csv` go; None writes nothing.
        seed: Seed of weights, shuffling, stochastic depth and colour variation.
        data: What the frames are (their number, corruption, objects), plain values for the
            record; a training can only be resumed with the same.
        resume: Go on from the folder's last checkpoint, if there is one.
        stop_after: Stop after this many epochs, as if interrupted.
        progress: Show a progress bar.
        watch: Called after each epoch with its number and the network, e.g. to keep pictures.

    Returns:
        The trained network and the history.

    Raises:
        ValueError: `resume` without a folder, or with a checkpoint of another recipe, seed or
            data; a folder that holds a training, without `resume`.
    """
    folder = None if folder is None else Path(folder)
    torch.manual_seed(seed)
    model = HADR(recipe.model)
    optimizer = torch.optim.Adam(model.parameters(), lr=recipe.learning_rate)
    history: list[dict[str, float]] = []
    if resume:
        history = _resume(model, optimizer, recipe, seed, data, folder)
    elif folder is not None and (folder / LAST).exists():
        raise ValueError(
            f"{folder} holds a training already ({LAST}); resume it, or name another folder"
        )

    made_with = provenance()
    epochs = range(len(history), min(recipe.epochs, stop_after or recipe.epochs))
    for epoch in tqdm(epochs, "epochs", disable=not progress, mininterval=1.0):
        started = time.perf_counter()
        torch.manual_seed(seed * 100_003 + epoch)  # stochastic depth
        generator = torch.Generator().manual_seed(seed * 100_003 + epoch)  # all else
        for group in optimizer.param_groups:
            group["lr"] = recipe.rate(epoch)
        sums = dict.fromkeys(("loss", *TERMS), 0.0)
        seen = 0

        model.train()
        for inputs, true_depth in batches(frames, recipe.batch_size, generator):
            if recipe.augment:
                inputs = replace(inputs, color=augment_batch(inputs.color, generator))
            stride = recipe.ray_stride
            row, column = torch.randint(stride, (2,), generator=generator).tolist()
            output = model(
                inputs,
                rays=masked_rays(inputs.mask, stride, row, column),
                true_depth=true_depth if epoch < recipe.true_voxel_epochs else None,
            )
            terms = hadr_losses(
                output,
                true_depth,
                inputs.intrinsics,
                recipe.model.grid,
                depth_over=recipe.weights.depth_over,
                ray_stride=stride,
            )
            loss = terms.total(recipe.weights)
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()

            seen += len(inputs)
            sums["loss"] += loss.item() * len(inputs)
            for name in TERMS:
                sums[name] += getattr(terms, name).item() * len(inputs)

        row_of_numbers = {"epoch": float(epoch), "rate": recipe.rate(epoch)}
        row_of_numbers |= {name: value / seen for name, value in sums.items()}
        if validation is not None:
            scores = mean_over_frames(evaluate(model, validation, recipe.batch_size))
            row_of_numbers |= {
                "validation_rmse_m": scores.rmse_m,
                "validation_mae_m": scores.mae_m,
                "validation_delta_105": scores.delta_105,
            }
        row_of_numbers["seconds"] = time.perf_counter() - started
        history.append(row_of_numbers)
        if watch is not None:
            watch(epoch, model)
        if folder is not None:
            _save(folder, model, optimizer, recipe, seed, data, history, made_with)
    model.eval()
    return Trained(model, history)


def _save(
    folder: Path,
    model: HADR,
    optimizer: torch.optim.Adam,
    recipe: Preset,
    seed: int,
    data: Mapping[str, Any] | None,
    history: list[dict[str, float]],
    made_with: dict[str, Any],
) -> None:
    """Write the epoch's checkpoint, the history, and the best checkpoint where this one is it."""
    meta = {
        "width": recipe.width,
        "height": recipe.height,
        "preset": recipe.to_dict(),
        "seed": seed,
        "data": None if data is None else dict(data),
        "epochs": len(history),
        "history": history,
        "made_with": made_with,
    }
    save_checkpoint(folder / LAST, model, meta, training_state=adam_state(optimizer))
    errors = [row["validation_rmse_m"] for row in history if "validation_rmse_m" in row]
    if errors and errors[-1] == min(errors):
        save_checkpoint(folder / BEST, model, meta)
    temporary = folder / ".history.csv"
    with temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=list(history[0]))
        writer.writeheader()
        writer.writerows(history)
    os.replace(temporary, folder / "history.csv")


def _resume(
    model: HADR,
    optimizer: torch.optim.Adam,
    recipe: Preset,
    seed: int,
    data: Mapping[str, Any] | None,
    folder: Path | None,
) -> list[dict[str, float]]:
    """Load the folder's last checkpoint into model and optimizer; give the history so far."""
    if folder is None:
        raise ValueError("resume needs the folder with the last checkpoint, got None")
    if not (folder / LAST).is_file():
        return []
    earlier, meta = load_checkpoint(folder / LAST)
    if meta["seed"] != seed:
        raise ValueError(f"{folder / LAST} was trained with seed {meta['seed']}, not {seed}")
    if earlier.config != recipe.model or meta["preset"]["name"] != recipe.name:
        raise ValueError(
            f"{folder / LAST} holds a training of preset {meta['preset']['name']!r} with another "
            f"network than preset {recipe.name!r} asks for"
        )
    asked = json.loads(json.dumps({"recipe": recipe.to_dict(), "data": data}))
    stored = {"recipe": meta["preset"], "data": meta.get("data")}
    for part, values in asked.items():
        for name in sorted(set(values or {}) | set(stored[part] or {})):
            then, now = (stored[part] or {}).get(name), (values or {}).get(name)
            if then != now and name != "epochs":
                raise ValueError(
                    f"{folder / LAST} was trained with {name} = {then}, not {now}; resume it "
                    "with the same, or name another folder"
                )
    model.load_state_dict(earlier.state_dict())
    restore_adam(optimizer, load_training_state(folder / LAST))
    history: list[dict[str, float]] = meta["history"]
    return history


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `hadr train`."""
    parser.add_argument("data", help="folder in TransHand's layout, with a split `train`")
    parser.add_argument("out", help="folder for checkpoints and history.csv")
    parser.add_argument(
        "--preset",
        default="mini",
        choices=("tiny", "mini", "paper"),
        help="size of network, pictures and schedule (mini)",
    )
    parser.add_argument(
        "--epochs", type=int, help="instead of the preset's; the rate's drop moves along"
    )
    parser.add_argument("--drop-epoch", type=int, help="when the rate falls, instead of preset's")
    parser.add_argument("--hand", choices=("none", "2d", "3d"), help="the hand feature")
    parser.add_argument(
        "--no-aggregation", action="store_true", help="the backbone's finest scale alone"
    )
    parser.add_argument(
        "--no-point-fusion", action="store_true", help="raw colour in the voxel features"
    )
    parser.add_argument(
        "--coded-weights", action="store_true", help="loss weights 0.5 and 10, not as printed"
    )
    parser.add_argument("--pretrained", metavar="NAME", help="published Swin weights to start from")
    parser.add_argument(
        "--corruption",
        default="oracle",
        choices=tuple(CORRUPTIONS),
        help="oracle: no depth in the object's mask; analytic: a stereo camera imitated by "
        "formulas; sensor: the frames' raw depth (oracle)",
    )
    parser.add_argument("--objects", nargs="+", metavar="ID", help="train on these objects only")
    parser.add_argument("--seed", type=int, default=0, help="seed of everything (0)")
    parser.add_argument("--resume", action="store_true", help="go on from the last checkpoint")


def recipe_from(args: argparse.Namespace) -> Preset:
    """Build the recipe that the arguments of `hadr train` describe."""
    recipe = preset(args.preset)
    model = replace(
        recipe.model,
        hand=args.hand or recipe.model.hand,
        aggregation=recipe.model.aggregation and not args.no_aggregation,
        point_fusion=recipe.model.point_fusion and not args.no_point_fusion,
        backbone=replace(recipe.model.backbone, pretrained=args.pretrained),
    )
    if args.epochs is not None and args.epochs < 1:
        raise ValueError(f"--epochs must be at least 1, got {args.epochs}")
    epochs = recipe.epochs if args.epochs is None else args.epochs
    scaled_drop = round(epochs * recipe.drop_epoch / recipe.epochs)
    return replace(
        recipe,
        model=model,
        weights=CODED if args.coded_weights else recipe.weights,
        epochs=epochs,
        drop_epoch=scaled_drop if args.drop_epoch is None else args.drop_epoch,
    )


def run(args: argparse.Namespace) -> int:
    """Run `hadr train`."""
    from hadr.data.transhand import TransHand

    recipe = recipe_from(args)
    parts: dict[str, Any] = {}
    for split in ("train", "val"):
        if split == "train" or (Path(args.data) / split).is_dir():
            found = TransHand(args.data, split, objects=args.objects)
            frames = tqdm(found, f"reading {split}")
            parts[split] = load_frames(frames, recipe.size, args.corruption, args.seed)
    trained = train(
        recipe,
        parts["train"],
        parts.get("val"),
        folder=args.out,
        seed=args.seed,
        data={
            "corruption": args.corruption,
            "objects": sorted(args.objects) if args.objects else "all",
            "frames": {split: len(part) for split, part in parts.items()},
        },
        resume=args.resume,
    )
    last = trained.history[-1]
    print(f"{len(trained.history)} epochs; the checkpoint is {Path(args.out) / LAST}")
    print(", ".join(f"{name} {value:.4g}" for name, value in last.items() if name != "epoch"))
    return 0
