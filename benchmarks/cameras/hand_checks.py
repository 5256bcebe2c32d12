"""Which hands are accepted: true ones, found ones, and those seen where there is none.

    python benchmarks/cameras/hand_checks.py [--splits train val] [--every 4] [--mediapipe FILE]
        [--without DIR ...] [--real DIR]
    python benchmarks/cameras/hand_checks.py --moved [--splits val]

True keypoints are given; then the bundled networks find masks and keypoints in the raw depth, once
with the true mask of the glass and once with the predicted one; MediaPipe finds them where its
model is named (`hadr hand-model`). For each there is the share that `hadr.models.hand.plausible`
accepts, the error of the accepted ones and of the others, and the range of every number that is
checked: its limits are to leave the frames of `train` and `val` inside.

The folders of `--without` hold frames without a hand, in the data set's form (`known_ground.py draw
DIR --sets no-hand` makes some); `--real` has ClearGrasp's (`real_frames.py`). All of these must be
"no hand found".

With `--moved` hands are given that are not the frame's: its own, turned, mirrored or moved, and
another frame's at its place. Printed is the share of which something is said.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from real_frames import SCENES, read_scene, real_folder
from scipy.spatial.transform import Rotation

from hadr.camera import Intrinsics
from hadr.camera_file import load_intrinsics
from hadr.data.frame import Frame
from hadr.data.samples import open_samples, samples_dir
from hadr.data.transhand import SPLITS, TransHand
from hadr.hand import FINGERS
from hadr.models.hand.mediapipe_hand import MediaPipeHand
from hadr.models.hand.plausible import check_hand
from hadr.restoration import Restoration, Restorer


@dataclass(frozen=True)
class Shot:
    """A frame, and its true hand if it has one."""

    name: str
    color: npt.NDArray[np.uint8]
    depth: npt.NDArray[np.float32]
    camera: Intrinsics
    mask: npt.NDArray[np.bool_]
    keypoints: npt.NDArray[np.float64] | None


Way = Callable[[Shot], Restoration]


def shot(frame: Frame, *, hand: bool = True) -> Shot:
    """A frame of a data set, as its depth camera sees it."""
    depth = frame.depth if frame.raw_depth is None else frame.raw_depth
    name = f"{frame.split}/{frame.object_id}/{frame.stem}"
    keypoints = frame.keypoints if hand else None
    return Shot(name, frame.color, depth, frame.camera, frame.object_mask, keypoints)


def real_shots(folder: Path) -> Iterator[Shot]:
    """ClearGrasp's two scenes: glasses on a table."""
    camera = load_intrinsics(folder / "camera_intrinsics.yaml")
    for scene in SCENES:
        color, raw, _, mask = read_scene(folder, scene)
        yield Shot(scene, color, raw, camera, mask, None)


def ways(landmarker: MediaPipeHand | None) -> dict[str, Way]:
    """What gives or finds a hand, by name."""
    nets = samples_dir() / "checkpoints"
    networks = Restorer(
        "nearest",
        segmentation=nets / "segmentation-imagenet.safetensors",
        keypoint_network=nets / "hand-keypoints-imagenet.safetensors",
    )
    plain = Restorer("nearest")
    found: dict[str, Way] = {
        "given": lambda s: plain(s.color, s.depth, s.camera, s.mask, s.keypoints),
        "found": lambda s: networks(s.color, s.depth, s.camera, s.mask),
        "found, and the mask": lambda s: networks(s.color, s.depth, s.camera),
    }
    if landmarker is not None:
        landmarks = Restorer("nearest", keypoint_network=landmarker)
        found["MediaPipe"] = lambda s: landmarks(s.color, s.depth, s.camera, s.mask)
    return found


