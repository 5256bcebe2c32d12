"""Does a checkpoint know where its ground ends? Frames unlike its training, made and measured.

    python benchmarks/cameras/known_ground.py draw DIR [--part dev|report] [--sets far near ...]
    python benchmarks/cameras/known_ground.py measure DIR [--part report] [--out FILE]

`draw` makes path-traced frames like the samples, of other seeds, and the same with one thing
changed; frames that are there are kept. `measure` restores them.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import real_frames as real
from scipy import ndimage

from hadr.camera import Intrinsics, transform_points
from hadr.camera_file import load_intrinsics
from hadr.confidence.calibration import TOLERANCE_M
from hadr.confidence.known_ground import BEYOND
from hadr.data.frame import Frame, frame_log_path, write_frame
from hadr.data.samples import open_gallery, open_samples, samples_dir
from hadr.data.transhand import TransHand
from hadr.frame_checks import told_color
from hadr.models.hand.plausible import NoHandError, check_hand
from hadr.records.provenance import provenance
from hadr.records.result_file import write_result_file
from hadr.synthesis.depth_sensor.depth_camera import StereoCamera, capture_depth
from hadr.synthesis.depth_sensor.infrared import Projector
from hadr.synthesis.generation.frames import build_scene, frame_of
from hadr.synthesis.generation.settings import FrameRecipe, GenerationSettings
from hadr.synthesis.glass.surfaces import merged
from hadr.synthesis.hand.mesh import HandMesh
from hadr.synthesis.rendering.photo import photograph
from hadr.synthesis.rendering.shading import RayTracer
from hadr.synthesis.scene.scene import HoldScene
from hadr.trained_finders import HandKeypoints, Segmentation
from hadr.trained_networks import DepthNetwork

SLIGHT = ("mask wider by 2 px", "the mask without its upper quarter")
"""Masks so near to the right one that they count as neither inside nor outside."""
Change = Callable[[HoldScene, np.random.Generator], HoldScene]
SETTINGS = GenerationSettings(engine="photo", sensor=True, frames_per_hold=1, width=320, height=180)
SEEDS = {"dev": 4001, "report": 4002}
FRAMES = {"dev": 12, "report": 20}
#: A coarse stereo camera: short baseline, few and weak dots, noisy imagers.
COARSE = StereoCamera(
    baseline=0.02, noise=4.0, step=0.005, projector=Projector(dots=2500, strength=1.5)
)


def moved(scene: HoldScene, distance: float) -> HoldScene:
    """Move the camera along its line to the glass, which stands at the world's origin, metres."""
    pose = scene.world_from_camera.copy()
    pose[:3, 3] *= distance / np.linalg.norm(pose[:3, 3])
    return replace(scene, world_from_camera=pose)


def at_distance(least: float, most: float) -> Change:
    """Move the camera to a distance from the glass, metres."""
    return lambda scene, rng: moved(scene, rng.uniform(least, most))


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
    pose, way = scene.world_from_camera, np.full(3, -1.0)
    depth = transform_points(np.linalg.inv(pose), scene.keypoints)[:, 2].min()
    while depth + way[2] < 0.1:  # the hand stands before the camera
        way = rng.normal(size=3)
        way = rng.uniform(0.15, 0.45) * way / np.linalg.norm(way)
    moved = np.eye(4)
    moved[:3, 3] = pose[:3, :3] @ way
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
    surface = merged((one.surface, other.surface))
    albedo = np.concatenate((one.albedo, other.albedo))
    return HandMesh(surface, albedo, np.concatenate((one.gloss, other.gloss)))


def unchanged(scene: HoldScene, _: np.random.Generator) -> HoldScene:
    """As it is."""
    return scene


SETS: dict[str, Change] = {
    "inside": unchanged,
    "far": at_distance(0.85, 1.3),
    "lens": other_lens,
    "no-hand": without_hand,
    "elsewhere": elsewhere,
    "sensor": unchanged,
    "opaque": opaque,
}


