"""Finds the small data set that comes with the project, and checks that it is whole."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import hadr
from hadr.data.splits import OBJECT_IDS, UNKNOWN_OBJECTS
from hadr.data.transhand import SPLITS, TransHand
from hadr.records.reading import read_json, structured
from hadr.records.writing import write_whole

MANIFEST = "manifest.json"


@dataclass(frozen=True)
class ManifestReport:
    """What a check of the manifest found.

    Args:
        checked: Number of files whose SHA-256 agrees.
        changed: Files with other contents than the manifest says.
        missing: Files that the manifest names and that are not there.
        unlisted: Files that the manifest does not name.
    """

    checked: int
    changed: tuple[str, ...]
    missing: tuple[str, ...]
    unlisted: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Every listed file is there and unchanged."""
        return not self.changed and not self.missing


def samples_dir() -> Path:
    """The folder ``data_samples``: ``$HADR_SAMPLES`` if set, else the checkout's.

    Raises:
        FileNotFoundError: Neither is a folder; the message says how to get one.
    """
    chosen = os.environ.get("HADR_SAMPLES")
    if chosen:
        if not Path(chosen).is_dir():
            raise FileNotFoundError(f"HADR_SAMPLES names {chosen!r}, which is not a folder")
        return Path(chosen)
    folder = Path(hadr.__file__).resolve().parents[1] / "data_samples"
    if not folder.is_dir():
        raise FileNotFoundError(
            "data_samples not found: it is part of a git checkout, not of the installed package. "
            "Clone the repository and install it with 'pip install -e .', set HADR_SAMPLES to its "
            "data_samples folder, or make frames with 'hadr generate'"
        )
    return folder


def open_samples(split: str, objects: Sequence[str] | None = None) -> TransHand:
    """Open one split of the bundled frames, of all objects or of some."""
    return TransHand(samples_dir() / "frames", split, objects)


def open_known_unknown(root: Path | None = None) -> dict[str, TransHand]:
    """Open a data set (the bundled one) as the paper's experiment with unknown objects.

    ``train``, ``val`` and ``known`` (the test holds) are of six objects, ``unknown`` of all holds
    of 0004 and 0007; no holding pose occurs in two of them. FileNotFoundError where some are
    missing.
    """
    root = samples_dir() / "frames" if root is None else root
    six = [name for name in OBJECT_IDS if name not in UNKNOWN_OBJECTS]
    parts = {"train": "train", "val": "val", "known": "test"}
    opened = {name: TransHand(root, split, six) for name, split in parts.items()}
    return {**opened, "unknown": TransHand(root, SPLITS, UNKNOWN_OBJECTS)}


def open_gallery() -> TransHand:
    """Open the few bundled frames of 1280x720, of all splits; FileNotFoundError without them."""
    root = samples_dir() / "gallery"
    if not root.is_dir():
        raise FileNotFoundError(
            f"{root} is not there; make it with 'hadr generate --preset gallery --out {root}'"
        )
    return TransHand(root, [split for split in SPLITS if (root / split).is_dir()])


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _files(root: Path) -> list[str]:
    return sorted(
        path.relative_to(root).as_posix()
        for path in root.rglob("*")
        if path.is_file() and path.name != MANIFEST and not path.name.startswith(".")
    )


def write_manifest(root: Path | None = None) -> Path:
    """Write the SHA-256 of every file below ``root`` (``data_samples``) into its manifest."""
    root = samples_dir() if root is None else root
    listed = {name: _digest(root / name) for name in _files(root)}
    path = root / MANIFEST
    write_whole(path, json.dumps({"sha256": listed}, indent=0) + "\n")
    return path


@dataclass(frozen=True)
class _Manifest:
    """SHA-256 of each file by its name."""

    sha256: dict[str, str]


def verify_manifest(root: Path | None = None) -> ManifestReport:
    """Compare the files below ``root`` (``data_samples``) with its manifest.

    Raises:
        FileNotFoundError: There is no manifest.
        ValueError: The manifest is none.
    """
    root = samples_dir() if root is None else root
    path = root / MANIFEST
    if not path.is_file():
        raise FileNotFoundError(f"no {MANIFEST} in {root}")
    listed = structured(read_json(path), _Manifest, path, further=True).sha256
    present = set(_files(root))
    missing = tuple(name for name in listed if name not in present)
    changed = tuple(n for n in listed if n in present and _digest(root / n) != listed[n])
    unlisted = tuple(sorted(present - set(listed)))
    checked = len(listed) - len(missing) - len(changed)
    return ManifestReport(checked, changed, missing, unlisted)
