"""Measured depth, real or simulated, beside the true one: kept in files, and its errors counted.

A file holds several frames: depth in steps of 0.5 mm as 16-bit numbers, masks as bits, compressed
by numpy. What its numbers mean and where they come from stands beside it in a sealed JSON file.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from hadr.camera import BoolArray, FloatArray, Intrinsics, valid_depth
from hadr.corruption import depth_jumps
from hadr.records.result_file import read_sealed, write_sealed

Depth = npt.NDArray[np.float32]

#: Step in which depth is kept, metres.
DEPTH_STEP = 0.0005
#: Bounds of the kinds of error, metres; in between lie the kinds of `KINDS` after the first.
BOUNDS: tuple[float, ...] = (-0.01, 0.01, 0.05, 0.20)
#: What can become of a pixel's depth: nothing is measured, or how far it lies behind the truth.
KINDS: tuple[str, ...] = (
    "missing", "more than 1 cm in front", "right to 1 cm", "1 to 5 cm behind", "5 to 20 cm behind",
    "more than 20 cm behind",
)  # fmt: skip
#: Where errors are counted.
PLACES: tuple[str, ...] = ("in the glass", "at outlines", "elsewhere")


@dataclass(frozen=True)
class CorruptionExample:
    """One frame with what a camera measured and what it should have.

    Pictures have the shape (H, W), depths are z-depths in metres: in what was measured 0 is
    missing, in the truth and in the background, that without the glass, it is unknown.
    """

    name: str
    camera: Intrinsics
    measured: Depth
    truth: Depth
    background: Depth
    mask: BoolArray


def write_examples(
    path: str | Path, examples: Mapping[str, CorruptionExample], content: Mapping[str, Any]
) -> None:
    """Write examples, depths below 32 m, as ``path`` (.npz) and a sealed ``.json`` with content."""
    target, arrays = Path(path), {}
    for key, example in examples.items():
        for name in ("measured", "truth", "background"):
            depth = getattr(example, name)
            if not (np.isfinite(depth).all() and depth.min() >= 0 and depth.max() < 32):
                raise ValueError(f"{name} of {key!r} must lie in 0..32 m, got {depth.max()}")
            steps = np.rint(depth / DEPTH_STEP).astype(np.uint16)
            arrays[f"{key}/{name}"] = np.diff(steps, axis=1, prepend=np.uint16(0))  # packs better
        arrays[f"{key}/mask"] = np.packbits(example.mask, axis=1)
    target.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(target, **arrays)
    told = {
        "depth_step_m": DEPTH_STEP,
        "file_sha256": hashlib.sha256(target.read_bytes()).hexdigest(),
        "examples": {
            key: {"name": example.name, "camera": example.camera.to_dict()}
            for key, example in examples.items()
        },
    }
    write_sealed(target.with_suffix(".json"), told | dict(content))


def read_examples(path: str | Path) -> dict[str, CorruptionExample]:
    """Read what `write_examples` wrote, by key; a changed file is refused."""
    source = Path(path)
    told = read_sealed(source.with_suffix(".json"))
    if hashlib.sha256(source.read_bytes()).hexdigest() != told["file_sha256"]:
        raise ValueError(f"{source} is not the file that {source.stem}.json speaks of")
    examples = {}
    with np.load(source) as arrays:
        for key, known in told["examples"].items():
            camera = Intrinsics.from_dict(known["camera"])
            depths = [
                np.cumsum(arrays[f"{key}/{name}"], axis=1, dtype=np.uint16) * told["depth_step_m"]
                for name in ("measured", "truth", "background")
            ]
            mask = np.unpackbits(arrays[f"{key}/mask"], axis=1, count=camera.width).astype(bool)
            measured, truth, background = (depth.astype(np.float32) for depth in depths)
            examples[key] = CorruptionExample(
                known["name"], camera, measured, truth, background, mask
            )
    return examples


def error_kinds(measured: Depth, truth: Depth) -> npt.NDArray[np.int64]:
    """Number of each pixel's kind in `KINDS`, shape (H, W); -1 where the truth is unknown."""
    seen = valid_depth(measured)
    error = np.where(seen, measured, 0.0) - np.where(valid_depth(truth), truth, 0.0)
    kinds = 1 + np.digitize(error, BOUNDS)
    return np.where(valid_depth(truth), np.where(seen, kinds, 0), -1)


def error_places(truth: Depth, mask: BoolArray) -> dict[str, BoolArray]:
    """Each of `PLACES` to its pixels (H, W); beyond 1.5 m only the glass counts."""
    square = np.ones((3, 3), bool)
    grown = ndimage.binary_dilation(mask, square, iterations=2)
    shrunk = ndimage.binary_erosion(mask, square, iterations=2, border_value=1)
    outline = (grown & ~shrunk) | depth_jumps(truth, width_px=2)
    inside = mask & ~outline
    far = valid_depth(truth) & (truth >= 1.5)
    rest = ~mask & ~outline & ~far
    return dict(zip(PLACES, (inside, outline & (mask | ~far), rest), strict=True))


def kind_shares(kinds: npt.NDArray[np.int64], where: BoolArray) -> npt.NDArray[np.float64]:
    """Share (6,) of each of `KINDS` among the pixels ``where`` with a known truth; NaN without."""
    counts = np.bincount(kinds[where & (kinds >= 0)], minlength=len(KINDS))
    return np.asarray(counts / (counts.sum() or np.nan))


@dataclass(frozen=True)
class CorruptionStatistics:
    """What is left of the depth in the pixels of a mask that have a true one; shares are 0..1.

    The bias is the median of measured minus true depth, positive behind, where one was measured.
    """

    pixels: int
    missing_share: float
    bias_m: float
    within_1cm_share: float


def corruption_statistics(
    corrupted: FloatArray, truth: FloatArray, mask: BoolArray
) -> CorruptionStatistics:
    """Count what a corruption left of the depth (H, W), metres, inside a mask.

    Missing or unknown depth is 0 or NaN; a number for which nothing can be counted is NaN.
    """
    known = mask & valid_depth(truth)
    measured, true = corrupted[known], truth[known]
    valid = valid_depth(measured)
    error = measured[valid] - true[valid]
    pixels = int(known.sum())
    return CorruptionStatistics(
        pixels=pixels,
        missing_share=float(1 - valid.mean()) if pixels else float("nan"),
        bias_m=float(np.median(error)) if error.size else float("nan"),
        within_1cm_share=float((np.abs(error) < 0.01).sum() / pixels) if pixels else float("nan"),
    )
