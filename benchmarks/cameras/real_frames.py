"""Restore two real frames of glass on a table, and measure the error inside and outside the mask.

The frames are ClearGrasp's (RealSense D435, 1280x720), which are not part of this project: download
that data set's real D435 test frames and name the folder. The truth is the same camera's depth of
the same scene with the glass replaced by sprayed twins.

    python benchmarks/cameras/real_frames.py [--real DIR] [--checkpoints FILE ...] [--out FILE]

DIR is by default $HADR_CLEARGRASP, else ../shared/realdata/cleargrasp_d435.

There is no hand in these frames, and HADR needs one. `hadr restore` says so and takes the nearest
valid depth instead. To see what the network does with real pictures all the same, it is given
stand-in hands: that of a validation frame, moved rigidly so that the glass it holds would stand
where each real glass stands, at the depth of the table around it; each glass gets its own. This
is no use that anybody should make of the method; it shows what depends on the hand.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from depth_camera import read_real

from hadr.camera import Intrinsics, back_project, unproject, valid_depth
from hadr.camera_file import load_intrinsics
from hadr.data.samples import open_samples, samples_dir
from hadr.figures.tables.results import NAMES
from hadr.frame_io import read_color
from hadr.metrics import frame_metrics
from hadr.records.provenance import provenance
from hadr.records.result_file import write_result_file
from hadr.restoration import restore
from hadr.trained_networks import DepthNetwork

Float = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]

ROOT = Path(__file__).resolve().parents[2]
DEFAULT = ROOT.parent / "shared" / "realdata" / "cleargrasp_d435"
SCENES = ("000000080", "000000130")
HANDS = 8
SHIFT_M = 0.05
#: Width of the ring around a glass from which the table's depth is taken, pixels.
RING = 25
LEAST_PIXELS = 500


def real_folder() -> Path:
    """Where ClearGrasp's frames lie, if nothing else is said."""
    return Path(os.environ.get("HADR_CLEARGRASP") or DEFAULT)


def read_scene(folder: Path, scene: str) -> tuple[npt.NDArray[np.uint8], Float, Float, Mask]:
    """Colour, raw depth and true depth (0 = missing), and mask of one scene."""
    color = read_color(folder / f"{scene}-transparent-rgb-img.jpg")
    raw, truth, mask = read_real(folder, scene)
    return color, raw.astype(np.float32), truth.astype(np.float32), mask


def held_hands(count: int = HANDS) -> list[npt.NDArray[np.float64]]:
    """Hands of validation frames relative to the glass they hold, metres, each (21, 3)."""
    frames = open_samples("val")
    found = []
    for number in np.linspace(0, len(frames) - 1, count).round().astype(int):
        frame = frames[int(number)]
        points = back_project(frame.depth, frame.camera)[frame.object_mask]
        center = np.nanmedian(points, axis=0)
        found.append(np.asarray(frame.keypoints - center, dtype=np.float64))
    return found


def glasses(mask: Mask) -> list[Mask]:
    """The connected parts of a mask, without specks."""
    count, labels = cv2.connectedComponents(mask.astype(np.uint8))
    parts = [labels == number for number in range(1, count)]
    return [part for part in parts if part.sum() >= LEAST_PIXELS]


def place_beside(
    relative: npt.NDArray[np.float64], glass: Mask, known: Float, camera: Intrinsics
) -> npt.NDArray[np.float64]:
    """Move a hand (21, 3), relative to the glass that it held, to a glass (H, W); metres.

    It stands at the depth of what surrounds it, of raw depth with all glass erased.
    """
    box = np.ones((2 * RING + 1, 2 * RING + 1), np.uint8)
    around = (cv2.dilate(glass.astype(np.uint8), box) > 0) & valid_depth(known)
    depth = float(np.median(known[around]))
    row, column = np.median(np.argwhere(glass), axis=0)
    return relative + unproject((column, row), depth, camera)


def score(depth: Float, raw: Float, truth: Float, mask: Mask) -> dict[str, Any]:
    """Errors inside the mask: all restored pixels, and those that the camera measured too."""
    both = frame_metrics(depth, truth, mask & valid_depth(raw))
    changed = (depth != raw) & ~mask
    outside = ~mask & valid_depth(truth) & valid_depth(raw)
    return {
        **asdict(frame_metrics(depth, truth, mask)),
        "where_measured": {k: v for k, v in asdict(both).items() if k != "averaging"},
        "outside": {
            "changed_pixels": int(changed.sum()),
            "rmse_m": float(np.sqrt(np.mean((depth - truth)[outside] ** 2))),
            "raw_rmse_m": float(np.sqrt(np.mean((raw - truth)[outside] ** 2))),
        },
    }


