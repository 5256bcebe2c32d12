"""Result files: rows of measured numbers with where they come from, closed by a checksum.

The book's tables are drawn from such files and nothing else. A number that was changed by hand no
longer fits the checksum, and reading the file says so.

    {"what": "...", "rows": [{"method": "hadr", "split": "known", "rmse_m": 0.01, ...}, ...],
     "provenance": {..., "sha256": "..."}}
"""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hadr.records.provenance import plain, write_json
from hadr.records.reading import read_json, structured
from hadr.records.writing import set_aside


@dataclass(frozen=True)
class ResultFile:
    """What a result file holds.

    Attributes:
        what: What was measured, on which frames, under which protocol.
        rows: The rows, each by the columns' names.
        provenance: Commit, versions, machine, hashes of configuration and data, the checksum.
    """

    what: str
    rows: tuple[dict[str, Any], ...]
    provenance: dict[str, Any]

    def row(self, **wanted: Any) -> dict[str, Any]:
        """Give the one row with these values, such as ``method="hadr", split="known"``.

        Raises:
            KeyError: There is no such row, or more than one.
        """
        found = [r for r in self.rows if all(r.get(k) == v for k, v in wanted.items())]
        if len(found) != 1:
            asked = ", ".join(f"{key} = {value!r}" for key, value in wanted.items())
            raise KeyError(f"{len(found)} of {len(self.rows)} rows have {asked}, expected one")
        return found[0]


def read_result_files(folder: str | Path, *names: str) -> ResultFile:
    """Read result files of a folder as one: all rows, the first one's words and origin.

    Names are given without ``.json``; errors as `read_result_file`.
    """
    files = [read_result_file(Path(folder) / f"{name}.json") for name in names]
    rows = tuple(row for file in files for row in file.rows)
    return ResultFile(files[0].what, rows, files[0].provenance)


def digest(content: Any) -> str:
    """SHA-256 of plain values, whatever the order of their keys: 64 hexadecimal digits."""
    text = json.dumps(plain(content), sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


def write_result_file(
    path: str | Path, what: str, rows: Sequence[Mapping[str, Any]], provenance: Mapping[str, Any]
) -> None:
    """Write a result file of rows, one at least, whole or not at all; NaN becomes null."""
    if not rows:
        raise ValueError(f"no rows for {path}: nothing was measured")
    write_sealed(path, {"what": what, "rows": list(rows), "provenance": dict(provenance)})


def write_sealed(path: str | Path, content: Mapping[str, Any]) -> dict[str, Any]:
    """Write plain values with a checksum beside their ``provenance``, whole or not at all.

    Gives what was written. A file that was changed since is kept beside it
    (`hadr.records.writing.set_aside`). KeyError where nothing stands under ``provenance``,
    TypeError for what has no form in JSON.
    """
    sealed = dict(plain(content))
    sealed["provenance"] = {k: v for k, v in sealed["provenance"].items() if k != "sha256"}
    sealed["provenance"]["sha256"] = digest(sealed)
    _replace(Path(path), sealed)
    return sealed


def read_sealed(path: str | Path) -> dict[str, Any]:
    """Read what `write_sealed` wrote and compare it with its checksum.

    Returns:
        The content, with ``sha256`` under ``provenance``.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It is not such a file, or it was changed after it was written.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"there is no result file {path}")
    content = read_json(path)
    sealed = structured(content, _Sealed, path, further=True)
    if (stored := sealed.provenance.get("sha256")) is None:
        raise ValueError(f"{path}: provenance: lacks sha256")
    if plain(content) != content:
        raise ValueError(f"{path} holds NaN or infinity, which is not JSON")
    if not unchanged(content):
        raise ValueError(
            f"{path} was changed after it was measured: its content does not fit its checksum "
            f"{str(stored)[:12]}...; measure it again instead of editing it"
        )
    return dict(content)


def read_result_file(path: str | Path) -> ResultFile:
    """Read what `write_result_file` wrote; errors as `read_sealed`."""
    content = structured(read_sealed(path), ResultFile, path, further=True)
    if not content.rows or not all(content.rows):
        raise ValueError(f"{path}: rows: expected rows of numbers, got {content.rows!r:.60}")
    return content


@dataclass(frozen=True)
class _Sealed:
    """What each file with a checksum has."""

    provenance: dict[str, Any]


def is_sealed(path: Path) -> bool:
    """Whether a file is JSON that fits the checksum in it."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(content, dict) and unchanged(content)


def unchanged(content: Mapping[str, Any]) -> bool:
    """Whether JSON that was read still fits its checksum, at the top or under ``provenance``."""
    where = content.get("provenance")
    if isinstance(where, dict) and "sha256" in where:
        rest = {**content, "provenance": {k: v for k, v in where.items() if k != "sha256"}}
        return bool(digest(rest) == where["sha256"])
    rest = {k: v for k, v in content.items() if k != "sha256"}
    return bool(digest(rest) == content.get("sha256"))


def sealed_page(page: str) -> str:
    """An HTML page with a checksum as its last line, by which `is_sealed_page` knows it."""
    return f"{page}\n<!-- sha256 {hashlib.sha256(page.encode()).hexdigest()} -->\n"


def is_sealed_page(path: Path) -> bool:
    """Whether a file is what `sealed_page` gave, unchanged."""
    page, seal, _ = path.read_bytes().rpartition(b"\n<!-- sha256 ")
    return seal != b"" and path.read_bytes() == sealed_page(page.decode(errors="replace")).encode()


def sealed_row(path: Path, configuration: Mapping[str, Any]) -> dict[str, Any] | None:
    """Read a row, if it is there, whole, untouched, and was measured with this configuration."""
    with contextlib.suppress(OSError, ValueError):
        row = read_json(path)
        if isinstance(row, dict) and row.get("config_sha256") == digest(configuration):
            return row if unchanged(row) else None
    return None


def seal_row(path: Path, row: Mapping[str, Any]) -> dict[str, Any]:
    """Write a row with the checksum by which `sealed_row` knows it; what it replaces as above."""
    content = dict(plain(row))
    content.pop("sha256", None)
    content["sha256"] = digest(content)
    _replace(path, content)
    return content


def _replace(path: Path, content: Mapping[str, Any]) -> None:
    if path.is_file() and not is_sealed(path):
        set_aside(path)
    write_json(path, content)
