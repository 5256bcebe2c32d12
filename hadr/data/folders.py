"""Data sets on disk: how commands open a folder of frames, and how they join several.

To read another layout, write a reader with the members of `FrameFolder` beside
`hadr.data.transhand`, and have `open_folder` choose it by what the folder holds.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol, overload

from hadr.data.frame import Frame
from hadr.data.transhand import SPLITS, TransHand


class FrameFolder(Protocol):
    """Some splits of a data set; a frame is read when it is asked for."""

    def __len__(self) -> int:
        """Give the number of frames."""

    def __getitem__(self, index: int, /) -> Frame:
        """Read a frame."""

    @property
    def names(self) -> Sequence[str]:
        """Name of each frame, OBJECT/STEM, without reading pictures."""

    @property
    def hold_ids(self) -> Sequence[str | None]:
        """The holding pose of each frame, without reading pictures; None where it is not known."""


def open_folder(
    root: str | Path, split: str | Sequence[str], objects: Sequence[str] | None = None
) -> FrameFolder:
    """Open one split of a data folder, or several; arguments and errors as of `TransHand`."""
    return TransHand(root, split, objects)


def has_split(root: str | Path, split: str) -> bool:
    """Whether a data folder has such a split."""
    return (Path(root) / split).is_dir()


def check_folders(folders: Sequence[str | Path]) -> None:
    """Refuse data folders of which one is no data folder, or is named twice.

    Raises:
        FileNotFoundError: One does not exist, or has none of the splits.
        ValueError: One is named twice, and its frames would count twice.
    """
    for number, folder in enumerate(folders):
        if not Path(folder).is_dir():
            raise FileNotFoundError(f"there is no data folder {folder}")
        if not any(has_split(folder, split) for split in SPLITS):
            raise FileNotFoundError(f"{folder} has none of the folders {', '.join(SPLITS)}")
        if any(Path(folder).samefile(other) for other in folders[:number]):
            raise ValueError(f"{folder} is named twice; its frames would count twice")


def data_digest(root: str | Path) -> str:
    """SHA-256 over the names and contents of all files of a data folder, in the names' order.

    Hidden files are left out. FileNotFoundError where there is no such folder, or it is empty.
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


class FrameSource(Sequence[Frame]):
    """Some frames of some data folders, one after the other, read when asked for.

    Args:
        folders: The parts of the data folders that are joined, in this order.
        chosen: Numbers of the frames that belong to it, in its order; all where it is left out.
    """

    def __init__(self, folders: Sequence[FrameFolder], chosen: Sequence[int] | None = None) -> None:
        self.folders = tuple(folders)
        places = [(folder, number) for folder in range(len(self.folders))
                  for number in range(len(self.folders[folder]))]  # fmt: skip
        self._places = places if chosen is None else [places[number] for number in chosen]

    def __len__(self) -> int:
        return len(self._places)

    @overload
    def __getitem__(self, index: int) -> Frame: ...

    @overload
    def __getitem__(self, index: slice) -> list[Frame]: ...

    def __getitem__(self, index: int | slice) -> Frame | list[Frame]:
        """Read one frame, or several."""
        if isinstance(index, slice):
            return [self[number] for number in range(len(self))[index]]
        folder, number = self._places[index]
        return self.folders[folder][number]

    @property
    def names(self) -> list[str]:
        """Name of each frame, OBJECT/STEM."""
        names = [folder.names for folder in self.folders]
        return [names[folder][number] for folder, number in self._places]

    def holds(self, names: Sequence[str]) -> list[str]:
        """Say which hold each of some frames, OBJECT/STEM, shows; frames of one hold are alike.

        A hold has another name in each data folder and for each object; where it is not known it is
        the frame's own. ValueError for a frame that is not there, or not in the folders' order.
        """
        logged = [folder.hold_ids for folder in self.folders]
        listed = (
            (name, f"{folder}/{name.partition('/')[0]}/{logged[folder][number] or name}")
            for name, (folder, number) in zip(self.names, self._places, strict=True)
        )
        holds = []
        for wanted in names:
            hold = next((hold for name, hold in listed if name == wanted), None)
            if hold is None:
                raise ValueError(f"there is no frame {wanted!r} here, or not in this order")
            holds.append(hold)
        return holds
