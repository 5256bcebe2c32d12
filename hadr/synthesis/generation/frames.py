"""Make one frame: its hold, its scene, its picture by one of two engines, and its exact labels."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import numpy.typing as npt

from hadr.camera import project, transform_points
from hadr.data.frame import Frame
from hadr.data.frame_pictures import DisparityScale
from hadr.records.caches import kept_by_file
from hadr.synthesis.depth_sensor.depth_camera import StereoCamera, capture_depth
from hadr.synthesis.generation.presets import Engine, GenerationSettings, Quality
from hadr.synthesis.generation.recipes import FrameRecipe
from hadr.synthesis.glass.objects import NOVEL_OBJECTS, OBJECTS
from hadr.synthesis.holding.hold import Hold, make_hold
from hadr.synthesis.recordings.recording import (
    Recording,
    companions,
    find_recordings,
    read_recording,
)
from hadr.synthesis.rendering.child_process import call_in_child
from hadr.synthesis.rendering.photo import photograph
from hadr.synthesis.scene.backgrounds import find_backgrounds
from hadr.synthesis.scene.scene import Scene, make_scene

#: Seconds for a picture that a reader waits for.
PATIENCE = 300.0

Color = npt.NDArray[np.uint8]


def check_engine(engine: Engine) -> None:
    """Check that what an engine needs is installed.

    Raises:
        ValueError: It is not; the message names what to install.
    """
    for name in ("mitsuba", "pyoidn") if engine == "photo" else ():
        if importlib.util.find_spec(name) is None:
            raise ValueError(
                f"the photo engine needs {name}, which is not installed: pip install "
                "'hadr[generate]', or choose --engine raycast"
            )


def stored_raw_depth(
    raw: npt.NDArray[np.float32], settings: GenerationSettings
) -> tuple[npt.NDArray[np.float32], float | DisparityScale]:
    """Raw depth rounded to what is stored, and the scale to store it with.

    Disparity is stored in steps of 1/16 pixel, beyond 1 m of 1/8 pixel: there a real D435's noise
    is larger than that.
    """
    camera = StereoCamera()
    if settings.raw_format == "depth":
        return raw, float(camera.step)
    scale = DisparityScale(camera.focal * camera.baseline, 1 / 16, camera.step)
    return scale.nearest(raw, double_beyond=1.0), scale


def _number(seed: int, index: int, purpose: int) -> int:
    """A seed of 32 bits for one purpose of one frame."""
    return int(np.random.SeedSequence([seed, index, purpose]).generate_state(1)[0])


def _recordings_by_object(folder: str | Path) -> dict[str, tuple[Path, ...]]:
    """The recordings of each object; most say in their name which it is."""
    found: dict[str, tuple[Path, ...]] = {}
    known = {*OBJECTS, *NOVEL_OBJECTS}
    for path in find_recordings(folder):
        names = [n for n in (path.parent.name, path.stem.split("-")[0]) if n in known]
        object_id = names[0] if names else _object_of(path, *companions(path))
        found[object_id] = (*found.get(object_id, ()), path)
    return found


@kept_by_file(1000)
def _object_of(path: Path, *_: Path) -> str:
    return read_recording(path).object_id


@kept_by_file(4)
def _recording(path: Path, *_: Path) -> Recording:
    return read_recording(path)


def recipe_hold(recipe: FrameRecipe, seed: int, recordings: str | Path | None = None) -> Hold:
    """The holding pose of a frame: made from the seed, or a moment of a recording.

    Args:
        recipe: What the frame shows.
        seed: Seed of the data set.
        recordings: Folder of recordings, or None.

    Raises:
        ValueError: There are fewer recordings of the object than the frame's hold number asks.
    """
    if recordings is None:
        return make_hold(recipe.object_id, recipe.hold_number, seed)
    files = _recordings_by_object(recordings).get(recipe.object_id, ())
    if recipe.hold_number >= len(files):
        raise ValueError(
            f"it needs recording number {recipe.hold_number} of object "
            f"{recipe.object_id}, but {recordings} holds {len(files)} of them"
        )
    path = files[recipe.hold_number]
    recording = _recording(path, *companions(path))
    row = np.random.default_rng([seed, recipe.index, 13]).integers(len(recording.time))
    return recording.at(int(row))


def build_scene(
    recipe: FrameRecipe,
    seed: int,
    width: int,
    height: int,
    quality: Quality,
    *,
    recordings: str | Path | None = None,
    backgrounds: str | Path | None = None,
) -> Scene:
    """The scene of a recipe; the same for the same arguments."""
    hold = recipe_hold(recipe, seed, recordings)
    rng = np.random.default_rng([seed, recipe.index, 3])
    step = 0.004 if quality == "fast" else 0.0025
    if backgrounds is None:
        return make_scene(hold, rng, width, height, hand_step=step)
    photographs = find_backgrounds(backgrounds)
    return make_scene(hold, rng, width, height, hand_step=step, backgrounds=photographs)


def render_frame(
    recipe: FrameRecipe,
    *,
    seed: int = 0,
    width: int = 448,
    height: int = 252,
    quality: Quality = "fine",
    engine: Engine = "raycast",
    samples: int = 8,
    sensor: bool = False,
    recordings: str | Path | None = None,
    backgrounds: str | Path | None = None,
) -> Frame:
    """Make one frame.

    Args:
        recipe: What it shows.
        seed: Seed of the data set.
        width: Image width, pixels.
        height: Image height, pixels; TransHand-14K's pictures are 16:9.
        quality: Of the ray caster: ``fine`` draws shadows and four rays a pixel; ``fast`` one
            ray and no shadows.
        engine: ``raycast``, or ``photo``, which traces paths.
        samples: Paths a pixel of ``photo``.
        sensor: With the raw depth of a simulated depth camera.
        recordings: Folder of recorded holds; None makes the hold from the seed.
        backgrounds: Folder of photographs for the surroundings; None computes textures.

    Returns:
        The frame with exact labels.

    Raises:
        ValueError: A name is unknown, the size too small, or what the engine needs is missing.
    """
    settings = GenerationSettings(
        seed=seed,
        width=width,
        height=height,
        quality=quality,
        engine=engine,
        samples=samples,
        sensor=sensor,
        recordings=None if recordings is None else str(recordings),
        backgrounds=None if backgrounds is None else str(backgrounds),
    )
    check_engine(engine)
    return render_scene(recipe, settings)[1]


def live_picture(
    recipe: FrameRecipe, stored: Color, *, seed: int, width: int, height: int
) -> tuple[Color, str, str]:
    """Trace a picture now, in a child process, or give a stored one where that can't be done.

    Args:
        recipe: What the picture shows.
        stored: The picture to give instead, sRGB, (H, W, 3) uint8.
        seed: Seed of the data set.
        width: Width of the traced picture, pixels.
        height: Its height, pixels.

    Returns:
        The picture, sRGB, (H, W, 3) uint8; its title; and one sentence that says why a stored one
        stands there although Mitsuba is installed, else nothing.
    """
    try:
        check_engine("photo")
    except ValueError:
        return stored, "a stored picture (Mitsuba is not installed here)", ""
    try:
        frame = call_in_child(
            render_frame,
            recipe,
            timeout=PATIENCE,
            seed=seed,
            width=width,
            height=height,
            engine="photo",
        )
    except Exception as error:
        return stored, "a stored picture", f"No picture could be traced here: {error}."
    return frame.color, f"traced just now: {frame.hold_id}", ""


def render_scene(recipe: FrameRecipe, settings: GenerationSettings) -> tuple[Scene, Frame]:
    """Make one frame of a data set, and give the scene that it shows too."""
    scene = build_scene(
        recipe,
        settings.seed,
        settings.width,
        settings.height,
        settings.quality,
        recordings=settings.recordings,
        backgrounds=settings.backgrounds,
    )
    labels = scene.rays.labels(scene.camera, scene.world_from_camera)
    if settings.engine == "photo":
        color = photograph(
            scene,
            seed=_number(settings.seed, recipe.index, 5),
            samples=settings.samples,
            variant=settings.variant,
        )
    else:
        fine = settings.quality == "fine"
        color = scene.rays.picture(
            scene.camera,
            scene.world_from_camera,
            np.random.default_rng([settings.seed, recipe.index, 5]) if fine else None,
            supersample=2 if fine else 1,
        )
    raw = None
    if settings.sensor:
        raw = capture_depth(scene, _number(settings.seed, recipe.index, 7))
    keypoints = transform_points(np.linalg.inv(scene.world_from_camera), scene.keypoints)
    frame = Frame(
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
        raw,
        labels.normals,
        scene.world_from_object,
    )
    return scene, frame
