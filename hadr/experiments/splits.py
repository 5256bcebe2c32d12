"""The frames of the two experiments: objects known from training, and objects never seen.

Known: trained, tuned and tested on all objects, with other holding poses in each part. Unknown:
trained and tuned on six objects, tested on every frame of the two that were held out.

Source: paper, "Comparison with SOTA"; ledger, rows 14 and 22.
"""

from __future__ import annotations

import hashlib
from bisect import bisect_right
from collections.abc import Sequence
from itertools import accumulate
from pathlib import Path
from typing import Literal, get_args, overload

from hadr.data.transhand import SPLITS, Frame, TransHand
from hadr.synthesis.objects import OBJECTS, UNKNOWN_OBJECTS

Experiment = Literal["known", "unknown"]
Part = Literal["train", "val", "test"]
EXPERIMENTS: tuple[Experiment, ...] = get_args(Experiment)


class FrameSource(Sequence[Frame]):
    """Some frames of some data folders, one after the other, read when asked for.

    Args:
        folders: The parts of the data folders that are joined, in this order.
    """

    def __init__(self, folders: Sequence[TransHand]) -> None:
        self.folders = tuple(folders)
        self._ends = list(accumulate(len(folder) for folder in self.folders))

    def __len__(self) -> int:
        return self._ends[-1] if self._ends else 0

    @overload
    def __getitem__(self, index: int) -> Frame: ...

    @overload
    def __getitem__(self, index: slice) -> list[Frame]: ...

    def __getitem__(self, index: int | slice) -> Frame | list[Frame]:
        """Read one frame, or several."""
        if isinstance(index, slice):
            return [self[number] for number in range(*index.indices(len(self)))]
        number = index + len(self) if index < 0 else index
        if not 0 <= number < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        folder = bisect_right(self._ends, number)
        return self.folders[folder][number - (self._ends[folder - 1] if folder else 0)]

    def holds(self, stems: Sequence[str]) -> list[str]:
        """Say which hold each of some frames shows; frames of one hold are alike.

        Args:
            stems: The frames' names, OBJECT/STEM, in the order of the folders.

        Returns:
            A name of the hold for each frame, another for each data folder; the frame's own name
            where its log has none.
        """
        listed = (
            (f"{files.object_id}/{files.stem}", f"{number}/{hold or files.stem}")
            for number, folder in enumerate(self.folders)
            for files, hold in zip(folder.files, folder.hold_ids, strict=True)
        )
        return [next(hold for name, hold in listed if name == stem) for stem in stems]

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
    return FrameSource([TransHand(root, splits, wanted) for root in roots])


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
