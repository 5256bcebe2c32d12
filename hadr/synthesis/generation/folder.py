"""The folder of a data set that is being made: whose it is, what it holds, what a stop left."""

from __future__ import annotations

import contextlib
import hashlib
import json
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from hadr import __version__
from hadr.data.frame import frame_log_path, frame_places
from hadr.data.frame_pictures import check_whole, decode_depth_array
from hadr.data.transhand import read_keypoints_uv
from hadr.records.output_folder import SPLITS, check_file, check_folder
from hadr.records.reading import read_json, structured
from hadr.records.writing import sole_owner, write_whole
from hadr.synthesis.generation.settings import EDITION, FrameRecipe, GenerationSettings
from hadr.synthesis.recordings.recording import companions, find_recordings
from hadr.synthesis.textures.backgrounds import find_backgrounds

#: The file that says with which settings the frames of a folder are made.
SETTINGS_FILE = "generation.json"


def _digest(root: str, paths: Iterable[Path]) -> str:
    """SHA-256 over names and contents of files below a folder; 16 digits of it."""
    digest = hashlib.sha256()
    for path in sorted(paths):
        digest.update(f"{path.relative_to(root).as_posix()}\0".encode())
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()[:16]


def settings_record(settings: GenerationSettings) -> dict[str, Any]:
    """The settings as plain values; folders that are read from stand for their contents."""
    record = json.loads(json.dumps(asdict(settings)))
    if settings.recordings is not None:
        if not (found := find_recordings(settings.recordings)):
            raise ValueError(f"{settings.recordings} holds no recording (.csv)")
        beside = (path for one in found for path in companions(one) if path.is_file())
        record["recordings"] = _digest(settings.recordings, {*found, *beside})
    if settings.backgrounds is not None:
        photographs = find_backgrounds(settings.backgrounds)
        record["backgrounds"] = _digest(settings.backgrounds, photographs)
    return {"hadr": __version__, "edition": EDITION, **record}


def whole_frames(
    root: Path, recipes: Sequence[FrameRecipe], settings: GenerationSettings
) -> set[int]:
    """Indices of the frames that lie in a folder with all their files.

    A ``ValueError`` names a file that was damaged since: nobody but its owner can say whether the
    frame may be made again.
    """
    found = set()
    for recipe in recipes:
        base = frame_log_path(root, recipe.split, recipe.object_id, recipe.stem).parents[1]
        places = frame_places(
            recipe.stem,
            depth_format=settings.depth_format,
            jpeg_quality=settings.jpeg_quality,
            raw=settings.raw_format,
        )
        if not settings.sensor:
            del places["raw"]
        if settings.normals == "none":
            del places["normals"]
        paths = [base / place for place in places.values()]
        if all(path.is_file() for path in paths):
            for path in paths:
                _check_undamaged(path)
            found.add(recipe.index)
    return found


def _check_undamaged(path: Path) -> None:
    """Check that a frame's file can be read."""
    try:
        if path.suffix == ".json":
            structured(read_json(path), dict[str, Any], path)
        elif path.suffix == ".txt":
            read_keypoints_uv(path)
        else:
            (decode_depth_array if path.suffix == ".npy" else check_whole)(path.read_bytes())
    except ValueError as error:
        told = str(error).removeprefix(f"{path}: ").removeprefix(f"{path} ")
        raise ValueError(
            f"{path} was damaged after it was written ({told}); remove it, and the frame is made "
            "again"
        ) from error


def recorded_settings(root: Path) -> dict[str, Any]:
    """The settings of a folder's frames as plain values; empty where there are no frames."""
    path = root / SETTINGS_FILE
    frames = (log for split in SPLITS for log in (root / split).glob("*/depth/log_json/*.json"))
    if not path.is_file() or next(frames, None) is None:  # perhaps a run ended before the first
        return {}
    return structured(read_json(path), dict[str, Any], path)


def _check_settings(root: Path, record: dict[str, Any]) -> None:
    path = root / SETTINGS_FILE
    if not path.is_file() and any((root / split).exists() for split in SPLITS):
        raise ValueError(
            f"{root} holds frames, but no {SETTINGS_FILE} that says how they were made; "
            "choose another folder"
        )
    before = recorded_settings(root)
    if not before:  # the file may be replaced, if this command wrote it
        check_file(path)
        if path.exists() and "hadr" not in structured(read_json(path), dict[str, Any], path):
            raise ValueError(f"{path} is not replaced: no earlier run of this command wrote it")
        return
    if differing := [
        f"{name} is {before.get(name)!r} there, {record.get(name)!r} here"
        for name in record | before
        if before.get(name) != record.get(name)
    ]:
        raise ValueError(
            f"the frames in {root} are made with other settings: {'; '.join(differing)}. "
            "Go on with the same settings, or choose another folder"
        )


def _clean(root: Path) -> None:
    """Remove what a stopped run left: the files of frames without a log."""
    for split in SPLITS:
        for logs in sorted((root / split).glob("*/depth")):
            done = {p.stem for p in (logs / "log_json").glob("*.json")}
            for path in logs.glob("*/*"):
                if path.stem not in done and path.is_file() and _is_of_a_frame(path):
                    path.unlink()


def _is_of_a_frame(path: Path) -> bool:
    """Whether a file is named as the generator names one: any other is somebody's own."""
    places = (
        frame_places(path.stem),
        frame_places(path.stem, depth_format="png", jpeg_quality=90, raw="disparity"),
    )
    own = any(Path(path.parent.name, path.name) in some.values() for some in places)
    return own and re.fullmatch(r"\d{6,}", path.stem) is not None


@contextlib.contextmanager
def generation_folder(root: Path, settings: GenerationSettings) -> Iterator[Path]:
    """Take a folder for making frames, alone: check that it is meant for them, and tidy it.

    The settings of a run that ended before its first frame bind nobody. A ``ValueError`` says which
    settings differ from those of the frames there, that these are not ours, or who works there.
    """
    record = settings_record(settings)
    check_folder(root)
    with sole_owner(root, "hadr generate"):
        _check_settings(root, record)
        _clean(root)
        write_whole(root / SETTINGS_FILE, json.dumps(record, indent=1) + "\n")
        try:
            yield root
        except BaseException:
            if not any((root / split).exists() for split in SPLITS):
                (root / SETTINGS_FILE).unlink(missing_ok=True)
            raise
