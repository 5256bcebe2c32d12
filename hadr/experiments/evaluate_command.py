"""`hadr evaluate`: score checkpoints, depth networks beside methods that learn nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from hadr.models.networks import DEPTH_NETWORKS
from hadr.records.option_words import FILE, FOLDER, ID
from hadr.records.output_folder import check_file, check_free
from hadr.records.provenance import provenance
from hadr.records.result_file import write_sealed
from hadr.training.recipe import Given

if TYPE_CHECKING:
    from hadr.experiments.scoring import Scores

EPILOG = """
examples
  A training beside the bundled network, on the bundled test frames:
    hadr evaluate runs/mini/best.safetensors \\
        data_samples/checkpoints/hadr-imagenet.safetensors
  Given what other networks predict, and the tables as a file:
    hadr evaluate runs/mini/best.safetensors --out tables.json \\
        --masks data_samples/checkpoints/segmentation-imagenet.safetensors \\
        --keypoints data_samples/checkpoints/hand-keypoints-imagenet.safetensors

exit status
  0 done   1 the disk is full   2 unusable checkpoint or data, or a wrong call"""


@dataclass(frozen=True)
class Checkpoint:
    """A checkpoint that is scored.

    Attributes:
        name: Its name in the table.
        model: The network.
        meta: Its record.
    """

    name: str
    model: Any
    meta: dict[str, Any]

    @property
    def kind(self) -> str:
        """The network's kind, such as "hadr"."""
        return str(self.meta["network"])

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) at which it works, pixels."""
        return int(self.meta["width"]), int(self.meta["height"])


@dataclass(frozen=True)
class Options:
    """Score checkpoints.

    Depth networks restore at their own size and are scored at 224x126 on the true mask's pixels,
    beside methods that learn nothing; segmentation and keypoint networks have figures of their own.
    """

    checkpoint: tyro.conf.Positional[Annotated[tuple[str, ...], FILE]]
    """Files that `hadr train` wrote."""
    data: Annotated[tuple[Path, ...], FOLDER] = ()
    """Folders in TransHand's layout, joined; the bundled frames where it is left out."""
    split: Literal["train", "val", "test"] = "test"
    """Which frames."""
    objects: Annotated[tuple[str, ...], ID] = ()
    """Score these objects only."""
    given: tyro.conf.OmitArgPrefixes[Given] = field(default_factory=Given)
    out: Annotated[Path | None, FILE] = None
    """File for the tables as JSON, with each frame's RMSE, the standard error, and provenance."""


def depth_table(checkpoints: Sequence[Checkpoint], source: Any, given: Given) -> dict[str, Scores]:
    """Score depth networks and the methods that learn nothing on the same frames."""
    from hadr.experiments.scoring import EVALUATION_SIZE, score_cheap, score_network
    from hadr.training.evaluation import CLASSICAL
    from hadr.training.frames.predicted import load_given

    truth = load_given(source, EVALUATION_SIZE, given, keep_all=True)  # the same at each size
    rows = {name: score_cheap(truth, name) for name in CLASSICAL}
    for one in checkpoints:
        own = load_given(source, one.size, given, keep_all=True)
        rows[one.name] = score_network(one.model, own, truth)
    return rows


def figures(checkpoint: Checkpoint, source: Any, given: Given) -> dict[str, float]:
    """Score a segmentation or keypoint network, at its own size."""
    from hadr.training.frames.batches import load_frames
    from hadr.training.recipe import Preset
    from hadr.training.tasks.task import Task

    width, height = checkpoint.size
    recipe = Preset(
        name="evaluation",
        width=width,
        height=height,
        network=checkpoint.kind,
        model=checkpoint.model.config,
    )
    frames = load_frames(source, checkpoint.size, given.corruption, given.seed)
    found = Task(recipe).validate(checkpoint.model, frames, 8)
    return {name.removeprefix("validation_"): value for name, value in found.items()}


def run(options: Options) -> int:
    """Run `hadr evaluate`."""
    from hadr.data.folder_checks import check_data
    from hadr.data.folders import has_split
    from hadr.data.samples import samples_dir
    from hadr.data.transhand import SPLITS
    from hadr.experiments.scoring import EVALUATION_SIZE
    from hadr.metrics import format_table, mean_over_frames
    from hadr.training.frames.predicted import open_split

    def check() -> None:
        check_file(options.out, split="", given="", frames="")
        check_free(options.out)

    check()
    folders = options.data or (samples_dir() / "frames",)
    check_data(folders, (options.split,), options.objects or None)
    source = open_split(folders, options.split, options.objects or None)
    if source is None:
        there = [one for one in SPLITS if any(has_split(root, one) for root in folders)]
        raise FileNotFoundError(
            f"no folder {options.split} in {', '.join(map(str, folders))}; --split may be "
            f"{' or '.join(there)}"
        )
    given = options.given
    checkpoints = _open(options.checkpoint)
    for one in checkpoints:
        given.check_network(one.kind)
    given.check()
    depth = [one for one in checkpoints if one.kind in DEPTH_NETWORKS]
    content: dict[str, Any] = {
        "split": options.split,
        "objects": options.objects or "all",
        "folders": [Path(folder).name for folder in folders],
        "given": given.record(),
        "frames": len(source),
    }
    if depth:
        rows = depth_table(depth, source, given)
        own = {name: mean_over_frames(s.restored).coverage for name, s in rows.items()}
        means = {
            name: replace(mean_over_frames(scores.frames), coverage=own[name])
            for name, scores in rows.items()
        }
        pooled = {name: scores.pooled for name, scores in rows.items()}
        at = "{}x{}".format(*EVALUATION_SIZE)
        print(
            f"split {options.split}, {len(source)} frames, depth {given.corruption}; scored at "
            f"{at}, a pixel without an answer as those around it, if any\n"
        )
        print(f"mean of the frames' numbers\n{format_table(means)}\n")
        print(f"all pixels pooled\n{format_table(pooled)}\n")
        content["size"] = list(EVALUATION_SIZE)
        holds = source.holds(next(iter(rows.values())).stems)
        content["rows"] = {name: scores.columns(holds) for name, scores in rows.items()}
        content["per_frame"] = {name: scores.per_frame() for name, scores in rows.items()}
    for one in checkpoints:
        if one.kind not in DEPTH_NETWORKS:
            found = figures(one, source, given)
            print(f"{one.name} ({one.kind}): {len(source)} frames, depth {given.corruption}")
            print("\n".join(f"  {name:<24} {value:.4f}" for name, value in found.items()) + "\n")
            content.setdefault("figures", {})[one.name] = {"network": one.kind, **found}
    if options.out:
        check()  # another run may have begun there meanwhile
        write_sealed(options.out, {**content, "provenance": provenance()})
    return 0


def _open(paths: Sequence[str]) -> list[Checkpoint]:
    """Load checkpoints, each under its file's name, with its folders' where that means two."""
    from hadr.training.checkpoints import load_checkpoint
    from hadr.training.evaluation import CLASSICAL

    loaded = [load_checkpoint(path) for path in paths]
    parts = [Path(path).resolve().with_suffix("").parts for path in paths]
    found: list[Checkpoint] = []
    for path, own, (model, meta) in zip(paths, parts, loaded, strict=True):
        for length in range(1, len(own) + 1):
            names = ["/".join(one[-length:]) for one in parts]
            title = "/".join(own[-length:])
            if names.count(title) == 1 and title not in CLASSICAL:
                break
        else:
            raise ValueError(f"the checkpoint {path} is named twice")
        found.append(Checkpoint(title, model, meta))
    return found
