"""Where commands may write: what is refused, and which folders may be replaced or removed whole.

A folder that hadr made holds a marker, or is the checkout's ``build``. Any other is somebody's own:
files are put into it where that is asked for, but it is never replaced or removed.

    python -m hadr.records.output_folder build            removes it, as `make clean` does
    python -m hadr.records.output_folder --check build    refuses it if it can't take what is made
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import os
import shutil
import sys
import tempfile
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path

from hadr.records.checkout import checkout_root

MARKER = ".made-by-hadr"
_OURS = ".hadr-"  # how locks and drafts begin (`hadr.records.writing`)
CACHE = "hadr-cache"
"""Name of the folder in which the Makefile and the chapters keep caches: no output of its own."""
SPLITS = ("train", "val", "test")
"""The folders of a data set."""
VIEW = "view.html"
"""The page that `hadr view` adds to a result."""
SOURCES = (
    "benchmarks", "binder", "book", "data_samples", "hadr", "notebooks", "results", "tests",
    ".ci", ".git", ".github",
)  # fmt: skip
"""The checkout's own folders."""


def check_file(path: str | Path | None, **fields: str) -> None:
    """Refuse a file for results that can't be written, before anything is computed for it.

    Args:
        path: The file; None is always right. What is there is replaced only if it is a file of
            `fields`, as it was written: never an input, a checkpoint, a link or a device.
        fields: As `wrote`; without them no file that is there is opened.

    Raises:
        ValueError: It is a folder, no regular file, or not the same command's; or a part of its
            path is a file, or may not be written to.
    """
    if path is None:
        return
    path = Path(path)
    if path.is_dir():
        raise ValueError(f"{path} is a folder, expected the name of a file to write")
    _check_no_file(path.parent)
    check_apart(path)
    parent = next(part for part in path.absolute().parents if part.exists())
    if not os.access(parent, os.W_OK | os.X_OK):
        raise ValueError(f"can't write {path}: no permission for the folder {parent}")
    try:  # as root, and on some file systems, a permission is no promise
        tempfile.TemporaryFile(dir=parent).close()
    except OSError as error:
        raise ValueError(f"can't write {str(path)!r}: {error.strerror} in {parent}") from error
    if path.is_symlink() or (path.exists() and not path.is_file()):
        raise ValueError(f"{path} is a link or a device, which is not replaced; name another file")
    if path.exists() and fields and not wrote(path, **fields):
        raise ValueError(
            f"{path} is not replaced: no earlier run of this command wrote it, or it was changed "
            "since; name another file"
        )


def check_free(path: Path | None) -> None:
    """Refuse a file in a folder that a run has to itself, such as a training: it may write it.

    Raises:
        ValueError: A run has it (`hadr.records.writing.sole_owner`); the message says which.
    """
    from hadr.records.writing import LOCK  # `make clean` does without

    with contextlib.suppress(FileNotFoundError, ImportError):
        import fcntl  # no locks on Windows

        if path is not None:
            with (path.parent / LOCK).open("rb") as lock:
                try:
                    fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
                except BlockingIOError:
                    owner = lock.read(1000).decode(errors="replace") or "another run"
                    raise ValueError(
                        f"{path} is left alone: {path.parent} is taken by {owner}; wait for its "
                        "end, or name a file elsewhere"
                    ) from None


def wrote(path: Path, **fields: str) -> bool:
    """Whether a file is a command's own record: JSON with these fields, each of which begins so.

    It must fit the checksum that closes it (`hadr.records.result_file`).
    """
    if not path.is_file():
        return False
    from hadr.records.result_file import is_sealed  # `make clean` does without

    if not is_sealed(path):
        return False
    found = json.loads(path.read_text(encoding="utf-8"))
    return all(name in found and str(found[name]).startswith(text) for name, text in fields.items())


def check_folder(path: str | Path) -> None:
    """Refuse, by a ValueError, a folder that is or lies in a file; also as `check_apart`."""
    _check_no_file(path)
    check_apart(Path(path) / "result")


def _check_no_file(path: str | Path) -> None:
    path = Path(path)
    parts = (path, *path.parents)
    there = next((part for part in parts if part.is_symlink() or part.exists()), None)
    if there is not None and not there.is_dir():
        kind = "a file" if there.exists() else "a link that leads nowhere"
        raise ValueError(f"{path} can't be a folder: {there} is {kind}")


def check_apart(path: str | Path) -> None:
    """Refuse a place for results in a data set's split, or in a result of ``hadr restore``.

    The one could no longer be read, the other would not be as it was written. In a result only the
    page of ``hadr view`` has a place.

    Raises:
        ValueError: It lies there, links followed.
    """
    place = Path(os.path.realpath(path))  # which bears links that lead nowhere
    for part in (place, *place.parents):
        frames = (any(part.glob(f"*/{rgb}")) for rgb in ("rgb", "depth/rgb"))
        if part.name in SPLITS and any(frames):
            raise ValueError(
                f"{path} lies among the frames of {part.parent}, which could no longer be read: "
                "name another place"
            )
        records = (part / name for name in ("report.json", "sequence.json") if part != place)
        if place.name != VIEW and any(wrote(record, command="hadr restore") for record in records):
            raise ValueError(
                f"{path} would lie in {part}, a result of 'hadr restore', which is then not as it "
                "was written: name another place"
            )


