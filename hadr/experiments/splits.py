"""The frames of the two experiments: objects known from training, and objects never seen.

Known: trained, tuned and tested on all objects, with other holding poses in each part. Unknown:
trained and tuned on six objects, tested on every frame of the two that were held out. By frame:
the same frames as known and as many in each part, but dealt out one by one, so that most test
frames have a sister of the same hold in training. It is there to measure how that flatters.

Source: paper, "Comparison with SOTA"; ledger, rows 14 and 22.
"""

from __future__ import annotations

import hashlib
from bisect import bisect_right
from collections.abc import Sequence
from itertools import accumulate
from pathlib import Path
from typing import Literal, get_args, overload

import numpy as np

from hadr.data.frame import Frame
from hadr.data.splits import OBJECT_IDS, UNKNOWN_OBJECTS, split_by_frame
from hadr.data.transhand import SPLITS, FrameFiles, TransHand

Experiment = Literal["known", "unknown", "by-frame"]
Part = Literal["train", "val", "test"]
EXPERIMENTS: tuple[Experiment, ...] = get_args(Experiment)
PARTS_OF_DATA: tuple[Part, ...] = get_args(Part)


class FrameSource(Sequence[Frame]):
    """Some frames of some data folders, one after the other, read when asked for.

    Args:
        folders: The parts of the data folders that are joined, in this order.
        chosen: Numbers of the frames that belong to it, in its order; all where it is left out.
    """

    def __init__(self, folders: Sequence[TransHand], chosen: Sequence[int] | None = None) -> None:
        self.folders = tuple(folders)
        self._ends = list(accumulate(len(folder) for folder in self.folders))
        self._chosen = range(self._ends[-1] if self._ends else 0) if chosen is None else chosen

    def __len__(self) -> int:
        return len(self._chosen)

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
        number = self._chosen[number]
        folder = bisect_right(self._ends, number)
        return self.folders[folder][number - (self._ends[folder - 1] if folder else 0)]

    def holds(self, stems: Sequence[str]) -> list[str]:
        """Say which hold each of some frames shows; frames of one hold are alike.

        Args:
            stems: The frames' names, OBJECT/STEM, in the order of the folders.

        Returns:
            A name of the hold for each frame, another for each data folder; the frame's own name
            where its log has none.

        Raises:
            ValueError: A frame is not there, or not in this order.
        """
        logged = [folder.hold_ids for folder in self.folders]
        listed = (
            (f"{files.object_id}/{files.stem}", f"{root}/{hold or files.stem}")
            for number in self._chosen
            for root, files, hold in [self._place(number, logged)]
        )
        holds = []
        for stem in stems:
            hold = next((hold for name, hold in listed if name == stem), None)
            if hold is None:
                raise ValueError(f"there is no frame {stem!r} here, or not in this order")
            holds.append(hold)
        return holds

    def _place(
        self, number: int, logged: Sequence[Sequence[str | None]]
    ) -> tuple[int, FrameFiles, str | None]:
        """The folder's number, the files and the logged hold of a frame of the folders."""
        folder = bisect_right(self._ends, number)
        inside = number - (self._ends[folder - 1] if folder else 0)
        return folder, self.folders[folder].files[inside], logged[folder][inside]

    @property
    def objects(self) -> tuple[str, ...]:
        """The objects that occur, sorted."""
        return tuple(sorted({f.object_id for folder in self.folders for f in folder.files}))


def open_part(roots: Sequence[str | Path], experiment: Experiment, part: Part) -> FrameSource:
    """Open one part of an experiment's frames.

    Args:
        roots: Data folders in TransHand's layout, joined in this order.
        experiment: "known", "unknown" or "by-frame".
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
        wanted = list(OBJECT_IDS)
    elif experiment == "by-frame":
        return _dealt_out(roots, part)
    elif part == "test":
        wanted, splits = sorted(unseen), SPLITS
    else:
        wanted = [name for name in OBJECT_IDS if name not in unseen]
    return FrameSource([TransHand(root, splits, wanted) for root in roots])


def _dealt_out(roots: Sequence[str | Path], part: Part) -> FrameSource:
    """Deal the known objects' frames out to the parts one by one, always in the same way."""
    sizes = [len(open_part(roots, "known", each)) for each in PARTS_OF_DATA]
    whole = FrameSource([TransHand(root, SPLITS, list(OBJECT_IDS)) for root in roots])
    dealt = split_by_frame(len(whole), np.random.default_rng(0), sizes)
    return FrameSource(whole.folders, np.flatnonzero(dealt == part).tolist())


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
