"""`hadr train`: from arguments to a recipe, frames, and a trained network."""

from __future__ import annotations

import argparse
import importlib.util
import json
from collections.abc import Sequence
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any, get_args

from lightning_fabric import Fabric
from torch.utils.data import ConcatDataset

from hadr.models.hadr import HADRConfig
from hadr.models.networks import NETWORKS
from hadr.records.output_folder import check_folder
from hadr.training.accelerator import add_accelerator, chosen_accelerator
from hadr.training.batches import CORRUPTIONS, FrameTensors, load_frames
from hadr.training.loop import LAST, train
from hadr.training.losses import CODED
from hadr.training.predicted import Given, with_predicted
from hadr.training.presets import preset
from hadr.training.recipe import Preset, Schedule
from hadr.training.training_folder import TrainingFolder

PRECISIONS = ("32-true", "bf16-mixed")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `hadr train`."""
    parser.add_argument("--out", required=True, help="folder for checkpoints, history and pictures")
    parser.add_argument(
        "--data",
        nargs="+",
        metavar="DIR",
        help="folders in TransHand's layout, joined; the bundled frames where it is left out",
    )
    parser.add_argument(
        "--network", default="hadr", choices=tuple(NETWORKS), help="what to train (hadr)"
    )
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
    parser.add_argument("--schedule", choices=get_args(Schedule), help="how the rate falls")
    parser.add_argument("--batch-size", type=int, help="frames in a step of each process")
    add_given(parser)
    parser.add_argument("--objects", nargs="+", metavar="ID", help="train on these objects only")
    parser.add_argument("--pretrained", metavar="NAME", help="published weights to start from")
    parser.add_argument(
        "--start-from", metavar="FILE", help="checkpoint of the same network whose weights begin"
    )
    parser.add_argument("--learning-rate", type=float, help="instead of the preset's")
    parser.add_argument(
        "--keypoint-noise",
        type=float,
        metavar="METRES",
        help="standard deviation of the error that training keypoints are given (0)",
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of everything (0)")
    parser.add_argument("--resume", action="store_true", help="go on from the last checkpoint")
    parser.add_argument("--tensorboard", action="store_true", help="write event files as well")
    ablation = parser.add_argument_group("parts of HADR")
    ablation.add_argument("--hand", choices=("none", "2d", "3d"), help="the hand feature")
    ablation.add_argument(
        "--no-aggregation", action="store_true", help="the backbone's finest scale alone"
    )
    ablation.add_argument(
        "--no-point-fusion", action="store_true", help="raw colour in the voxel features"
    )
    ablation.add_argument(
        "--coded-weights", action="store_true", help="loss weights 0.5 and 10, not as printed"
    )
    machine = parser.add_argument_group("machine")
    machine.add_argument("--devices", type=int, default=1, help="processes on this machine (1)")
    add_accelerator(machine)
    machine.add_argument(
        "--precision", choices=PRECISIONS, help="of the forward pass (the preset's)"
    )


def add_given(parser: argparse.ArgumentParser) -> None:
    """Add what a network is given: the depth's corruption, masks and keypoints."""
    parser.add_argument(
        "--corruption",
        default="oracle",
        choices=tuple(CORRUPTIONS),
        help="oracle: no depth in the object's mask; analytic: a stereo camera imitated by "
        "formulas; sensor: the frames' raw depth; erased: the same but none in the mask (oracle)",
    )
    for name, what in (("masks", "segmentation"), ("keypoints", "hand-keypoints")):
        parser.add_argument(
            f"--{name}",
            default="true",
            metavar="FILE",
            help=f"'true', or a {what} checkpoint whose predictions are given (true)",
        )


def given_from(args: argparse.Namespace) -> Given:
    """Read the arguments of `add_given`."""
    return Given(args.corruption, args.masks, args.keypoints, args.seed)


def recipe_from(args: argparse.Namespace) -> Preset:
    """Build the recipe that the arguments of `hadr train` describe.

    Raises:
        ValueError: A number is out of range, or a part of HADR is asked of another network.
    """
    recipe = preset(args.preset, args.network)
    model: Any = recipe.model
    if isinstance(model, HADRConfig):
        model = replace(
            model,
            hand=args.hand or model.hand,
            aggregation=model.aggregation and not args.no_aggregation,
            point_fusion=model.point_fusion and not args.no_point_fusion,
        )
    elif args.hand or args.no_aggregation or args.no_point_fusion or args.coded_weights:
        raise ValueError(
            "--hand, --no-aggregation, --no-point-fusion and --coded-weights are parts of hadr, "
            f"got --network {args.network}"
        )
    if args.epochs is not None and args.epochs < 1:
        raise ValueError(f"--epochs must be at least 1, got {args.epochs}")
    epochs = recipe.epochs if args.epochs is None else args.epochs
    scaled_drop = round(epochs * recipe.drop_epoch / recipe.epochs)
    return replace(
        recipe,
        model=_pretrained(model, args.pretrained),
        weights=CODED if args.coded_weights else recipe.weights,
        epochs=epochs,
        warmup_epochs=min(recipe.warmup_epochs, epochs),
        schedule=args.schedule or recipe.schedule,
        drop_epoch=scaled_drop if args.drop_epoch is None else args.drop_epoch,
        batch_size=recipe.batch_size if args.batch_size is None else args.batch_size,
        precision=args.precision or recipe.precision,
        learning_rate=(recipe.learning_rate if args.learning_rate is None else args.learning_rate),
        keypoint_noise=(
            recipe.keypoint_noise if args.keypoint_noise is None else args.keypoint_noise
        ),
    )