def drawn(name: str, part: str, number: int) -> Frame:
    """Make one frame."""
    settings = replace(SETTINGS, seed=SEEDS[part] + 10 * list(SETS).index(name))
    recipe: FrameRecipe = replace(settings.recipe(number), split="test")
    plain = build_scene(recipe, settings)
    scene = SETS[name](plain, np.random.default_rng([settings.seed, number, 99]))
    # A painted glass has the labels of the glass.
    labelled = replace(scene, contents=plain.contents) if name == "opaque" else scene
    labels = RayTracer(labelled.contents).labels(scene.camera, scene.world_from_camera)
    color = photograph(scene, seed=settings.seed + number, samples=settings.samples)
    raw = capture_depth(
        scene, settings.seed + number, COARSE if name == "sensor" else StereoCamera()
    )
    return frame_of(scene, recipe, color, labels, raw)


def draw(folder: Path, part: str, names: list[str]) -> None:
    """Make the frames that are not there."""
    for name in names:
        for number in range(FRAMES[part]):
            recipe = SETTINGS.recipe(number)
            root = folder / part / name
            if not frame_log_path(root, "test", recipe.object_id, recipe.stem).exists():
                write_frame(root, drawn(name, part, number), normals="none", depth_format="png")
                print(part, name, number, flush=True)


@dataclass(frozen=True)
class Shown:
    """A frame as it is shown to a network; images are (H, W), metres."""

    color: Any
    measured: Any
    camera: Intrinsics
    mask: Any
    keypoints: Any
    truth: Any


def shown(frame: Frame, **changes: Any) -> Shown:
    """A frame with its raw depth, or with changes."""
    assert frame.raw_depth is not None
    plain = Shown(
        frame.color, frame.raw_depth, frame.camera, frame.object_mask, frame.keypoints, frame.depth
    )
    return replace(plain, **changes)


def shifted(frame: Frame, rng: np.random.Generator) -> Shown:
    """With keypoints that are 10 to 60 cm off."""
    way = rng.normal(size=3)
    hand = frame.keypoints + rng.uniform(0.1, 0.6) * way / np.linalg.norm(way)
    hand[:, 2] += max(0.15 - hand[:, 2].min(), 0)
    return shown(frame, keypoints=hand)


def other_masks(frame: Frame, rng: np.random.Generator) -> dict[str, npt.NDArray[np.bool_]]:
    """Masks that are not the glass's, by name; in pixels of the samples' 320x180."""
    mask = frame.object_mask
    rows, columns = np.nonzero(mask)
    middle = np.array([rows.mean(), columns.mean()])
    quarter = rows.min() + (rows.max() - rows.min()) / 4
    mirrored = ndimage.shift(mask[:, ::-1], (0, 2 * middle[1] - mask.shape[1] + 1), order=0)
    hull = np.zeros(mask.shape, np.uint8)
    corners = cv2.convexHull(np.stack((columns, rows), axis=1).astype(np.int32))
    cv2.fillConvexPoly(hull, corners, 1)
    way = rng.uniform(0, 2 * np.pi)
    away = np.linalg.norm(np.indices(mask.shape) - middle[:, None, None], axis=0)
    return {
        "mask wider by 2 px": ndimage.distance_transform_edt(~mask) <= 2,
        "mask wider by 3 px": ndimage.distance_transform_edt(~mask) <= 3,
        "the mask's outline alone": mask & (ndimage.distance_transform_edt(mask) <= 6),
        "mask mirrored": mirrored,
        "mask moved by 4 px": ndimage.shift(
            mask, 4 * np.array([np.sin(way), np.cos(way)]), order=0
        ),
        "a disc in place of the mask": away <= np.sqrt(mask.sum() / np.pi),
        "the hand's mask": frame.hand_mask,
        "the mask's convex hull": hull > 0,
        "the mask's upper half": mask & (np.indices(mask.shape)[0] < middle[0]),
        "the mask without its upper quarter": mask & (np.indices(mask.shape)[0] >= quarter),
        "30 % taken out of the mask": mask & (np.random.default_rng(0).random(mask.shape) >= 0.3),
    }


@cache
def finders() -> tuple[Segmentation, HandKeypoints]:
    """The bundled networks that find mask and keypoints."""
    folder = samples_dir() / "checkpoints"
    return (
        Segmentation.load(folder / "segmentation-imagenet.safetensors"),
        HandKeypoints.load(folder / "hand-keypoints-imagenet.safetensors"),
    )


