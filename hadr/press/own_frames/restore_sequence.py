"""`hadr restore` on a folder of frames: a result for each of them, and a film."""

import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from tqdm import tqdm

from hadr.frame_io import read_color
from hadr.press.own_frames import restore_command
from hadr.press.own_frames.restore_command import MEDIAPIPE, Options, input_files, restorer_of
from hadr.records.output_folder import VIEW, check_apart, check_replaceable
from hadr.records.result_file import seal_row
from hadr.records.writing import whole_folder

RECORD = "sequence.json"
FILMS = ("film.mp4", "film.gif")
"""The film; a GIF where there is no ffmpeg."""
RATE = 10.0
"""Its frames a second."""
_OF_SYSTEMS = ("Thumbs.db", "desktop.ini")
"""What a system puts into folders of pictures; no frame."""
_A_FRAME = ("rgb", "depth", "mask", "hand", "hand_mask", "truth")
"""Options that name a folder with a file for each frame."""


def run_sequence(options: Options) -> int:
    """Restore all frames of a folder: 1 where one was refused, or nothing was restored in one."""
    from hadr.simulation.film.film import write_film  # --help need not wait for it

    frames = sequence_frames(options)
    out = Path(options.out)

    def check() -> None:
        check_apart(out)
        again = options.overwrite
        read = [path for one in frames.values() for path in input_files(one).values() if path]
        check_replaceable(out, again, RECORD, read, parts=frames, command="hadr restore")
        for part in (out / name for name in frames):
            check_replaceable(part, True, "report.json", (), [VIEW], command="hadr restore")

    check()
    told: dict[str, dict[str, Any]] = {}
    with restorer_of(options) as restorer, whole_folder(out, "hadr restore", check) as folder:
        bar = tqdm(frames.items(), unit="frame", disable=options.quiet or None, file=sys.stderr)
        for name, one in bar:
            try:
                made = restore_command.restored_frame(one, restorer)
            except (ValueError, OSError) as error:
                told[name] = {"refused": str(error)}
                continue
            (folder / name).mkdir()
            report = restore_command.write_frame(folder / name, made)
            told[name] = {key: report[key] for key in ("method", "method_title", "counts", "notes")}
            told[name]["nothing"] = restore_command.found_nothing(made.result)
        done = [name for name in told if "refused" not in told[name]]
        if not done:
            first, why = next(iter(told.items()))
            raise ValueError(f"none of the {len(told)} frames is usable; {first}: {why['refused']}")
        film = folder / FILMS[find_spec("imageio_ffmpeg") is None]
        pictures = (read_color(folder / name / "comparison.png") for name in done)
        even = (p[: len(p) // 2 * 2, : p.shape[1] // 2 * 2] for p in pictures)  # as films need them
        write_film(film, even, RATE)
        record = {"command": "hadr restore", "film": film.name, "frames": told}
        seal_row(folder / RECORD, {**record, "outputs": restore_command.outputs(folder)})
    if not options.quiet:
        print("\n".join((*_summary(told), f"written   {out}, with {film.name}")))
    bad = [name for name, one in told.items() if one.get("nothing", True)]
    if bad:
        print(
            f"hadr restore: error: {len(bad)} of {len(told)} frames were refused, or nothing could "
            f"be restored in them ({', '.join(bad[:5])}{', ...' * (len(bad) > 5)}); "
            f"{out}/{RECORD} says why",
            file=sys.stderr,
        )
    return int(bool(bad))


def sequence_frames(options: Options) -> dict[str, Options]:
    """The options of each frame, by the name that its files have in common, in their order."""
    files: dict[str, dict[str, Any]] = {}
    for option in _A_FRAME:
        given = getattr(options, option)
        if given is None or (option == "hand" and given == MEDIAPIPE):
            continue
        if not Path(given).is_dir():
            raise ValueError(
                f"--rgb {options.rgb} is a folder, so --{option.replace('_', '-')} {given} must be "
                "one, too"
            )
        found = files[option] = {}
        for path in sorted(Path(given).iterdir()):
            if path.name.startswith(".") or path.name in _OF_SYSTEMS or path.is_dir():
                continue
            restore_command.check_names(str(path))
            if path.stem in found:
                raise ValueError(
                    f"{given} holds two files of frame {path.stem}, {Path(found[path.stem]).name} "
                    f"and {path.name}: expected one"
                )
            if path.stem in (RECORD, *FILMS):
                raise ValueError(f"{path}: no frame can have the name of a result's file")
            found[path.stem] = str(path)
    if not files["rgb"]:
        raise ValueError(f"--rgb {options.rgb} holds no frame")
    # 2 comes before 10
    names = sorted(
        set().union(*files.values()),
        key=lambda name: [int(t) if t.isdecimal() else t for t in re.split(r"(\d+)", name)],
    )
    for option, found in files.items():
        if lacking := [name for name in names if name not in found]:
            there = next(of[lacking[0]] for of in files.values() if lacking[0] in of)
            raise ValueError(
                f"--{option.replace('_', '-')} {getattr(options, option)} has no file of frame "
                f"{lacking[0]}, as {there} is ({len(lacking)} of {len(names)} lack one): the files "
                "of a frame have one name"
            )
    return {
        name: replace(options, **{option: found[name] for option, found in files.items()})
        for name in names
    }


def _summary(told: dict[str, dict[str, Any]]) -> Iterator[str]:
    """How many frames were restored by which method."""
    by: dict[str, list[str]] = {}
    for name, one in told.items():
        by.setdefault(one.get("method_title", "refused"), []).append(name)
    for title, names in by.items():
        few = ", ".join(names[:5]) + ", ..." * (len(names) > 5)
        yield f"{len(names)} of {len(told)} frames: {title} ({few})"
