"""The frames of the two experiments: objects known from training, and objects never seen.

Known: trained, tuned and tested on all objects, with other holding poses in each part. Unknown:
trained and tuned on six objects, tested on every frame of the two that were held out.

Source: paper, "Comparison with SOTA"; ledger, rows 14 and 22.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Literal, get_args

from hadr.data.transhand import SPLITS, Frame, TransHand
from hadr.synthesis.objects import OBJECTS, UNKNOWN_OBJECTS

Experiment = Literal["known", "unknown"]
Part = Literal["train", "val", "test"]
EXPERIMENTS: tuple[Experiment, ...] = get_args(Experiment)


@dataclass(frozen=True)
class FrameSource:
    """Some frames of some data folders, in a fixed order.

    Attributes:
        folders: The parts of the data folders that are joined.
    """

    folders: tuple[TransHand, ...]

    def __len__(self) -> int:
        """Give the number of frames."""
        return sum(len(folder) for folder in self.folders)

    def __iter__(self) -> Iterator[Frame]:
        """Read the frames, one after the other."""
        return chain.from_iterable(self.folders)

    @property
    def objects(self) -> tuple[str, ...]:
        """The objects that occur, sorted."""
        return tuple(sorted({f.object_id for folder in self.folders for f in folder.files}))


def open_part(roots: Sequence[str | Path], experiment: Experiment, part: Part) -> FrameSource:
    """Open one part of an experiment's frames.

    Args:
        roots: Data folders in TransHand's layout, joined in this order.
        experiment: "known" or "unknown".
        part: "train", "val" or "test".

    Returns:
        The frames.

    Raises:
        ValueError: There is no data folder, or the experiment is unknown.
        FileNotFoundError: A folder is missing or lacks an object.
    """
    if experiment not in EXPERIMENTS:
        raise ValueError(f"experiment must be one of {EXPERIMENTS}, got {experiment!r}")
    if not roots:
        raise ValueError("no data folder given")
    unseen = set(UNKNOWN_OBJECTS)
    splits: tuple[str, ...] = (part,)
    if experiment == "known":
        wanted = list(OBJECTS)
    elif part == "test":
        wanted, splits = sorted(unseen), SPLITS
    else:
        wanted = [name for name in OBJECTS if name not in unseen]
    return FrameSource(tuple(TransHand(root, splits, wanted) for root in roots))


def data_digest(root: str | Path) -> str:
    """SHA-256 over the names and contents of all files of a data folder, in the names' order.

    Args:
        root: The folder; hidden files are left out.

    Returns:
        64 hexadecimal digits.

    Raises:
        FileNotFoundError: There is no such folder, or it is empty.
    """
    root = Path(root)
    found = hashlib.sha256()
    files = sorted(
        path for path in root.rglob("*") if path.is_file() and not path.name.startswith(".")
    )
    if not files:
        raise FileNotFoundError(f"no files in the data folder {root}")
    for path in files:
        found.update(path.relative_to(root).as_posix().encode())
        found.update(hashlib.sha256(path.read_bytes()).digest())
    return found.hexdigest()