def check_replaceable(
    folder: Path,
    asked: bool,
    record: str,
    inputs: Iterable[str],
    pages: Collection[str] = (),
    parts: Collection[str] = (),
    **fields: str,
) -> None:
    """Refuse to replace a folder that is not an earlier result.

    Args:
        folder: It may be missing or empty.
        asked: Whether a result may be replaced at all.
        record: The file that is known by `fields`; its `outputs` have the ``sha256`` of each other.
        inputs: Files that are read.
        pages: Names of pages that another command adds (`hadr.records.result_file.sealed_page`).
        parts: Names of folders that are results of their own.
        fields: As `wrote`.

    Raises:
        ValueError: It is no folder; or it holds something else, a file that was changed since,
            or an input.
    """
    from hadr.records.result_file import is_sealed_page

    _check_no_file(folder)
    present = sorted(entry.name for entry in folder.iterdir()) if folder.exists() else []
    if not present:
        return
    more = f" and {len(present) - 1} more" if len(present) > 1 else ""
    if not asked:
        raise ValueError(
            f"output folder {folder} already holds {present[0]}{more}; choose a new name, or "
            "--overwrite to replace an earlier result"
        )
    own = wrote(folder / record, **fields)
    told = json.loads((folder / record).read_text(encoding="utf-8")) if own else {}
    written = told.get("outputs") or {}

    def as_written(name: str) -> bool:
        path = folder / name
        if not path.is_file():
            return name in parts
        if name in pages:
            return is_sealed_page(path)
        checksum = hashlib.sha256(path.read_bytes()).hexdigest()
        return name == record or (name in written and written[name]["sha256"] == checksum)

    strange = [name for name in present if not (own and as_written(name))]
    if strange:
        raise ValueError(
            f"output folder {folder} holds {strange[0]}, which no run like this one wrote, or "
            "which was changed since; it is not replaced, choose another folder"
        )
    for path in inputs:
        if folder.resolve() in Path(path).resolve().parents:
            raise ValueError(f"output folder {folder} is not replaced: {path}, an input, is in it")


def check_output_folder(folder: str | Path) -> Path:
    """Refuse a folder for results, which may be missing, in or among sources; give its real path.

    ValueError where it has no name, or is a file; or it is, contains or lies in one of the
    checkout's own folders.
    """
    if not str(folder).strip():
        raise ValueError("expected the name of a folder for what is made, got an empty one")
    check_folder(folder)
    target = Path(folder).resolve()
    for source in _sources():
        around = (*source.parents, *source.resolve().parents)
        if any(_same(part, source) for part in (target, *target.parents)):
            word = "is" if _same(target, source) else "lies in"
        elif any(_same(part, target) for part in around):
            word = "contains"
        else:
            continue
        raise ValueError(
            f"{folder} can't take what is made: it {word} {source}, which is no output; "
            "name another folder"
        )
    return target


def make_output_folder(folder: str | Path) -> Path:
    """Make a folder for results, and mark it as hadr's where nobody's files are in it yet.

    As `check_output_folder`, and OSError where it can't be made or written.
    """
    target = check_output_folder(folder)
    own = not target.exists() or _is_own(target)
    own = own or all(e.name == CACHE or (e / MARKER).is_file() for e in target.iterdir())
    target.mkdir(parents=True, exist_ok=True)
    if own:
        words = "hadr made this folder: `make clean` may remove it with all that is in it.\n"
        (target / MARKER).write_text(words, encoding="utf-8")
    return target


def check_removable(folder: str | Path) -> Path:
    """Refuse to remove or replace a folder that hadr did not make; gives its absolute path.

    ValueError as `check_output_folder`, or where it is there without a marker.
    """
    target = check_output_folder(folder)
    if target.exists() and not _is_own(target):
        raise ValueError(
            f"{folder} was not made by hadr (no {MARKER} lies in it), so nothing in it is removed "
            "or replaced: move it away, or name another folder"
        )
    return target


def check_own(folder: str | Path) -> None:
    """Refuse a folder for results in which somebody else's files lie; errors as above."""
    target = check_output_folder(folder)
    if target.exists() and any(not e.name.startswith(_OURS) for e in target.iterdir()):
        check_removable(folder)


def remove_output_folder(folder: str | Path) -> None:
    """Remove a folder that hadr made, with all that is in it; a missing one is no error."""
    target = check_removable(folder)
    if target.exists():
        shutil.rmtree(target)
        if Path(folder).is_symlink():
            Path(folder).unlink()


def _sources() -> list[Path]:
    """The library's own folder, and those of the checkout, where there is one."""
    found = [Path(__file__).resolve().parents[1]]
    with contextlib.suppress(FileNotFoundError):
        found += [checkout_root() / name for name in SOURCES]
    return found


def _same(one: Path, other: Path) -> bool:
    """Whether two paths lead to one folder, also where a file system has two names for it."""
    return one == other or (one.exists() and other.exists() and one.samefile(other))


def _is_own(folder: Path) -> bool:
    """Whether a folder is marked, is or lies in the checkout's ``build``, or holds caches alone."""
    with contextlib.suppress(FileNotFoundError):
        if (checkout_root() / "build").resolve() in (folder, *folder.parents):
            return True
    return (folder / MARKER).is_file() or {entry.name for entry in folder.iterdir()} == {CACHE}


def main(arguments: Sequence[str] | None = None) -> int:
    """Remove a folder that was made.

    Returns:
        0 when it is gone, or may take what is made; 2 when it is not hadr's to remove, or may not.
    """
    parser = argparse.ArgumentParser(
        prog="python -m hadr.records.output_folder", description="Remove a folder that hadr made."
    )
    parser.add_argument("folder", help="such as build")
    parser.add_argument("--check", action="store_true", help="only refuse it, remove nothing")
    args = parser.parse_args(arguments)
    try:
        (check_output_folder if args.check else remove_output_folder)(args.folder)
    except (ValueError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
