"""Three ways to split frames, and how much each of them leaks.

Frames of one holding pose differ only in camera and surroundings. Split by frame, nearly every
test frame has a twin in the training set; split by holding pose it has none, but its object is
known; split by object even that is new.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

#: The eight objects of the data set (`hadr.synthesis.glass.objects` has their shapes).
OBJECT_IDS = ("0000", "0001", "0004", "0005", "0006", "0007", "0008", "0009")
#: The objects of the paper's unknown-category experiment.
UNKNOWN_OBJECTS = ("0004", "0007")
#: The paper's ratio of training, validation and testing frames.
PAPER_RATIO = (7.0, 2.0, 1.0)


def split_by_frame(
    n_frames: int, rng: np.random.Generator, ratio: Sequence[float] = PAPER_RATIO
) -> npt.NDArray[np.str_]:
    """Give each of so many frames ``train``, ``val`` or ``test`` at random, whatever it shows.

    ValueError where the ratio is not their three weights.
    """
    weights = np.asarray(ratio, dtype=float)
    if weights.shape != (3,) or (weights < 0).any() or weights.sum() <= 0:
        raise ValueError(f"ratio must be three weights train:val:test, got {tuple(ratio)}")
    ends = np.round(np.cumsum(weights / weights.sum()) * n_frames).astype(int)
    return rng.permutation(np.repeat(("train", "val", "test"), np.diff(ends, prepend=0)))


def split_by_holding(
    hold_ids: Sequence[str], rng: np.random.Generator, ratio: Sequence[float] = PAPER_RATIO
) -> npt.NDArray[np.str_]:
    """Give each frame's holding pose a split as `split_by_frame` does: the ratio counts poses."""
    poses, pose_of = np.unique(np.asarray(hold_ids), return_inverse=True)
    return np.asarray(split_by_frame(len(poses), rng, ratio)[pose_of])


def split_by_object(
    object_ids: Sequence[str], unknown: Sequence[str] = UNKNOWN_OBJECTS
) -> npt.NDArray[np.str_]:
    """Test on the frames of the unknown objects, train on all others; from each frame's object.

    ValueError where no frame shows an unknown object.
    """
    held_out = np.isin(np.asarray(object_ids), np.asarray(list(unknown)))
    if not held_out.any():
        raise ValueError(f"none of the frames shows {', '.join(unknown)}: nothing to test on")
    return np.where(held_out, "test", "train")


def leaked_share(split: npt.NDArray[np.str_], groups: Sequence[str]) -> float:
    """Share of the test frames whose group (holding pose or object) also occurs in training, 0..1.

    From the split and the group of each frame, N names; ValueError where their numbers differ, or
    there is no test frame.
    """
    names = np.asarray(groups)
    if names.shape != split.shape:
        raise ValueError(f"{len(split)} splits, but {len(names)} groups")
    test = names[split == "test"]
    if not len(test):
        raise ValueError("there is no test frame")
    return float(np.isin(test, names[split == "train"]).mean())
