"""What a finished chapter was made from, so that it need not be made again.

OUT/results/NAME/chapter.json   sealed: the notebook's, the library's and the data's checksums,
                                preset, seed, and how long it took
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from hadr.checkout import checkout_root
from hadr.result_file import digest, seal_row, sealed_row

RECORD = "chapter.json"


def chapter_configuration(notebook: Path, preset: str, seed: int) -> dict[str, Any]:
    """Everything on which a chapter's numbers depend, the installed packages aside.

    Args:
        notebook: The notebook, not executed.
        preset: Its parameter ``preset``.
        seed: Its parameter ``seed``.
    """
    return {
        "chapter": notebook.stem,
        "notebook": _digest([notebook]),
        "preset": preset,
        "seed": seed,
        **_surroundings(),
    }


def finished_chapter(folder: Path, configuration: dict[str, Any], *made: Path) -> float | None:
    """Say how long a chapter took, if it is finished.

    Args:
        folder: Its folder, ``OUT/results/NAME``.
        configuration: `chapter_configuration`.
        *made: Files that must be there, too.

    Returns:
        Wall-clock seconds of its execution; None where it has to be executed.
    """
    row = sealed_row(folder / RECORD, configuration)
    if row is None or not all(path.is_file() for path in made):
        return None
    return float(row["duration_s"])


def keep_chapter(folder: Path, configuration: dict[str, Any], duration_s: float) -> None:
    """Note that a chapter is finished.

    Args:
        folder: Its folder.
        configuration: `chapter_configuration`.
        duration_s: Wall-clock seconds of its execution.
    """
    row = {"configuration": configuration, "duration_s": duration_s}
    seal_row(folder / RECORD, {**row, "config_sha256": digest(configuration)})


@cache
def _surroundings() -> dict[str, str]:
    """Checksums of the library, and of the result files and samples that chapters read."""
    library = Path(__file__).resolve().parent
    found = {"library": _digest(sorted(library.rglob("*.py")))}
    try:
        root = checkout_root()
    except FileNotFoundError:
        return found
    found["results"] = _digest(sorted((root / "results").rglob("*.json")))
    samples = root / "data_samples" / "manifest.json"
    return found | ({"samples": _digest([samples])} if samples.is_file() else {})


def _digest(paths: Iterable[Path]) -> str:
    whole = hashlib.sha256()
    for path in paths:
        whole.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return whole.hexdigest()
