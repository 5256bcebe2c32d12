"""Make data sets of hand-held glass in TransHand-14K's layout.

Frame ``i`` depends on the seed, on ``i``, on the size and on the list of objects alone: a longer
run begins with the frames of a shorter one, and a run that was stopped goes on where it ended.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Literal

import numpy as np

from hadr import __version__
from hadr.camera import project, transform_points
from hadr.synthesis.holding import make_hold
from hadr.synthesis.objects import OBJECTS, UNKNOWN_OBJECTS, glass_object
from hadr.synthesis.scene import Scene, make_scene
from hadr.synthesis.transhand_frame import Frame, frame_log_path, write_frame

Quality = Literal["fast", "fine"]
SplitBy = Literal["frame", "holding", "object"]

#: Shares of training, validation and testing frames (paper, section IV-A).
_RATIO = (0.7, 0.2, 0.1)
_HOLD_CYCLE = ("train", "train", "test", "train", "val", "train", "train", "train", "val", "train")


@dataclass(frozen=True)
class FrameRecipe:
    """What frame ``index`` of a data set shows.

    Args:
        index: Position in the data set.
        object_id: Which object.
        hold_number: Which of its holding poses.
        split: Where the frame belongs.
    """

    index: int
    object_id: str
    hold_number: int
    split: str

    @property
    def stem(self) -> str:
        """Name of the frame's files."""
        return f"{self.index:06d}"


@dataclass(frozen=True)
class GenerationReport:
    """What a run did.

    Args:
        root: The data set.
        written: Frames made by this run.
        kept: Frames that were there already.
        seconds: Time that it took.
    """

    root: Path
    written: int
    kept: int
    seconds: float

    def __str__(self) -> str:
        pace = f", {self.seconds / self.written:.2f} s a frame" if self.written else ""
        return f"{self.written} frames written, {self.kept} kept in {self.root}{pace}"


def hold_split(hold_number: int) -> str:
    """The split of an object's hold number, in a fixed cycle of ten that keeps 7:2:1.

    A hold's split so never depends on how many frames are made.
    """
    return _HOLD_CYCLE[hold_number % len(_HOLD_CYCLE)]


def frame_recipe(
    index: int,
    *,
    seed: int = 0,
    objects: Sequence[str] | None = None,
    frames_per_hold: int = 2,
    split_by: SplitBy = "holding",
) -> FrameRecipe:
    """Say what frame ``index`` shows.

    Args:
        index: Position in the data set, from 0. Objects alternate.
        seed: Seed of the data set (only a split by frame depends on it).
        objects: The objects to alternate between; all eight where it is left out.
        frames_per_hold: How many frames share a holding pose.
        split_by: ``holding`` and ``frame`` split 7:2:1; ``object`` tests on the unknown objects.

    Returns:
        The recipe.

    Raises:
        ValueError: A value is out of range or an object unknown.
    """
    names = list(OBJECTS) if objects is None else list(objects)
    for name in names:
        glass_object(name)
    if index < 0 or frames_per_hold < 1 or not names:
        raise ValueError(
            f"need index >= 0, frames_per_hold >= 1 and an object, got {index}, {frames_per_hold}, "
            f"{names}"
        )
    object_id = names[index % len(names)]
    hold_number = index // len(names) // frames_per_hold
    if split_by == "holding":
        split = hold_split(hold_number)
    elif split_by == "frame":
        draw = np.random.default_rng([seed, index, 29]).choice(3, p=_RATIO)
        split = ("train", "val", "test")[int(draw)]
    elif split_by == "object":
        split = "test" if object_id in UNKNOWN_OBJECTS else "train"
    else:
        raise ValueError(f"split_by must be 'holding', 'frame' or 'object', got {split_by!r}")
    return FrameRecipe(index, object_id, hold_number, split)


def build_scene(recipe: FrameRecipe, seed: int, width: int, height: int, quality: Quality) -> Scene:
    """The scene of a recipe; the same for the same arguments."""
    hold = make_hold(recipe.object_id, recipe.hold_number, seed)
    rng = np.random.default_rng([seed, recipe.index, 3])
    step = 0.004 if quality == "fast" else 0.0025
    return make_scene(hold, rng, width, height, hand_step=step)


def render_frame(
    recipe: FrameRecipe,
    *,
    seed: int = 0,
    width: int = 448,
    height: int = 252,
    quality: Quality = "fine",
) -> Frame:
    """Make one frame.

    Args:
        recipe: What it shows.
        seed: Seed of the data set.
        width: Image width, pixels.
        height: Image height, pixels; TransHand-14K's pictures are 16:9.
        quality: ``fine`` draws shadows and four rays a pixel; ``fast`` one ray and no shadows.

    Returns:
        The frame with exact labels.

    Raises:
        ValueError: The quality is unknown, or the size is too small.
    """
    if quality not in ("fast", "fine"):
        raise ValueError(f"quality must be 'fast' or 'fine', got {quality!r}")
    if width < 16 or height < 9:
        raise ValueError(f"a frame needs at least 16x9 pixels, got {width}x{height}")
    scene = build_scene(recipe, seed, width, height, quality)
    labels = scene.rays.labels(scene.camera, scene.world_from_camera)
    jitter = np.random.default_rng([seed, recipe.index, 5]) if quality == "fine" else None
    color = scene.rays.picture(
        scene.camera,
        scene.world_from_camera,
        jitter,
        supersample=2 if quality == "fine" else 1,
    )
    keypoints = transform_points(np.linalg.inv(scene.world_from_camera), scene.keypoints)
    return Frame(
        recipe.stem,
        recipe.object_id,
        recipe.split,
        color,
        labels.depth,
        labels.hand_mask,
        labels.object_mask,
        keypoints,
        project(keypoints, scene.camera),
        scene.camera,
        scene.world_from_camera,
        labels.background_depth,
        scene.hold.hold_id,
    )


