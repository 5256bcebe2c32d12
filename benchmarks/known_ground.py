"""Does a checkpoint know where its ground ends? Frames unlike its training, made and measured.

    python benchmarks/known_ground.py draw DIR [--part dev|report] [--sets far near ...]
    python benchmarks/known_ground.py measure DIR [--part report] [--out FILE]

`draw` makes path-traced frames like the samples, of other seeds, and the same with one thing
changed; frames that are there are kept. `measure` restores them.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from hadr.camera import project, transform_points
from hadr.data.frame import Frame, frame_log_path, write_frame
from hadr.synthesis.depth_sensor.depth_camera import StereoCamera, capture_depth
from hadr.synthesis.depth_sensor.infrared import Projector
from hadr.synthesis.generation.frames import build_scene
from hadr.synthesis.generation.settings import FrameRecipe, GenerationSettings
from hadr.synthesis.glass.surfaces import Surface
from hadr.synthesis.hand.mesh import HandMesh
from hadr.synthesis.rendering.photo import photograph
from hadr.synthesis.rendering.shading import RayTracer
from hadr.synthesis.scene.scene import HoldScene

SMALL = ("far", "near", "lens")
"""Drawn at the size at which the networks see them, which is faster."""
Change = Callable[[HoldScene, np.random.Generator], HoldScene]
SETTINGS = GenerationSettings(engine="photo", sensor=True, frames_per_hold=1)
SEEDS = {"dev": 4001, "report": 4002}
FRAMES = {"dev": 12, "report": 20}
#: A coarse stereo camera: short baseline, few and weak dots, noisy imagers.
COARSE = StereoCamera(
    baseline=0.02, noise=4.0, step=0.005, projector=Projector(dots=2500, strength=1.5)
)


def at_distance(least: float, most: float) -> Change:
    """Move the camera along its line to the glass, which stands at the world's origin, metres."""

    def change(scene: HoldScene, rng: np.random.Generator) -> HoldScene:
        pose = scene.world_from_camera.copy()
        pose[:3, 3] *= rng.uniform(least, most) / np.linalg.norm(pose[:3, 3])
        return replace(scene, world_from_camera=pose)

    return change


def other_lens(scene: HoldScene, rng: np.random.Generator) -> HoldScene:
    """A wide or a long lens at the same place."""
    factor = rng.uniform(0.5, 0.7) if rng.random() < 0.5 else rng.uniform(1.4, 1.7)
    camera = scene.camera
    return replace(scene, camera=replace(camera, fx=camera.fx * factor, fy=camera.fy * factor))


def without_hand(scene: HoldScene, _: np.random.Generator) -> HoldScene:
    """The glass hangs in the air; the keypoints stay."""
    return replace(scene, contents=replace(scene.contents, hand=None))


def elsewhere(scene: HoldScene, rng: np.random.Generator) -> HoldScene:
    """The hand, or a second one that is taken for it, is 15 to 45 cm away from the glass."""
    way = rng.normal(size=3)
    way = rng.uniform(0.15, 0.45) * way / np.linalg.norm(way)
    moved = np.eye(4)
    moved[:3, 3] = scene.world_from_camera[:3, :3] @ way
    hand = scene.contents.hand
    assert hand is not None
    there = replace(hand, surface=hand.surface.moved(moved))
    if rng.random() < 0.5:
        there = joined(hand, there)
    return replace(
        scene,
        contents=replace(scene.contents, hand=there),
        keypoints=transform_points(moved, scene.keypoints),
    )


def opaque(scene: HoldScene, rng: np.random.Generator) -> HoldScene:
    """The glass is painted: a matt thing of the same form."""
    paint = rng.uniform(0.08, 0.75, size=3)
    hand = scene.contents.hand
    assert hand is not None
    for body in scene.contents.glass:
        count = len(body.vertices)
        hand = joined(hand, HandMesh(body, np.tile(paint, (count, 1)), np.full(count, 0.2)))
    return replace(scene, contents=replace(scene.contents, hand=hand, glass=()))


def joined(one: HandMesh, other: HandMesh) -> HandMesh:
    """Two opaque surfaces as one."""
    a, b = one.surface, other.surface
    faces = np.concatenate((a.faces, b.faces + len(a.vertices)))
    return HandMesh(
        Surface(
            np.concatenate((a.vertices, b.vertices)), faces, np.concatenate((a.normals, b.normals))
        ),
        np.concatenate((one.albedo, other.albedo)),
        np.concatenate((one.gloss, other.gloss)),
    )


def unchanged(scene: HoldScene, _: np.random.Generator) -> HoldScene:
    """As it is."""
    return scene


SETS: dict[str, Change] = {
    "inside": unchanged,
    "far": at_distance(1.15, 1.7),
    "near": at_distance(0.22, 0.36),
    "lens": other_lens,
    "no-hand": without_hand,
    "elsewhere": elsewhere,
    "sensor": unchanged,
    "opaque": opaque,
}


def drawn(name: str, part: str, number: int) -> Frame:
    """Make one frame."""
    settings = replace(SETTINGS, seed=SEEDS[part] + 10 * list(SETS).index(name))
    if name in SMALL:
        settings = replace(settings, width=256, height=144)
    recipe: FrameRecipe = replace(settings.recipe(number), split="test")
    plain = build_scene(recipe, settings)
    scene = SETS[name](plain, np.random.default_rng([settings.seed, number, 99]))
    # A painted glass has the labels of the glass.
    labelled = replace(scene, contents=plain.contents) if name == "opaque" else scene
    labels = RayTracer(labelled.contents).labels(scene.camera, scene.world_from_camera)
    keypoints = transform_points(np.linalg.inv(scene.world_from_camera), scene.keypoints)
    return Frame(
        recipe.stem,
        recipe.object_id,
        recipe.split,
        photograph(scene, seed=settings.seed + number, samples=settings.samples),
        labels.depth,
        labels.hand_mask,
        labels.object_mask,
        keypoints,
        project(keypoints, scene.camera),
        scene.camera,
        scene.world_from_camera,
        labels.background_depth,
        scene.hold.hold_id,
        capture_depth(scene, settings.seed + number, COARSE if name == "sensor" else None),
        world_from_object=scene.world_from_object,
    )


def draw(folder: Path, part: str, names: list[str]) -> None:
    """Make the frames that are not there."""
    for name in names:
        for number in range(FRAMES[part]):
            recipe = SETTINGS.recipe(number)
            root = folder / part / name
            if not frame_log_path(root, "test", recipe.object_id, recipe.stem).exists():
                write_frame(root, drawn(name, part, number), normals="none", depth_format="png")
                print(part, name, number, flush=True)


def main() -> None:
    """Run the script."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task", choices=["draw", "measure"])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--part", choices=list(SEEDS), default="report")
    parser.add_argument("--sets", nargs="+", choices=list(SETS), default=list(SETS))
    args = parser.parse_args()
    if args.task == "draw":
        draw(args.folder, args.part, args.sets)


if __name__ == "__main__":
    main()
