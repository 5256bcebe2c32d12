"""What a finished chapter was made from, so that it need not be made again.

``OUT/results/NAME/chapter.json`` says, sealed, what the chapter depends on
(`hadr.records.dependencies`), how long it took, and on which machine.
"""

import hashlib
import json
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from hadr.records.checkout import checkout_root
from hadr.records.dependencies import code_digest, named_modules
from hadr.records.provenance import machine_text, provenance
from hadr.records.reading import read_json
from hadr.records.result_file import digest, is_sealed, seal_row, sealed_row, write_sealed
from hadr.records.writing import set_aside

RECORD = "chapter.json"


def chapter_configuration(notebook: Path, preset: str, seed: int) -> dict[str, Any]:
    """Everything on which a chapter's numbers depend, the installed packages aside."""
    return {
        "chapter": notebook.stem,
        "notebook": _digest([notebook]),
        "preset": preset,
        "seed": seed,
        "code": code_digest(*named_modules(_code(notebook))),
        **_data(),
    }


def finished_chapter(folder: Path, configuration: dict[str, Any], *made: Path) -> float | None:
    """Seconds that a chapter took in its folder OUT/results/NAME; None where it is unfinished.

    It is finished for a `chapter_configuration`, and if what it has ``made`` is as it was then.
    """
    row = sealed_row(folder / RECORD, configuration)
    if row is None or row.get("made") != _checksums(made):
        return None
    return float(row["duration_s"])


def keep_chapter(
    folder: Path, configuration: dict[str, Any], duration_s: float, *made: Path
) -> None:
    """Note that a chapter is finished, and what it has made."""
    row = {"configuration": configuration, "duration_s": duration_s, "machine": machine_text()}
    row |= {"made": _checksums(made), "config_sha256": digest(configuration)}
    seal_row(folder / RECORD, row)


def keep_unfinished(folder: Path, *made: Path) -> None:
    """Note what a chapter has made that stopped."""
    seal_row(folder / RECORD, {"made": _checksums(made)})


def keep_changed(folder: Path, *made: Path) -> None:
    """Keep what is there and is not as a chapter made it, before it is executed again."""
    record = folder / RECORD
    before = read_json(record).get("made", {}) if is_sealed(record) else {}
    for path in made:
        if path.is_file() and before.get(path.name) != _digest([path]):
            set_aside(path)


def _checksums(paths: Iterable[Path]) -> dict[str, str]:
    return {path.name: _digest([path]) for path in paths if path.is_file()}


def keep_results(
    out: Path, notebooks: Sequence[Path], preset: str, seed: int, say: Callable[[str], None] = print
) -> dict[str, Any]:
    """Gather what all chapters measured in one file, ``OUT/results.json``, and give what it holds.

    Chapters that were executed before are in it as well, each with its machine and provenance, if
    they are finished with this preset and seed and as they are now (`hadr.records.dependencies`);
    a line says where some are missing.
    """
    chapters = {}
    for notebook in notebooks:
        folder = out / "results" / notebook.stem
        record = sealed_row(folder / RECORD, chapter_configuration(notebook, preset, seed))
        if record is None:
            continue
        results = folder / "results.json"
        try:
            content = json.loads(results.read_text(encoding="utf-8")) if results.exists() else {}
            kept = {name: content.get(name) for name in ("results", "provenance")}
        except (OSError, ValueError, AttributeError) as error:
            say(f"{results} can't be read: {error}")
            continue
        seconds = round(record["duration_s"], 3)
        chapters[notebook.stem] = {"duration_s": seconds, "machine": record["machine"], **kept}
    if len(chapters) < len(notebooks):
        say(
            f"{out / 'results.json'} has {len(chapters)} of {len(notebooks)} chapters: the others "
            f"were not executed, as they are now, with preset {preset} and seed {seed}"
        )
    whole = {
        "parameters": {"preset": preset, "seed": seed},
        "chapters": chapters,
        "machine": machine_text(),
        "provenance": provenance(),
    }
    return write_sealed(out / "results.json", whole)


def _code(notebook: Path) -> str:
    """The code of all cells of a notebook."""
    cells = json.loads(notebook.read_text(encoding="utf-8")).get("cells", [])
    return "\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "code")


@cache
def _data() -> dict[str, str]:
    """Checksums of the result files and of the samples that chapters read."""
    root = checkout_root()
    files = sorted(path for path in (root / "results").rglob("*") if path.is_file())
    manifest = root / "data_samples" / "manifest.json"
    return {"results": _digest(files), "samples": _digest([manifest])}


def _digest(paths: Iterable[Path]) -> str:
    whole = hashlib.sha256()
    for path in paths:
        whole.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return whole.hexdigest()
