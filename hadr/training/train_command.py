"""`hadr train`: from options to a recipe, frames, and a trained network."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from hadr.models.networks import NETWORKS
from hadr.records.option_words import FILE, FOLDER, ID, NAME, check_range
from hadr.records.output_folder import check_folder
from hadr.records.writing import sole_owner
from hadr.training.recipe import Accelerator, Given, Precision, Preset, Schedule

if TYPE_CHECKING:
    Kind = str
else:
    Kind = tyro.extras.literal_type_from_choices(NETWORKS)

EPILOG = """
what is written into OUT
  last.safetensors   the network after the last epoch, and what --resume needs
  best.safetensors   that with the best score on split val, if there is one
  *.json             how each came about: recipe, data, seed, versions
  history.csv        losses, scores, whether the network sees; a row an epoch
  pictures           restored depth beside the truth, now and then

examples
  Some minutes on the bundled frames:
    hadr train --preset tiny --out runs/tiny
  HADR of the book's tables; frames: hadr generate --preset mini
  --no-sensor --frames 3000 --out frames
    hadr train --preset imagenet --data frames --out runs/hadr
  Go on after it was stopped:
    hadr train --preset tiny --out runs/tiny --resume

exit status
  0 done   1 the disk is full   2 unusable data or a wrong call
  130 interrupted"""


@dataclass(frozen=True)
class Parts:
    """Parts of HADR that are changed or left out; no other network has them."""

    hand: Literal["none", "2d", "xy", "3d"] | None = None
    """The hand feature; 3d where it is left out. xy is the published code's 2D, in metres."""
    no_aggregation: bool = False
    """The backbone's finest scale alone."""
    no_point_fusion: bool = False
    """Raw colour in the voxel features."""
    coded_weights: bool = False
    """Loss weights 0.5 and 10 of probability and normals, not as printed."""


@dataclass(frozen=True)
class Machine:
    """Where the training runs."""

    accelerator: Accelerator = "auto"
    """auto: cuda if any; numbers of a GPU are near to those of a CPU, not equal to them."""
    precision: Precision | None = None
    """Of the forward pass, in place of the preset's."""


@dataclass(frozen=True)
class Options:
    """Train a network on frames in TransHand's layout.

    What is left out follows from the preset of the network.
    """

    out: Annotated[Path, FOLDER]
    """Folder for checkpoints, history and pictures."""
    data: Annotated[tuple[Path, ...] | None, FOLDER] = None
    """Folders in TransHand's layout, joined; the bundled frames where it is left out."""
    network: Kind = "hadr"
    """What to train."""
    preset: Literal["tiny", "mini", "imagenet", "paper"] = "mini"
    """Size of network, pictures and schedule; imagenet is mini with a pretrained encoder."""
    epochs: int | None = None
    """In place of the preset's; the rate's drop moves along."""
    drop_epoch: int | None = None
    """When the rate falls, in place of the preset's."""
    schedule: Schedule | None = None
    """How the rate falls."""
    batch_size: int | None = None
    """Frames in a step."""
    given: tyro.conf.OmitArgPrefixes[Given] = field(default_factory=Given)
    objects: Annotated[tuple[str, ...] | None, ID] = None
    """Train on these objects only."""
    pretrained: Annotated[str | None, NAME] = None
    """Name of published weights to start from."""
    start_from: Annotated[Path | None, FILE] = None
    """Checkpoint of the same network whose weights begin."""
    learning_rate: float | None = None
    """In place of the preset's."""
    keypoint_noise: float | None = None
    """Standard deviation of the error that training keypoints are given, metres."""
    resume: bool = False
    """Go on from the last checkpoint."""
    tensorboard: bool = False
    """Write event files for TensorBoard as well."""
    parts: tyro.conf.OmitArgPrefixes[Parts] = field(default_factory=Parts)
    machine: tyro.conf.OmitArgPrefixes[Machine] = field(default_factory=Machine)


def recipe_from(options: Options) -> Preset:
    """Build the recipe that the options describe.

    Raises:
        ValueError: A number is out of range, or a part of HADR is asked of another network.
    """
    from hadr.models.hadr import HADRConfig
    from hadr.training.losses import CODED
    from hadr.training.presets import preset

    recipe, parts = preset(options.preset, options.network), options.parts
    model: Any = recipe.model
    if isinstance(model, HADRConfig):
        model = replace(
            model,
            hand=parts.hand or model.hand,
            aggregation=model.aggregation and not parts.no_aggregation,
            point_fusion=model.point_fusion and not parts.no_point_fusion,
        )
    elif parts != Parts():
        raise ValueError(
            "--hand, --no-aggregation, --no-point-fusion and --coded-weights are parts of hadr, "
            f"got --network {options.network}"
        )
    epochs = recipe.epochs if options.epochs is None else options.epochs
    if epochs < 1:
        raise ValueError(f"--epochs must be at least 1, got {epochs}")
    given = {
        "schedule": options.schedule,
        "drop_epoch": options.drop_epoch,
        "batch_size": options.batch_size,
        "precision": options.machine.precision,
        "learning_rate": options.learning_rate,
        "keypoint_noise": options.keypoint_noise,
    }
    scaled: dict[str, Any] = {
        "epochs": epochs,
        "warmup_epochs": min(recipe.warmup_epochs, epochs),
        "drop_epoch": round(epochs * recipe.drop_epoch / recipe.epochs),
    }
    return replace(
        recipe,
        model=_pretrained(model, options.pretrained),
        weights=CODED if parts.coded_weights else recipe.weights,
        **scaled | {name: value for name, value in given.items() if value is not None},
    )