def _pretrained(config: Any, name: str | None) -> Any:
    """Name published weights in a configuration."""
    if name is None:
        return config
    if hasattr(config, "pretrained"):
        return replace(config, pretrained=name)
    if is_dataclass(backbone := getattr(config, "backbone", None)):
        part: Any = backbone
        return replace(config, backbone=replace(part, pretrained=name))
    raise ValueError(f"{type(config).__name__} knows no published weights, got --pretrained {name}")


def open_split(
    folders: Sequence[str | Path], split: str, objects: Sequence[str] | None = None
) -> ConcatDataset[Any] | None:
    """Open a split of some data folders, joined; None where none of them has it.

    Raises:
        FileNotFoundError: An object is missing.
    """
    from hadr.data.transhand import TransHand

    there = [Path(folder) for folder in folders if (Path(folder) / split).is_dir()]
    if not there:
        return None
    opened: list[Any] = [TransHand(folder, split, objects) for folder in there]
    return ConcatDataset(opened)


def read_split(
    folders: Sequence[str | Path],
    split: str,
    size: tuple[int, int],
    given: Given,
    objects: Sequence[str] | None = None,
    *,
    progress: bool = True,
) -> FrameTensors | None:
    """Read a split of some data folders, joined; None where none of them has it."""
    found = open_split(folders, split, objects)
    if found is None:
        return None
    bar = f"reading {split}" if progress else None
    frames = load_frames(found, size, given.corruption, given.seed, progress=bar)
    return with_predicted(frames, found, given)


def starting_weights(path: str | Path, recipe: Preset) -> Any:
    """Read the network whose weights a training begins with.

    Raises:
        FileNotFoundError: There is no such checkpoint.
        ValueError: It is of another network, or of the same kind in another form.
    """
    from hadr.training.checkpoints import load_checkpoint

    network, meta = load_checkpoint(path)
    if meta["network"] != recipe.network:
        raise ValueError(f"--start-from {path} is a {meta['network']}, expected {recipe.network}")
    form: Any = recipe.model
    stored = type(form).from_dict(meta["model"])
    parts = [part.name for part in fields(form)]
    other = [name for name in parts if getattr(form, name) != getattr(stored, name)]
    if other:
        named = ", ".join(other)
        raise ValueError(f"--start-from {path} differs from the preset's network in {named}")
    return network


def with_recorded_drop(recipe: Preset, folder: Path) -> Preset:
    """Keep the epoch at which the rate falls where a training is resumed with more epochs."""
    record = (folder / LAST).with_suffix(".json")
    if recipe.schedule != "step" or not record.is_file():
        return recipe
    stored = json.loads(record.read_text(encoding="utf-8")).get("preset", {}).get("drop_epoch")
    return recipe if stored is None else replace(recipe, drop_epoch=stored)


def run(args: argparse.Namespace) -> int:
    """Run `hadr train`."""
    from hadr.data.samples import samples_dir

    recipe = recipe_from(args)
    given = given_from(args)
    if args.devices < 1:
        raise ValueError(f"--devices must be at least 1, got {args.devices}")
    if args.seed < 0:
        raise ValueError(f"--seed must be at least 0, got {args.seed}")
    accelerator = chosen_accelerator(args.accelerator)
    if args.tensorboard and importlib.util.find_spec("tensorboard") is None:
        raise ValueError("--tensorboard needs a package that is not here: pip install tensorboard")
    given.check_network(recipe.network)
    given.check()
    if args.start_from and args.resume:
        raise ValueError("--start-from begins a training and --resume goes on with one: name one")
    start = None if args.start_from is None else starting_weights(args.start_from, recipe)
    check_folder(args.out)
    if args.resume and args.drop_epoch is None:
        recipe = with_recorded_drop(recipe, Path(args.out))
    elif not args.resume:
        TrainingFolder(Path(args.out), recipe, args.seed, None).check_empty()
    fabric = Fabric(accelerator=accelerator, devices=args.devices, precision=recipe.precision)
    fabric.launch()
    folders = args.data or [samples_dir() / "frames"]
    parts = {
        split: read_split(
            folders, split, recipe.size, given, args.objects, progress=fabric.is_global_zero
        )
        for split in ("train", "val")
    }
    if parts["train"] is None:
        raise FileNotFoundError(f"no folder train in {', '.join(str(f) for f in folders)}")
    trained = train(
        recipe,
        parts["train"],
        parts["val"],
        folder=args.out,
        seed=args.seed,
        data={
            **given.record(),
            "folders": [Path(folder).name for folder in folders],
            "objects": sorted(args.objects) if args.objects else "all",
            "frames": {split: len(part) for split, part in parts.items() if part is not None},
            "processes": fabric.world_size,
            "precision": recipe.precision,
            **({"start_from": Path(args.start_from).name} if args.start_from else {}),
        },
        start=start,
        resume=args.resume,
        fabric=fabric,
        tensorboard=args.tensorboard,
    )
    if fabric.is_global_zero:
        last = trained.history[-1]
        print(f"{len(trained.history)} epochs; the checkpoint is {Path(args.out) / LAST}")
        print(", ".join(f"{name} {value:.4g}" for name, value in last.items() if name != "epoch"))
    return 0