def measure(title: str, shots: Iterable[Shot], by: dict[str, Way]) -> None:
    """Print what becomes of the hands of some frames."""
    checks: dict[str, list[dict[str, float]]] = {way: [] for way in by}
    errors: dict[str, list[tuple[bool, float]]] = {way: [] for way in by}
    count = 0
    for one in shots:
        count += 1
        for way, restored in by.items():
            if way == "given" and one.keypoints is None:
                continue
            hand = restored(one).hand
            if hand is None:
                continue
            numbers = asdict(hand.check)
            problems = numbers.pop("problems")
            checks[way].append({k: v for k, v in numbers.items() if v is not None})
            off = np.nan
            if one.keypoints is not None:
                off = float(np.linalg.norm(hand.keypoints - one.keypoints, axis=1).mean())
            errors[way].append((not problems, off))
            if bool(problems) == (one.keypoints is not None):
                print(f"  {way}: {one.name}, off by {1000 * off:.0f} mm: {'; '.join(problems)}")
    print(f"{title}: {count} frames")
    for way, rows in errors.items():
        kept = [off for accepted, off in rows if accepted]
        gone = [off for accepted, off in rows if not accepted]
        words = [f"  {way}: {len(rows)} seen, {len(kept)} accepted"]
        for name, some in (("accepted", kept), ("others", gone)):
            if some and np.isfinite(some).any():
                words.append(f"{name} off by {1000 * np.median(some):.0f} mm in the median")
        print(", ".join(words))
        for name in sorted({name for row in checks[way] for name in row}):
            values = [row[name] for row in checks[way] if name in row]
            low, middle, high = np.percentile(values, (0, 50, 100))
            print(f"    {name:<9} {low:7.3f} {middle:7.3f} {high:7.3f}")


def others(
    hand: npt.NDArray[np.float64], stranger: npt.NDArray[np.float64], rng: np.random.Generator
) -> Iterator[tuple[str, npt.NDArray[np.float64]]]:
    """A hand, and hands that are not this one; keypoints in the camera's frame, metres."""
    middle = hand.mean(axis=0)
    yield "true", hand
    for axis in range(3):
        turn = Rotation.from_rotvec(np.radians(40) * np.eye(3)[axis])
        yield f"turned by 40 degrees about {'xyz'[axis]}", turn.apply(hand - middle) + middle
    for axis in (0, 2):
        yield f"mirrored in {'xyz'[axis]}", np.where(np.eye(3)[axis] > 0, 2 * middle - hand, hand)
    yield "another frame's at its place", stranger - stranger.mean(axis=0) + middle
    side = rng.normal(size=2)
    for far in (0.03, 0.06):
        yield f"{100 * far:.0f} cm aside", hand + np.append(far * side / np.linalg.norm(side), 0)
        for way in (-far, far):
            yield f"{100 * way:+.0f} cm in depth", hand + np.array([0, 0, way])
    index = np.isin(np.arange(len(hand)), FINGERS["index"])
    yield "index 3 cm deeper", hand + np.outer(index, (0, 0, 0.03))


def measure_moved(frames: Sequence[Frame]) -> None:
    """Print of which share of hands something is said."""
    rng = np.random.default_rng(0)
    said: dict[str, list[bool]] = {}
    for number, frame in enumerate(frames):
        one, stranger = shot(frame), frames[(7 * number + 13) % len(frames)]
        assert one.keypoints is not None
        for name, hand in others(one.keypoints, stranger.keypoints, rng):
            check = check_hand(hand, one.depth, one.camera, one.mask, given=True)
            said.setdefault(name, []).append(bool(check.problems))
    for name, noticed in said.items():
        print(f"  {name:32} {100 * np.mean(noticed):5.1f} % of {len(noticed)}")


def main() -> None:
    """Run the script."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--splits", nargs="*", choices=SPLITS, default=SPLITS)
    parser.add_argument("--every", type=int, default=1, help="take every n-th frame")
    parser.add_argument("--mediapipe", type=Path, help="MediaPipe's model")
    parser.add_argument("--without", nargs="*", type=Path, default=[], help="frames without hand")
    parser.add_argument("--real", type=Path, default=real_folder(), help="ClearGrasp's frames")
    parser.add_argument("--moved", action="store_true", help="give hands that are not the frame's")
    args = parser.parse_args()
    if args.moved:
        for split in args.splits:
            print(split)
            measure_moved(open_samples(split)[:: args.every])
        return
    with nullcontext() if args.mediapipe is None else MediaPipeHand(args.mediapipe) as landmarker:
        measure_all(args, ways(landmarker))


def measure_all(args: argparse.Namespace, by: dict[str, Way]) -> None:
    """Print the tables of all frames that were asked for."""
    for split in args.splits:
        frames = open_samples(split)
        chosen = range(0, len(frames), args.every)
        measure(split, (shot(frames[i]) for i in chosen), by)
    for folder in args.without:
        there = [split for split in SPLITS if (folder / split).is_dir()]
        empty = (
            shot(frame, hand=False) for frame in TransHand(folder, there) if frame.object_mask.any()
        )
        measure(f"{folder.name}, without a hand", empty, by)
    if args.real.is_dir():
        measure("ClearGrasp, without a hand", real_shots(args.real), by)


if __name__ == "__main__":
    main()
