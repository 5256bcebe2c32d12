"""`hadr evaluate`: score checkpoints, depth networks beside methods that learn nothing."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hadr.experiments.scoring import EVALUATION_SIZE, Scores, score_cheap, score_network
from hadr.metrics import format_table, mean_over_frames
from hadr.records.output_folder import check_writable
from hadr.records.provenance import provenance, write_json
from hadr.trained_networks import TITLES
from hadr.training.batches import FrameTensors, load_frames
from hadr.training.checkpoints import load_checkpoint
from hadr.training.evaluation import BASELINES
from hadr.training.predicted import Given, with_predicted
from hadr.training.recipe import Preset
from hadr.training.tasks.table import task_of
from hadr.training.train_command import add_given, given_from, open_split

DEPTH_NETWORKS = tuple(TITLES)


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


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `hadr evaluate`."""
    parser.description = (
        "Score checkpoints. Depth networks restore at their own size and are scored at "
        f"{EVALUATION_SIZE[0]}x{EVALUATION_SIZE[1]} on the true mask's pixels, beside methods that "
        "learn nothing; segmentation and keypoint networks have figures of their own."
    )
    parser.add_argument("checkpoint", nargs="+", help="files that `hadr train` wrote")
    parser.add_argument(
        "--data",
        nargs="+",
        metavar="DIR",
        help="folders in TransHand's layout, joined; the bundled frames where it is left out",
    )
    parser.add_argument(
        "--split", default="test", choices=("train", "val", "test"), help="which frames (test)"
    )
    parser.add_argument("--objects", nargs="+", metavar="ID", help="score these objects only")
    add_given(parser)
    parser.add_argument("--seed", type=int, default=0, help="seed of the analytic corruption (0)")
    parser.add_argument("--out", help="write the tables as JSON with their provenance")


def depth_table(checkpoints: Sequence[Checkpoint], source: Any, given: Given) -> dict[str, Scores]:
    """Score depth networks and the methods that learn nothing on the same frames.

    Args:
        checkpoints: The networks.
        source: The frames, by their number.
        given: The corruption, and true or predicted masks and keypoints.

    Returns:
        The scores by the method's name.
    """
    truth = _load(source, EVALUATION_SIZE, given)
    rows = {name: score_cheap(truth, name) for name in BASELINES}
    for one in checkpoints:
        rows[one.name] = score_network(one.model, _load(source, one.size, given), truth)
    return rows


def figures(checkpoint: Checkpoint, source: Any, given: Given) -> dict[str, float]:
    """Score a segmentation or keypoint network, at its own size.

    Args:
        checkpoint: The network.
        source: The frames, by their number.
        given: The corruption of the depth.

    Returns:
        Its task's figures by name.
    """
    width, height = checkpoint.size
    recipe = Preset(
        name="evaluation",
        width=width,
        height=height,
        network=checkpoint.kind,
        model=checkpoint.model.config,
    )
    frames = load_frames(source, checkpoint.size, given.corruption, given.seed)
    found = task_of(recipe).validate(checkpoint.model, frames, 8)
    return {name.removeprefix("validation_"): value for name, value in found.items()}


def run(args: argparse.Namespace) -> int:
    """Run `hadr evaluate`."""
    from hadr.data.samples import samples_dir

    check_writable(args.out)
    folders = args.data or [samples_dir() / "frames"]
    source = open_split(folders, args.split, args.objects)
    if source is None:
        raise FileNotFoundError(f"no folder {args.split} in {', '.join(map(str, folders))}")
    given = given_from(args)
    checkpoints = _open(args.checkpoint)
    for one in checkpoints:
        given.check_network(one.kind)
    given.check()
    depth = [one for one in checkpoints if one.kind in DEPTH_NETWORKS]
    content: dict[str, Any] = {
        "split": args.split,
        "objects": args.objects or "all",
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
        pooled = {name: replace(scores.pooled, coverage=own[name]) for name, scores in rows.items()}
        print(f"split {args.split}, {len(source)} frames, depth {given.corruption}\n")
        print(f"mean of the frames' numbers\n{format_table(means)}\n")
        print(f"all pixels pooled\n{format_table(pooled)}\n")
        content["size"] = list(EVALUATION_SIZE)
        content["rows"] = {name: scores.columns() for name, scores in rows.items()}
        content["per_frame"] = {name: scores.per_frame() for name, scores in rows.items()}
    for one in checkpoints:
        if one.kind not in DEPTH_NETWORKS:
            found = figures(one, source, given)
            print(f"{one.name} ({one.kind}): {len(source)} frames, depth {given.corruption}")
            print("\n".join(f"  {name:<24} {value:.4f}" for name, value in found.items()) + "\n")
            content.setdefault("figures", {})[one.name] = {"network": one.kind, **found}
    if args.out:
        write_json(Path(args.out), {**content, "provenance": provenance()})
    return 0


def _load(source: Any, size: tuple[int, int], given: Given) -> FrameTensors:
    """All frames, so that they are the same ones at each size."""
    frames = load_frames(source, size, given.corruption, given.seed, keep_all=True)
    return with_predicted(frames, source, given)


def _open(paths: Sequence[str]) -> list[Checkpoint]:
    """Load checkpoints, each under its file's name, or its folder's too where names recur."""
    found: list[Checkpoint] = []
    short = [Path(path).stem for path in paths]
    for path, name in zip(map(Path, paths), short, strict=True):
        model, meta = load_checkpoint(path)
        title = name if short.count(name) == 1 else f"{path.parent.name}/{name}"
        found.append(Checkpoint(title, model, meta))
    return found