def found_hand(frame: Frame, glass: bool) -> Iterator[Shown]:
    """With the hand, and perhaps the glass, that the bundled networks find, if they find any."""
    segmentation, finder = finders()
    found = segmentation.masks(frame.color)
    mask = found.glass if glass else frame.object_mask
    seen = np.where(mask, 0, frame.raw_depth).astype(np.float32)
    with suppress(NoHandError):
        hand = finder.find(frame.color, seen, frame.camera, mask, found.hand)
        if mask.any() and np.median(hand[:, 2]) > 0.05:
            yield shown(frame, mask=mask, keypoints=hand)


def real_frames(folder: Path) -> dict[str, list[Shown]]:
    """ClearGrasp's two scenes, each glass with the stand-in hands of `real_frames`."""
    camera = load_intrinsics(folder / "camera_intrinsics.yaml")
    found: dict[str, list[Shown]] = {}
    for scene in real.SCENES:
        color, raw, truth, mask = real.read_scene(folder, scene)
        known = np.where(mask, 0, raw).astype(np.float32)
        for relative in real.held_hands():
            for glass in real.glasses(mask):
                hand = real.place_beside(relative, glass, known, camera)
                one = Shown(color, raw, camera, glass, hand, truth)
                found.setdefault(f"real scene {scene[-3:]}", []).append(one)
    return found


def all_sets(
    folder: Path, part: str, real_folder: Path
) -> dict[str, tuple[bool | None, list[Shown]]]:
    """The sets by name: whether they are inside (None: neither), and their frames.

    Of part dev, the sample frames are those of validation.
    """
    samples = list(open_samples("test" if part == "report" else "val"))
    rng = np.random.default_rng(SEEDS[part])
    exact = [shown(f, measured=np.where(f.object_mask, 0, f.depth)) for f in samples]
    sets: dict[str, tuple[bool | None, list[Shown]]] = {
        "samples": (True, [shown(f) for f in samples]),
        "samples, exact depth around the glass": (True, exact),
        "gallery, 1280x720": (True, [shown(f) for f in open_gallery()]),
    }
    for name in SETS:
        if (folder / part / name / "test").is_dir():
            frames = list(TransHand(folder / part / name, "test"))
            sets[name] = (name == "inside", [shown(f) for f in frames if f.object_mask.any()])
            if name == "no-hand":
                invented = [one for f in frames for one in found_hand(f, glass=False)]
                sets["no-hand, keypoints found by the networks"] = (False, invented)
    for frame, there in zip(samples, samples[1:] + samples[:1], strict=True):
        beside = {n: np.roll(getattr(there, n), 15, 1) for n in ("color", "object_mask")}
        for name, given in (
            ("colour and mask of the next frame", vars(frame)),
            ("colour and mask 15 px beside", beside),
        ):
            one = shown(there, color=given["color"], mask=given["object_mask"])
            sets.setdefault(name, (None, []))[1].append(one)
    sets["keypoints shifted"] = (False, [shifted(f, rng) for f in samples])
    for frame in samples:
        for name, mask in other_masks(frame, rng).items():
            # Of a glass without a hollow the hull is the mask.
            near = "hull" in name or name in SLIGHT
            where = None if near else False
            sets.setdefault(name, (where, []))[1].append(shown(frame, mask=mask))
    found = [one for f in samples for one in found_hand(f, glass=True)]
    sets["samples, mask and keypoints found by the networks"] = (None, found)
    if real_folder.is_dir():
        sets |= {name: (False, frames) for name, frames in real_frames(real_folder).items()}
    return sets