def mean_row(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Mean over stand-in hands, with the least and largest RMSE."""
    names = ("rmse_m", "rel", "mae_m", "delta_105", "delta_110", "delta_125", "coverage")
    rmse = [row["rmse_m"] for row in rows]
    return {
        **{name: float(np.mean([row[name] for row in rows])) for name in names},
        "rmse_low_m": min(rmse),
        "rmse_high_m": max(rmse),
        "hands": len(rows),
        "pixels": rows[0]["pixels"],
        "where_measured": {
            name: float(np.mean([row["where_measured"][name] for row in rows])) for name in names
        },
        "outside": rows[0]["outside"],
    }


def with_hands(
    network: DepthNetwork,
    color: npt.NDArray[np.uint8],
    raw: Float,
    mask: Mask,
    camera: Intrinsics,
    hands: list[npt.NDArray[np.float64]],
    shift_m: float = 0.0,
) -> list[tuple[Float, Float]]:
    """Restore each glass with its own stand-in hand: depth and confidence of each hand."""
    known = np.where(mask, 0, raw).astype(np.float32)
    results = []
    for relative in hands:
        depth, confidence = known.copy(), np.zeros_like(known)
        for glass in glasses(mask):
            hand = place_beside(relative, glass, known, camera) + np.array([0, 0, shift_m])
            answer = network.restore(color, known, camera, glass, hand)
            depth[answer.restored] = answer.depth[answer.restored]
            confidence[answer.restored] = answer.confidence[answer.restored]
        results.append((depth, confidence))
    return results


def measure(
    folder: Path, checkpoints: list[Path]
) -> tuple[list[dict[str, Any]], dict[str, dict[str, Any]]]:
    """Measure all methods on both scenes: the rows, and what stand-in hands teach of networks."""
    camera = load_intrinsics(folder / "camera_intrinsics.yaml")
    hands = held_hands()
    networks = [DepthNetwork.load(path) for path in checkpoints]
    rows: list[dict[str, Any]] = []
    lessons: dict[str, dict[str, Any]] = {}
    for scene in SCENES:
        color, raw, truth, mask = read_scene(folder, scene)
        plain = restore(color, raw, camera, mask, checkpoint=checkpoints[0])
        inpainted = restore(color, raw, camera, mask, method="inpaint")
        for method, depth in (
            ("raw", raw),
            ("inpainting", inpainted.depth),
            (plain.method, plain.depth),
        ):
            rows.append({"method": method, "scene": scene, **score(depth, raw, truth, mask)})
        lessons[scene] = {
            "note_of_restore": next(n for n in plain.notes if "checkpoint fits" in n),
            "glasses": len(glasses(mask)),
            "networks": {},
        }
        for path, network in zip(checkpoints, networks, strict=True):
            found = with_hands(network, color, raw, mask, camera, hands)
            scores = [score(depth, raw, truth, mask) for depth, _ in found]
            title = NAMES.get(path.parents[1].name, network.title)  # OUT/known/hadr/seed-0/last
            title += " of the handover" * ("handover" in network.name)
            name = f"{title}, stand-in hand"
            rows.append({"method": name, "scene": scene, **mean_row(scores)})
            few = hands[:3]
            nearer, farther = (
                with_hands(network, color, raw, mask, camera, few, shift_m)
                for shift_m in (-SHIFT_M, SHIFT_M)
            )
            moved = [
                float(np.median((b - a)[mask & (a > 0) & (b > 0)]))
                for (a, _), (b, _) in zip(nearer, farther, strict=True)
            ]
            sure, right = [], []
            for depth, confidence in found:
                scored = mask & valid_depth(truth) & valid_depth(depth)
                sure.append(confidence[scored])
                right.append(np.abs(depth - truth)[scored] < 0.02)
            lesson = {"answer_follows_hand": float(np.mean(moved)) / (2 * SHIFT_M)}
            if network.can_say:
                lesson["mean_confidence"] = float(np.concatenate(sure).mean())
            lesson["share_right"] = float(np.concatenate(right).mean())
            lessons[scene]["networks"][title] = lesson
    return rows, lessons


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--real", type=Path, default=real_folder(), help="ClearGrasp's frames")
    bundled = samples_dir() / "checkpoints"
    parser.add_argument(
        "--checkpoints",
        type=Path,
        nargs="+",
        default=[
            bundled / f"{kind}-{size}.safetensors"
            for size in ("imagenet", "handover")
            for kind in ("hadr", "hadr-plus")
        ],
    )
    out = ROOT / "results" / "real" / "cleargrasp_d435.json"
    parser.add_argument("--out", type=Path, default=out)
    args = parser.parse_args()
    if not args.real.is_dir():
        parser.error(f"no folder {args.real}: name ClearGrasp's D435 frames with --real")
    rows, lessons = measure(args.real, args.checkpoints)
    write_result_file(
        args.out,
        "Two real D435 frames of ClearGrasp (glass on a table, no hand), 1280x720: errors inside "
        "the mask where the true depth is known and the method gives one, and outside of it. "
        "'stand-in hand' is the mean over hands of validation frames that were put beside each "
        "glass; coverage is the share of the mask's pixels with a truth that got a depth.",
        rows,
        {
            **provenance(),
            "checkpoints": [path.name for path in args.checkpoints],
            "scenes": lessons,
        },
    )
    for row in rows:
        print(
            f"{row['scene']}  {row['method']:<24} RMSE {row['rmse_m']:.4f} m  coverage "
            f"{100 * row['coverage']:.1f} %  where measured {row['where_measured']['rmse_m']:.4f} "
            f"outside changed {row['outside']['changed_pixels']}"
        )
    print(lessons)


if __name__ == "__main__":
    main()