def _pretrained(config: Any, name: str | None) -> Any:
    """Name published weights in a configuration."""
    if name is None:
        return config
    if getattr(config, "lite", None):
        raise ValueError(
            f"--pretrained {name} names weights of another encoder: this preset has "
            "EfficientNet-Lite0 with its own; leave it out"
        )
    if hasattr(config, "pretrained"):
        return replace(config, pretrained=name)
    if is_dataclass(backbone := getattr(config, "backbone", None)):
        part: Any = backbone
        return replace(config, backbone=replace(part, pretrained=name))
    raise ValueError(f"{type(config).__name__} knows no published weights, got --pretrained {name}")


def starting_weights(path: str | Path, recipe: Preset) -> Any:
    """Read the network with whose weights a training begins; ValueError for one of another form."""
    from hadr.training.checkpoints import load_checkpoint

    network, meta = load_checkpoint(path)
    if meta["network"] != recipe.network:
        raise ValueError(f"--start-from {path} is a {meta['network']}, expected {recipe.network}")
    form: Any = recipe.model
    stored = type(form).from_dict(meta["model"])
    if getattr(stored, "lite", None) and form.lite:  # its weights are the file's, not ImageNet's
        stored = replace(stored, lite=replace(stored.lite, pretrained=form.lite.pretrained))
    parts = [part.name for part in fields(form)]
    other = [name for name in parts if getattr(form, name) != getattr(stored, name)]
    if other:
        named = ", ".join(other)
        raise ValueError(f"--start-from {path} differs from the preset's network in {named}")
    return network


def with_recorded_drop(recipe: Preset, last: Path) -> Preset:
    """Keep the epoch at which the rate falls where a training is resumed with more epochs."""
    from hadr.training.checkpoints import read_record

    if recipe.schedule != "step":
        return recipe
    drop = (read_record(last).get("preset") or {}).get("drop_epoch")
    return replace(recipe, drop_epoch=drop) if isinstance(drop, int) else recipe


def run(options: Options) -> int:
    """Run `hadr train`."""
    check_folder(options.out)
    with sole_owner(options.out, "hadr train"):
        return _train(options)


def _train(options: Options) -> int:
    from hadr.data.folder_checks import check_data
    from hadr.data.samples import samples_dir
    from hadr.training.checkpoints import read_record
    from hadr.training.frames.predicted import read_split
    from hadr.training.loop import chosen_device, train
    from hadr.training.training_folder import LAST, TrainingFolder

    recipe, given, out = recipe_from(options), options.given, options.out
    for option, number, least, most in (
        ("epochs", recipe.epochs, 1, 100_000),
        ("batch-size", recipe.batch_size, 1, 100_000),
        ("learning-rate", recipe.learning_rate, 1e-9, 10),
    ):
        check_range(option, number, least, most)
    device = chosen_device(options.machine.accelerator)
    if options.tensorboard and importlib.util.find_spec("tensorboard") is None:
        raise ValueError("--tensorboard needs a package that is not here: pip install tensorboard")
    given.check_network(recipe.network)
    given.check()
    if options.start_from and options.resume:
        raise ValueError("--start-from begins a training and --resume goes on with one: name one")
    start = None if options.start_from is None else starting_weights(options.start_from, recipe)
    home = TrainingFolder(out, recipe, given.seed, None)
    if not options.resume:
        home.check_empty()
    else:
        home.check_begun()
        if options.drop_epoch is None:
            recipe = with_recorded_drop(recipe, out / LAST)
    folders = options.data or (samples_dir() / "frames",)
    content = {"frames_sha256": check_data(folders, ("train", "val"), options.objects)}
    if options.resume and "frames_sha256" not in (read_record(out / LAST).get("data") or {}):
        content = {}  # its training began before this was noted
    parts = {
        split: read_split(folders, split, recipe.size, given, options.objects, recipe.network)
        for split in ("train", "val")
    }
    if parts["train"] is None:
        raise FileNotFoundError(f"no folder train in {', '.join(str(f) for f in folders)}")
    trained = train(
        recipe,
        parts["train"],
        parts["val"],
        folder=out,
        seed=given.seed,
        data={
            **given.record(),
            "folders": [folder.name for folder in folders],
            "objects": sorted(options.objects) if options.objects else "all",
            "frames": {split: len(part) for split, part in parts.items() if part is not None},
            "processes": 1,
            "precision": recipe.precision,
            **content,
            **({"start_from": options.start_from.name} if options.start_from else {}),
        },
        start=start,
        resume=options.resume,
        device=device,
        tensorboard=options.tensorboard,
    )
    if len(trained.history) > recipe.epochs:
        print(f"nothing was trained: {recipe.epochs} epochs were asked for, more are there")
    last = trained.history[-1]
    print(f"{len(trained.history)} epochs; the checkpoint is {out / LAST}")
    print(", ".join(f"{name} {value:.4g}" for name, value in last.items() if name != "epoch"))
    return 0
