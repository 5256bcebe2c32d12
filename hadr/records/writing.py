"""How results are written: whole or not at all, and by one run at a time.

What is being written lies beside its place under a name that begins with `PART`; a run that is
killed leaves it there, and the next one that has the folder to itself (`sole_owner`) sweeps it.
"""

from __future__ import annotations

import contextlib
import datetime
import io
import os
import shutil
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hadr.records.output_folder import MARKER

if TYPE_CHECKING:
    import numpy.typing as npt

PART = ".hadr-part-"
"""How the names begin of what is not finished."""
LOCK = ".hadr-lock"
"""The file by which a run has a folder to itself, with words that say which run."""


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a name to write to; the file takes its place when all went well, else it is removed.

    Args:
        path: The file; its folder is made. One that is there is replaced.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{PART}{os.getpid()}-{threading.get_ident()}{path.suffix}")
    try:
        with _told_of(path, part):
            yield part
            os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


@contextlib.contextmanager
def _told_of(target: Path, draft: Path) -> Iterator[None]:
    """Have errors of a draft name what was to be written, which is what the caller knows."""
    try:
        yield
    except OSError as error:
        if error.filename is not None and str(error.filename).startswith(str(draft)):
            words = f"the output can't be written ({os.strerror(error.errno or 0)})"
            raise OSError(error.errno, words, str(target)) from error
        raise


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file, whole or not at all; its folder is made."""
    with whole_file(path) as part:
        part.write_bytes(content.encode() if isinstance(content, str) else content)


def set_aside(path: Path) -> None:
    """Keep a file that somebody changed under another name, and say so, before it is replaced."""
    names = (path.with_name(f"{path.name}.changed{n}") for n in ("", *range(2, 1000)))
    kept = next(name for name in names if not name.exists())
    path.rename(kept)
    print(f"{path} is not as a run of this version wrote it; it is kept as {kept}", file=sys.stderr)


def write_arrays(path: Path, **arrays: npt.NDArray[Any]) -> None:
    """Write a compressed ``.npz``, whole or not at all; its folder is made."""
    import numpy as np

    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]  # they are arrays
    write_whole(path, stream.getvalue())


@contextlib.contextmanager
def whole_folder(target: Path, command: str, check: Callable[[], object]) -> Iterator[Path]:
    """Give a folder to write into; it takes its place when all went well, else it is removed.

    Args:
        target: The folder's name. One that is there is replaced, also after a crash whole.
        command: Who writes it, such as ``hadr restore``.
        check: Raises where what is there is not to be replaced; it is asked at both ends.

    Raises:
        ValueError: Another run writes it.
    """
    check()
    target = target.resolve()
    if target == Path.cwd() or os.path.ismount(target):
        raise ValueError(
            f"{target} is the current folder or a disk's, which can't be replaced whole: name a "
            "folder in it"
        )
    workshop = target.with_name(f".{target.name}.hadr")
    draft, former = workshop / "draft", workshop / "former"
    strange = set(os.listdir(workshop)) - {LOCK, MARKER} if workshop.is_dir() else set()
    if workshop.is_symlink() or (strange and not (workshop / MARKER).is_file()):
        raise ValueError(
            f"{workshop}, where {target.name} would be written first, is somebody's own: move it "
            "away, or name another folder"
        )

    def tidy() -> None:
        if former.exists() and not target.exists():  # stopped between the two renames
            former.rename(target)
        for left in (draft, former):
            shutil.rmtree(left, ignore_errors=True)

    try:
        with _told_of(target, workshop), sole_owner(workshop, command):
            (workshop / MARKER).touch()
            tidy()
            try:
                draft.mkdir()
                yield draft
                check()
                if target.exists():
                    shutil.copymode(target, draft)
                    target.rename(former)
                draft.rename(target)
            finally:
                tidy()
                (workshop / MARKER).unlink(missing_ok=True)
    finally:
        with contextlib.suppress(OSError):
            workshop.rmdir()


@contextlib.contextmanager
def sole_owner(folder: str | Path, command: str) -> Iterator[Path]:
    """Have a folder to oneself, and sweep what is unfinished in it: a killed run's, and one's own.

    The lock is the operating system's: it ends with the process, however that ends. Where there
    is none (Windows, some network file systems) nothing is locked, which is said once.

    Args:
        folder: It is made where it is missing, and removed again if nothing is put into it.
        command: Who has it, such as ``hadr train``: what a second run is told.

    Raises:
        ValueError: Another run has it; the message says which, and since when.
        OSError: The folder can't be made or written.
    """
    folder = Path(folder)
    made = [part for part in (folder, *folder.absolute().parents) if not part.exists()]
    if not made and os.listdir(folder) == [LOCK]:  # a run was killed before it wrote anything
        made = [folder]
    try:
        with _told_of(folder, folder):
            handle = _taken(folder)
        try:
            _sweep(folder)
            since = datetime.datetime.now().astimezone().isoformat(" ", "seconds")
            words = f"{command}, process {os.getpid()} on {socket.gethostname()}, since {since}"
            os.truncate(handle, 0)
            os.write(handle, words.encode())
            yield folder
        finally:
            with contextlib.suppress(OSError):
                _sweep(folder)
                (folder / LOCK).unlink()
            os.close(handle)
    finally:
        with contextlib.suppress(OSError):
            for part in made:
                part.rmdir()


def _taken(folder: Path) -> int:
    """The locked file of a folder, which is made."""
    path = folder / LOCK
    while True:
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
        if os.fstat(handle).st_nlink > 1:
            os.close(handle)
            raise ValueError(f"{path} has another name elsewhere, so it is no lock: remove it")
        try:
            import fcntl

            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            owner = os.pread(handle, 1000, 0).decode(errors="replace") or "another run"
            os.close(handle)
            raise ValueError(
                f"{folder} is taken by {owner}: wait for its end, or name another folder"
            ) from None
        except (ImportError, OSError):
            _say_unlocked()
        with contextlib.suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(handle), path.stat()):
                return handle
        os.close(handle)  # its owner has ended meanwhile, and removed it


@cache
def _say_unlocked() -> None:
    print(
        "hadr: there are no locks on this system or disk, so nothing stops a second run in the "
        "same folder, which would mix the two results: start none",
        file=sys.stderr,
    )


def _sweep(folder: Path) -> None:
    for place, folders, files in os.walk(folder):
        if LOCK in files and place != str(folder):  # another run's, or the next one's there
            folders.clear()
            continue
        for name in [name for name in folders if name.startswith(PART)]:
            folders.remove(name)
            shutil.rmtree(Path(place, name), ignore_errors=True)
        for name in files:
            if name.startswith(PART):
                Path(place, name).unlink(missing_ok=True)