def restored(network: DepthNetwork, one: Shown) -> dict[str, Any]:
    """Restore a frame with and without asking the ground."""
    measured = np.asarray(one.measured, np.float32)
    given = np.where(one.mask, 0, measured) if network.erases else measured
    arguments = (one.color, given.astype(np.float32), one.camera, one.mask, one.keypoints)
    odd = told_color(one.color, measured, one.camera, one.mask, one.keypoints)
    odd += check_hand(one.keypoints, measured, one.camera, one.mask, given=True).problems
    plain, asked = network.restore(*arguments), network.restore(*arguments, measured, odd)
    scored = plain.restored & (one.truth > 0)
    verdict = asked.ground
    assert network.ground is not None
    beyond = network.ground.fields[verdict.field].beyond(verdict.features)
    farthest = max(beyond, key=lambda name: beyond[name])
    found: dict[str, Any] = {
        "score": verdict.score,
        "inside": bool(verdict.inside),
        "reason": farthest if beyond[farthest] > BEYOND else "combination",
    }
    if scored.any():
        found["right"] = float((np.abs(plain.depth - one.truth)[scored] < TOLERANCE_M).mean())
        if network.rule is not None:
            found["said_before"] = float(plain.confidence[scored].mean())
            found["said"] = float(asked.confidence[scored].mean())
    return found


def auc(inside: npt.NDArray[np.float64], outside: npt.NDArray[np.float64]) -> float:
    """Probability that a frame from outside has the larger score."""
    larger = outside[:, None] > inside
    return float((larger + 0.5 * (outside[:, None] == inside)).mean())


def mean(frames: list[dict[str, Any]], name: str) -> float | None:
    """Mean over the frames that have the number."""
    values = [one[name] for one in frames if name in one]
    return float(np.mean(values)) if values else None


def measure(
    network: DepthNetwork, sets: dict[str, tuple[bool | None, list[Shown]]]
) -> list[dict[str, Any]]:
    """The rows of a network: one a set, and all sets together."""
    found = {name: [restored(network, one) for one in of] for name, (_, of) in sets.items()}
    scores = {name: np.array([one["score"] for one in of]) for name, of in found.items()}
    pools = {
        side: np.concatenate([scores[name] for name, (where, _) in sets.items() if where is side])
        for side in (True, False)
    }
    rows = []
    for name, (where, _) in sets.items():
        frames = found[name]
        kept = [one for one in frames if one["inside"]]
        reasons = Counter(one["reason"] for one in frames if not one["inside"])
        rows.append(
            {
                "network": network.name,
                "set": name,
                "is_inside": where,
                "frames": len(frames),
                "share_inside": len(kept) / max(len(frames), 1),
                "auc": auc(pools[True], scores[name]) if where is not True and frames else None,
                "said_before": mean(frames, "said_before"),
                "share_right": mean(frames, "right"),
                "said": mean(frames, "said"),
                "said_inside": mean(kept, "said"),
                "share_right_inside": mean(kept, "right"),
                "reasons": dict(reasons.most_common(3)),
            }
        )
    rows.append(
        {
            "network": network.name,
            "set": "all",
            "frames": sum(map(len, pools.values())),
            "share_inside_kept": float((pools[True] <= 1).mean()),
            "share_outside_kept": float((pools[False] <= 1).mean()),
            "auc": auc(*pools.values()),
        }
    )
    return rows


def main() -> None:
    """Run the script."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task", choices=["draw", "measure"])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--part", choices=list(SEEDS), default="report")
    parser.add_argument("--sets", nargs="+", choices=list(SETS), default=list(SETS))
    parser.add_argument("--real", type=Path, default=real.real_folder(), help="ClearGrasp's frames")
    bundled = sorted((samples_dir() / "checkpoints").glob("hadr*-imagenet.safetensors"))
    parser.add_argument("--checkpoints", type=Path, nargs="+", default=bundled)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    if args.task == "draw":
        draw(args.folder, args.part, args.sets)
        return
    sets = all_sets(args.folder, args.part, args.real)
    networks = [DepthNetwork.load(path) for path in args.checkpoints]
    rows = [r for n in networks if n.ground is not None for r in measure(n, sets)]
    for row in rows:
        print({k: round(v, 3) if isinstance(v, float) else v for k, v in row.items()}, flush=True)
    if args.out:
        what = (
            "Does a checkpoint know where its ground ends? Means over frames, of the restored "
            "pixels of the glass whose depth is known: the stated probability of being right to "
            "2 cm without asking the ground (said_before) and as `hadr restore` gives it (said, 0 "
            "outside), and the share that is right. AUC: of the score that tells a set outside "
            "from all sets inside. The real scenes are two photographs with eight stand-in hands."
        )
        write_result_file(args.out, what, rows, provenance())


if __name__ == "__main__":
    main()
