"""Make data sets of hand-held glass in TransHand-14K's layout.

Frame ``i`` depends on the settings and on ``i`` alone: any number of workers gives the same
bytes, a longer run begins with the frames of a shorter one, and a run that was stopped at any
moment goes on where it ended. The settings include Mitsuba's variant, since path-traced bytes
depend on it: all workers use the same one, and one that can't ends the run with its reason.
"""

from __future__ import annotations

import time
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import cast

import cv2
import numpy as np
from threadpoolctl import threadpool_limits
from tqdm import tqdm

import hadr
from hadr.data.frame import write_frame
from hadr.data.frame_pictures import DisparityScale
from hadr.records.processes import check_workers, one_thread, run_tasks
from hadr.synthesis.generation.folder import generation_folder, recorded_settings, whole_frames
from hadr.synthesis.generation.frames import (
    build_scene,
    draw_frame,
    recipe_recording,
    stored_raw_depth,
)
from hadr.synthesis.generation.settings import (
    EDITION,
    MOST_FRAMES,
    FrameRecipe,
    GenerationSettings,
    Variant,
    recipes_by_hold,
)
from hadr.synthesis.glass.objects import glass_object
from hadr.synthesis.rendering.mitsuba_variant import (
    REMEDY,
    SCALAR,
    VARIANT_VARIABLE,
    check_installed,
    check_variant,
    mitsuba_variant,
    wanted_variant,
    why_not_llvm,
)
from hadr.synthesis.textures.backgrounds import check_backgrounds


@dataclass(frozen=True)
class GenerationReport:
    """What a run did: frames written and kept in a folder, and the seconds that it took."""

    root: Path
    written: int
    kept: int
    seconds: float

    def __str__(self) -> str:
        pace = f", {self.seconds / self.written:.2f} s a frame" if self.written else ""
        return f"{self.written} frames written, {self.kept} kept in {self.root}{pace}"


def _make_frames(recipes: tuple[FrameRecipe, ...], root: Path, settings: GenerationSettings) -> int:
    """Make the frames of one hold; how many they are.

    One thread, as in a process of several: OpenBLAS rounds otherwise when it shares a product out.
    """
    single = one_thread(cv2.getNumThreads, cv2.setNumThreads)
    with single, threadpool_limits(1, user_api="blas"):
        for recipe in recipes:
            _make_frame(recipe, root, settings)
    return len(recipes)


def _make_frame(recipe: FrameRecipe, root: Path, settings: GenerationSettings) -> None:
    """Make one frame and write it."""
    try:
        scene = build_scene(recipe, settings)
        frame = draw_frame(scene, recipe, settings)
    except ValueError as error:
        raise ValueError(f"frame {recipe.index}: {error}") from error
    hold, hand = scene.hold, scene.contents.hand
    scale: float | DisparityScale = 0.001
    if frame.raw_depth is not None:
        raw, scale = stored_raw_depth(frame.raw_depth, settings)
        frame = replace(frame, raw_depth=raw)
    log = {
        "object": glass_object(recipe.object_id).name,
        "hold_kind": hold.kind,
        "hand_side": hold.shape.side,
        "hand_scale": round(hold.shape.scale, 4),
        "skin_albedo": [] if hand is None else np.median(hand.albedo, axis=0).round(4).tolist(),
        "engine": settings.engine,
        "generator": f"hadr {hadr.__version__}",
        "edition": EDITION,
    }
    write_frame(
        root,
        frame,
        extra_log=log,
        depth_format=settings.depth_format,
        rest_step=settings.rest_step,
        raw_scale=scale,
        jpeg_quality=settings.jpeg_quality,
        normals=settings.normals,
    )


def _chosen_variant(settings: GenerationSettings, root: Path) -> Variant:
    """The variant asked for, else that of the folder's frames, else the fastest that works."""
    recorded, wanted = recorded_settings(root).get("variant"), wanted_variant()
    variant = settings.variant or wanted or recorded
    if settings.variant is None and recorded not in (None, variant):
        raise ValueError(
            f"{VARIANT_VARIABLE} is {wanted!r}, but the frames in {root} are made with {recorded!r}"
            ": unset it, or choose another folder"
        )
    variant = variant or mitsuba_variant()
    if variant != recorded:  # there may be nothing left to draw
        check_variant(variant)
    return cast(Variant, variant)


def generate(
    root: str | Path,
    n_frames: int,
    settings: GenerationSettings,
    *,
    workers: int = 1,
    progress: bool = False,
) -> GenerationReport:
    """Make a data set, or finish one that was begun.

    Args:
        root: Where it goes; frames that lie there with all their files are kept as they are.
        n_frames: How many frames it shall have.
        settings: What they have in common. Frames of one folder have one variant of Mitsuba; where
            none is named, a new folder gets the fastest that works here.
        workers: Processes that work at the same time.
        progress: Shows a bar with the remaining time.

    Raises:
        ValueError: A value is out of range, something is not installed, a photograph or Mitsuba's
            variant can't be used, the folder holds frames of other settings, or a script asks for
            workers outside of ``if __name__ == "__main__":``.
        OSError: The folder can't be written, the disk is full, or workers died.
    """
    if not 1 <= n_frames <= MOST_FRAMES:
        raise ValueError(f"the number of frames must be from 1 to {MOST_FRAMES}, got {n_frames}")
    check_workers(workers)
    if settings.engine == "photo":
        check_installed()
    start, root, asked = time.perf_counter(), Path(root), settings.variant
    if settings.backgrounds is not None:
        check_backgrounds(settings.backgrounds)
    recipes = [settings.recipe(i) for i in range(n_frames)]
    if settings.recordings is not None:
        for same_hold in recipes_by_hold(recipes):
            recipe_recording(same_hold[0], settings)
    if settings.engine == "photo":
        settings = replace(settings, variant=_chosen_variant(settings, root))
    with generation_folder(root, settings):
        whole = whole_frames(root, recipes, settings)
        todo = [r for r in recipes if r.index not in whole]
        kept = n_frames - len(todo)
        slow = settings.variant == SCALAR and not (asked or wanted_variant())
        if slow and progress and todo:
            why = why_not_llvm()
            why = f"{why}; to become faster, {REMEDY}" if why else f"as all frames in {root}"
            print(f"drawing with Mitsuba's slower variant {SCALAR}: {why}", flush=True)
        make = partial(_make_frames, root=root, settings=settings)
        made = run_tasks(make, recipes_by_hold(todo), workers)
        bar = tqdm(total=n_frames, initial=kept, unit="frame", disable=not progress)
        try:
            with bar, closing(made):
                for _, count in made:
                    bar.update(count)
        except OSError as error:
            written = len(whole_frames(root, todo, settings))
            error.add_note(f"{written} frames were written to {root}, all of them whole")
            raise
    return GenerationReport(root, len(todo), kept, time.perf_counter() - start)
