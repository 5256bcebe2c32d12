"""An output folder that is never half-written and never swallows somebody's work.

Everything is written beside the target and takes its place at the end. A list of checksums in the
folder says what was written, so a later run knows its own files from changed and foreign ones.
"""

import contextlib
import hashlib
import json
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from hadr.records.output_folder import check_output_folder
from hadr.records.writing import whole_folder

MANIFEST = "course.json"
MADE_BY = "hadr course"


def _checksums(folder: Path) -> dict[str, str]:
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path != folder / MANIFEST
    }


def check_target(out: Path) -> None:
    """Refuse a folder that is neither missing, nor empty, nor as an earlier run left it."""
    check_output_folder(out)
    if not out.exists() or not any(out.iterdir()):
        return
    try:
        known = json.loads((out / MANIFEST).read_text(encoding="utf-8"))
        files = known["files"] if known["made_by"] == MADE_BY else None
    except (OSError, ValueError, KeyError, TypeError):
        files = None
    if not isinstance(files, dict):
        raise ValueError(
            f"--out {out} is not empty, and `{MADE_BY}` did not write it; name a new folder"
        )
    present = _checksums(out)
    changed = sorted(name for name, checksum in present.items() if files.get(name) != checksum)
    if changed:
        listed = ", ".join(changed[:3]) + (f" and {len(changed) - 3} more" if changed[3:] else "")
        raise ValueError(
            f"--out {out} holds files that were added or changed since `{MADE_BY}` wrote it: "
            f"{listed}; move them away or name a new folder"
        )


@contextlib.contextmanager
def written_whole(out: Path, about: Mapping[str, Any]) -> Iterator[Path]:
    """Give a folder to write into that becomes ``out`` with a list of checksums, or nothing does.

    ``about`` is what else the list says.
    """
    with whole_folder(out, MADE_BY, partial(check_target, out)) as fresh:
        yield fresh
        content = {"made_by": MADE_BY, **about, "files": _checksums(fresh)}
        text = json.dumps(content, indent=1, ensure_ascii=False) + "\n"
        (fresh / MANIFEST).write_text(text, encoding="utf-8")
