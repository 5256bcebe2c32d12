"""Make one frame: its hold, its scene, its picture by one of two engines, and its exact labels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from hadr.camera import project, transform_points
from hadr.data.frame import Frame
from hadr.data.frame_pictures import DisparityScale
from hadr.records.caches import kept_by_file
from hadr.synthesis.depth_sensor.depth_camera import StereoCamera, capture_depth
from hadr.synthesis.generation.settings import FrameRecipe, GenerationSettings
from hadr.synthesis.holding.hold import Hold, make_hold
from hadr.synthesis.recordings.recording import (
    Recording,
    companions,
    find_recordings,
    read_recording,
)
from hadr.synthesis.rendering.photo import photograph
from hadr.synthesis.rendering.raycast import Labels
from hadr.synthesis.rendering.shading import RayTracer
from hadr.synthesis.scene.scene import HoldScene, make_scene
from hadr.synthesis.textures.backgrounds import find_backgrounds

Color = npt.NDArray[np.uint8]


def stored_raw_depth(
    raw: npt.NDArray[np.float32], settings: GenerationSettings
) -> tuple[npt.NDArray[np.float32], float | DisparityScale]:
    """Raw depth rounded to what is stored, and the scale to store it with."""
    camera = StereoCamera()
    if settings.raw_format == "depth":
        return raw, float(camera.step)
    # Beyond 1 m steps of disparity are twice as long: there a real D435's noise is larger.
    scale = DisparityScale(camera.focal * camera.baseline, 1 / 16, camera.step)
    return scale.nearest(raw, double_beyond=1.0), scale


def _number(seed: int, index: int, purpose: int) -> int:
    """A seed of 32 bits for one purpose of one frame."""
    return int(np.random.SeedSequence([seed, index, purpose]).generate_state(1)[0])


def _recordings_by_object(folder: str | Path) -> dict[str, tuple[Path, ...]]:
    """The recordings of each object, as they say themselves: a file's name may be anything."""
    found: dict[str, tuple[Path, ...]] = {}
    for path in find_recordings(folder):
        object_id = _recording(path, *companions(path)).object_id
        found[object_id] = (*found.get(object_id, ()), path)
    return found


@kept_by_file(1000)
def _recording(path: Path, *_: Path) -> Recording:
    return read_recording(path)


def recipe_recording(recipe: FrameRecipe, settings: GenerationSettings) -> Recording:
    """The recording of which a frame shows a moment; a ``ValueError`` where there is none."""
    folder = settings.recordings or ""
    files = _recordings_by_object(folder).get(recipe.object_id, ())
    if recipe.hold_number >= len(files):
        raise ValueError(
            f"frame {recipe.index} needs recording number {recipe.hold_number} of object "
            f"{recipe.object_id}, but {folder} holds {len(files)} of them"
        )
    path = files[recipe.hold_number]
    return _recording(path, *companions(path))


def recipe_hold(recipe: FrameRecipe, settings: GenerationSettings) -> Hold:
    """The holding pose of a frame: made from the seed, or a moment of a recording."""
    if settings.recordings is None:
        return make_hold(recipe.object_id, recipe.hold_number, settings.seed)
    recording = recipe_recording(recipe, settings)
    row = np.random.default_rng([settings.seed, recipe.index, 13]).integers(len(recording.time))
    return recording.at(int(row))


def build_scene(recipe: FrameRecipe, settings: GenerationSettings) -> HoldScene:
    """The scene that a frame shows."""
    backgrounds = settings.backgrounds
    return make_scene(
        recipe_hold(recipe, settings),
        np.random.default_rng([settings.seed, recipe.index, 3]),
        settings.width,
        settings.height,
        hand_step=0.004 if settings.quality == "fast" else 0.0025,
        backgrounds=() if backgrounds is None else find_backgrounds(backgrounds),
    )


def draw_frame(scene: HoldScene, recipe: FrameRecipe, settings: GenerationSettings) -> Frame:
    """The frame of a scene: its picture, its exact labels and perhaps its raw depth."""
    tracer = RayTracer(scene.contents)
    labels = tracer.labels(scene.camera, scene.world_from_camera)
    if settings.engine == "photo":
        seed, samples = _number(settings.seed, recipe.index, 5), settings.samples
        color = photograph(scene, seed=seed, samples=samples, variant=settings.variant)
    else:
        fine = settings.quality == "fine"
        rng = np.random.default_rng([settings.seed, recipe.index, 5]) if fine else None
        color = tracer.picture(scene.camera, scene.world_from_camera, rng)
    seed = _number(settings.seed, recipe.index, 7)
    raw = capture_depth(scene, seed) if settings.sensor else None
    return frame_of(scene, recipe, color, labels, raw)


def frame_of(
    scene: HoldScene,
    recipe: FrameRecipe,
    color: Color,
    labels: Labels,
    raw_depth: npt.NDArray[np.float32] | None,
) -> Frame:
    """Put a frame together from what was drawn of its scene."""
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
        raw_depth,
        labels.normals,
        scene.world_from_object,
    )


def render_frame(recipe: FrameRecipe, settings: GenerationSettings) -> Frame:
    """Make one frame with exact labels; the same for the same arguments."""
    return draw_frame(build_scene(recipe, settings), recipe, settings)