def _make_frame(
    recipe: FrameRecipe,
    root: Path,
    seed: int,
    width: int,
    height: int,
    quality: Quality,
    depth_format: Literal["npy", "png"],
    jpeg_quality: int | None,
) -> None:
    frame = render_frame(recipe, seed=seed, width=width, height=height, quality=quality)
    log = {"object": OBJECTS[recipe.object_id].name, "generator": f"hadr {__version__}"}
    write_frame(root, frame, extra_log=log, depth_format=depth_format, jpeg_quality=jpeg_quality)


def generate(
    root: str | Path,
    n_frames: int,
    seed: int = 0,
    width: int = 448,
    height: int = 252,
    objects: Sequence[str] | None = None,
    split_by: SplitBy = "holding",
    *,
    frames_per_hold: int = 2,
    quality: Quality = "fine",
    depth_format: Literal["npy", "png"] = "npy",
    jpeg_quality: int | None = None,
    workers: int = 1,
) -> GenerationReport:
    """Make a data set, or finish one that was begun.

    Args:
        root: Where it goes; frames that are complete there are kept as they are.
        n_frames: How many frames it shall have.
        seed: Seed of everything.
        width: Image width, pixels.
        height: Image height, pixels.
        objects: The objects to alternate between; all eight where it is left out.
        split_by: ``holding``, ``frame`` or ``object``.
        frames_per_hold: How many frames share a holding pose.
        quality: ``fine`` or ``fast``.
        depth_format: ``npy`` (float metres) or ``png`` (16-bit, 0.1 mm a step).
        jpeg_quality: Stores colour as JPEG; PNG where it is left out.
        workers: Processes that draw at the same time.

    Returns:
        What was done.

    Raises:
        ValueError: A value is out of range.
    """
    if n_frames < 1 or workers < 1:
        raise ValueError(f"n_frames and workers must be positive, got {n_frames} and {workers}")
    if jpeg_quality is not None and not 1 <= jpeg_quality <= 100:
        raise ValueError(f"jpeg_quality must lie in 1..100, got {jpeg_quality}")
    start, root = time.perf_counter(), Path(root)
    recipes = [
        frame_recipe(
            i, seed=seed, objects=objects, frames_per_hold=frames_per_hold, split_by=split_by
        )
        for i in range(n_frames)
    ]
    todo = [r for r in recipes if not frame_log_path(root, r.split, r.object_id, r.stem).is_file()]
    make = partial(
        _make_frame,
        root=root,
        seed=seed,
        width=width,
        height=height,
        quality=quality,
        depth_format=depth_format,
        jpeg_quality=jpeg_quality,
    )
    if workers == 1 or len(todo) < 2:
        for recipe in todo:
            make(recipe)
    else:
        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
            list(pool.map(make, todo, chunksize=4))
    return GenerationReport(root, len(todo), n_frames - len(todo), time.perf_counter() - start)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``hadr generate``."""
    parser.add_argument("root", type=Path, help="folder of the data set; continued where it exists")
    parser.add_argument("-n", "--frames", type=int, default=64, help="number of frames (64)")
    parser.add_argument("--seed", type=int, default=0, help="seed of everything (0)")
    parser.add_argument("--width", type=int, default=448, help="image width in pixels (448)")
    parser.add_argument("--height", type=int, default=252, help="image height in pixels (252)")
    parser.add_argument("--objects", nargs="+", metavar="ID", help="objects, e.g. 0000 0004 (all)")
    parser.add_argument(
        "--split-by",
        choices=("holding", "frame", "object"),
        default="holding",
        help="what a split keeps together: a holding pose, nothing but the frame (which leaks "
        "near-twins), or the object with 0004 and 0007 for testing (holding)",
    )
    parser.add_argument(
        "--frames-per-hold", type=int, default=2, help="frames per holding pose (2)"
    )
    parser.add_argument(
        "--quality",
        choices=("fine", "fast"),
        default="fine",
        help="fine: four rays a pixel and soft shadows; fast: one, for training (fine)",
    )
    parser.add_argument(
        "--depth",
        choices=("npy", "png"),
        default="npy",
        help="depth as float metres (npy) or 16-bit in 0.1 mm steps (png) (npy)",
    )
    parser.add_argument(
        "--jpeg", type=int, metavar="QUALITY", help="store colour as JPEG, 1..100 (PNG)"
    )
    parser.add_argument("--workers", type=int, default=1, help="processes (1)")


def run(args: argparse.Namespace) -> int:
    """Carry out ``hadr generate``; returns the exit code."""
    report = generate(
        args.root,
        args.frames,
        args.seed,
        args.width,
        args.height,
        args.objects,
        args.split_by,
        frames_per_hold=args.frames_per_hold,
        quality=args.quality,
        depth_format=args.depth,
        jpeg_quality=args.jpeg,
        workers=args.workers,
    )
    print(report)
    return 0
