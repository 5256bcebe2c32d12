"""Recorded holds: joint angles over time as a data glove's software exports them, and the object.

A recording is a CSV file (``data_samples/recordings/README.md`` says what its columns are). The
reader takes an export unchanged; what a glove does not know (which object, where it stood in the
hand, the hand's size) comes from comment lines, a JSON file or a placement file beside it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from hadr.camera import Array
from hadr.hand import ANGLE_LIMITS, ANGLE_NAMES, FINGERS, HandShape
from hadr.records.reading import parse_json, read_json, structured
from hadr.records.writing import write_whole
from hadr.synthesis.glass.objects import glass_object
from hadr.synthesis.holding.contact import ContactReport
from hadr.synthesis.holding.hold import Hold, check_hold
from hadr.synthesis.recordings.glove_columns import (
    ANGLE_COLUMNS,
    POSITION_COLUMNS,
    ROTATION_COLUMNS,
    find_angle_columns,
)
from hadr.synthesis.recordings.table import Table, read_table

_MILLISECONDS = ("elapsedtimeinmilliseconds", "elapsedtimems", "timems", "timestampms")
_SECONDS = ("elapsedtimeinseconds", "elapsedtimes", "times", "timestamps", "seconds", "timestamp")
REACH_M = 0.5
"""No point of an object that a hand holds is so far from the wrist, metres."""
BONE_M, ROOT_M = (0.005, 0.12), 0.2
"""Shortest and longest bone, and the farthest root of a finger, of any hand, metres."""
FAN_DEG = 45.0
"""Farthest angle of a straight finger to the middle one's direction."""
BEYOND_LIMITS = np.deg2rad(40)
"""So far a glove may read beyond the usual range of a joint, radians."""
LEAST_BEND = np.deg2rad(3.2)
"""Where no joint ever bends by more, the numbers were radians: a hand that holds is not flat."""
_ADD_PLACEMENT = (
    "add the columns {columns} (metres and a unit quaternion: the object's pose in the wrist "
    "frame), or a file {side_file} with a time column and these columns"
)


@dataclass(frozen=True, eq=False)
class Recording:
    """A hold over time.

    Args:
        hold_id: Names the hold; all rows are near-duplicates of one another.
        object_id: The object.
        kind: Kind of hold.
        shape: Sizes and side of the hand.
        time: Seconds from the first row, shape (T,).
        angles: Joint angles in the order of ``ANGLE_NAMES``, radians, shape (T, 20).
        wrist_from_object: Pose of the object in the wrist frame, shape (T, 4, 4).
    """

    hold_id: str
    object_id: str
    kind: str
    shape: HandShape
    time: Array
    angles: Array
    wrist_from_object: Array

    def at(self, row: int) -> Hold:
        """The hold at a row; an ``IndexError`` where there is none."""
        if not 0 <= row < len(self.time):
            raise IndexError(f"row {row} of {self.hold_id}, which has {len(self.time)} rows")
        return self.checked(row)[0]

    def checked(self, row: int) -> tuple[Hold, ContactReport]:
        """The hold at a row, and what the checks found of it."""
        pose = self.angles[row], self.wrist_from_object[row]
        hold = Hold(self.hold_id, self.object_id, self.kind, self.shape, *pose, {})
        report = check_hold(hold)
        return replace(hold, gaps=report.gaps), report


def find_recordings(folder: str | Path) -> list[Path]:
    """The recordings in a folder and below, ordered by object and number.

    Raises:
        ValueError: There is no such folder.
    """
    root = Path(folder)
    if not root.is_dir():
        raise ValueError(f"no folder of recordings at {root}")
    found = [p for p in root.rglob("*.csv") if not p.name.endswith(".placement.csv")]

    def key(path: Path) -> tuple[str, int, str]:
        number = path.stem.rsplit("-", 1)[-1]
        return path.parent.name, int(number) if number.isdigit() else 0, path.name

    return sorted(found, key=key)


def companions(path: Path) -> tuple[Path, Path]:
    """The files that may lie beside a recording: its JSON file and its placement file."""
    return path.with_suffix(".json"), path.with_name(f"{path.stem}.placement.csv")


def _times(table: Table, notes: Mapping[str, Any]) -> Array:
    """Seconds of each row by the table's own clock."""
    milliseconds, seconds = table.find(*_MILLISECONDS), table.find(*_SECONDS)
    frame = table.find("frame", "framenumber", "frameid")
    if milliseconds is not None:
        time = table.column(milliseconds) / 1000
    elif seconds is not None:
        time = table.column(seconds)
    elif frame is not None and "frame_rate" in notes:
        time = table.column(frame) / _note(notes, "frame_rate", table.path.name)
    else:
        raise ValueError(
            f"{table.path.name} has no time: expected a column Elapsed_Time_In_Milliseconds or "
            "Time_s, or a column Frame and the frame_rate beside it"
        )
    for row in np.flatnonzero(np.diff(time) <= 0).tolist():
        raise ValueError(f"{table.place(row + 1)}: time does not grow")
    return np.asarray(time)


def _poses(table: Table, positions: list[int], rotations: list[int]) -> Array:
    quaternions = np.stack([table.column(i) for i in rotations], axis=1)
    norms = np.linalg.norm(quaternions, axis=1)
    for row in np.flatnonzero(np.abs(norms - 1) > 0.01).tolist():
        where = table.place(row, f", columns {ROTATION_COLUMNS[0]}...")
        raise ValueError(f"{where}: a quaternion of length {norms[row]:.3f}, not 1")
    places = np.stack([table.column(i) for i in positions], axis=1)
    for row in np.flatnonzero(np.abs(places).max(axis=1) > REACH_M).tolist():
        raise ValueError(
            f"{table.place(row, f', columns {POSITION_COLUMNS[0]}...')}: the object is at "
            f"{places[row].tolist()} m from the wrist, which no hand reaches (at most {REACH_M} "
            "m); are these metres?"
        )
    poses = np.tile(np.eye(4), (len(quaternions), 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(quaternions[:, [1, 2, 3, 0]]).as_matrix()
    poses[:, :3, 3] = places
    return poses


def _placement(table: Table, time: Array) -> Array:
    """The object's pose at each time of one clock, from the table or from the file beside it."""
    wanted = [*POSITION_COLUMNS, *ROTATION_COLUMNS]
    if twice := [name for name in wanted if table.header.count(name) > 1]:
        raise ValueError(f"{table.path.name} has the column {twice[0]} twice")
    _, side_file = companions(table.path)
    own = [name for name in wanted if name in table.header]
    source = read_table(side_file) if not own and side_file.is_file() else table
    if missing := [name for name in wanted if name not in source.header]:
        what = "where the object is" if not own else ", ".join(missing)
        raise ValueError(
            f"{source.path.name} does not say {what}: "
            + _ADD_PLACEMENT.format(columns=", ".join(wanted), side_file=side_file.name)
        )
    at = [source.header.index(name) for name in wanted]
    poses = _poses(source, at[:3], at[3:])
    if source is table:
        return poses
    if len(poses) == 1:
        return np.repeat(poses, len(time), axis=0)
    known = _times(source, source.notes)
    if known[-1] < time[0] or time[-1] < known[0]:
        raise ValueError(
            f"{source.path.name} is of {known[0]:g} to {known[-1]:g} s, {table.path.name} of "
            f"{time[0]:g} to {time[-1]:g} s: both must have one clock"
        )
    now = np.clip(time, known[0], known[-1])
    result = np.tile(np.eye(4), (len(time), 1, 1))
    result[:, :3, :3] = Slerp(known, Rotation.from_matrix(poses[:, :3, :3]))(now).as_matrix()
    for axis in range(3):
        result[:, axis, 3] = np.interp(now, known, poses[:, axis, 3])
    return result


def _notes(table: Table) -> dict[str, Any]:
    notes: dict[str, Any] = dict(table.notes)
    companion, _ = companions(table.path)
    if companion.is_file():
        notes |= structured(read_json(companion), dict[str, Any], companion.name)
    return notes


def _note(notes: Mapping[str, Any], key: str, name: str) -> float:
    """A positive number that is noted, as text or not."""
    try:
        value = float(notes[key])
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"{name}: {key} must be a number, got {notes[key]!r:.60}") from error
    if not 0 < value < np.inf:
        raise ValueError(f"{name}: {key} must be a positive number, got {value}")
    return value


def _angles(table: Table, columns: Mapping[str, int]) -> Array:
    """The joint angles in radians, refused where no hand bends so."""
    angles = np.deg2rad(np.stack([table.column(columns[a]) for a in ANGLE_NAMES], axis=1))
    low, high = ANGLE_LIMITS.T
    wrong = np.argwhere((angles < low - BEYOND_LIMITS) | (angles > high + BEYOND_LIMITS))
    for row, joint in wrong.tolist():
        where = table.place(row, f", column {table.header[columns[ANGLE_NAMES[joint]]]}")
        bend = np.rad2deg(angles[row, joint])
        raise ValueError(f"{where}: no joint bends to {bend:g} degrees")
    if np.abs(angles).max() < LEAST_BEND:
        raise ValueError(
            f"{table.path.name}: no joint bends by more than {np.rad2deg(np.abs(angles).max()):.2f}"
            " degrees; the columns must be in degrees, not radians"
        )
    return angles


def _shape(notes: Mapping[str, Any], side: str, name: str) -> HandShape:
    usual = HandShape()
    sizes: dict[str, Any] = {}
    for field in ("roots", "lengths"):
        if field in notes:
            where, given = f"{name}: {field}", notes[field]
            given = parse_json(given, where) if isinstance(given, str) else given
            known = structured(given, dict[str, tuple[float, float, float]], where)
            if set(known) != set(FINGERS):
                raise ValueError(f"{where} must name the five fingers, got {list(given)}")
            low, high = BONE_M if field == "lengths" else (-ROOT_M, ROOT_M)
            for finger, values in known.items():
                if not all(1000 * low <= value <= 1000 * high for value in values):
                    raise ValueError(
                        f"{where} of the {finger} must be from {1000 * low:g} to {1000 * high:g} "
                        f"mm, got {values}"
                    )
            sizes[field] = {f: tuple(v / 1000 for v in known[f]) for f in FINGERS}
    if "fan" in notes:
        where, given = f"{name}: fan", notes["fan"]
        given = parse_json(given, where) if isinstance(given, str) else given
        fan = structured(given, dict[str, float], where)
        if fan.keys() != usual.fan.keys() or not all(abs(v) <= FAN_DEG for v in fan.values()):
            raise ValueError(
                f"{where} must give {', '.join(usual.fan)} an angle of at most {FAN_DEG:g} degrees "
                f"each, got {fan}"
            )
        sizes["fan"] = {finger: float(np.deg2rad(fan[finger])) for finger in usual.fan}
    for field in ("scale", "girth"):
        if field in notes:
            sizes[field] = _note(notes, field, name)
    try:
        return HandShape(side=side, **sizes)  # type: ignore[arg-type]
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error


def read_recording(path: str | Path) -> Recording:
    """Read a recording, ours or an export of a glove's software.

    Comma, semicolon or tab; lines before the header, columns of both hands and further columns do
    not matter.

    Raises:
        ValueError: A cell is no number, or no hand bends or reaches so (row and column are
            named); an angle, the time or the placement is missing; or it is not said which object,
            kind, scale and hand it is.
        FileNotFoundError: There is no such file.
    """
    table = read_table(Path(path))
    notes = _notes(table)
    name = table.path.name
    if missing := [key for key in ("object", "kind", "scale") if key not in notes]:
        raise ValueError(
            f"{name} does not say {', '.join(missing)}: add comment lines such as "
            f"'# object: 0000' above the header, or {table.path.stem}.json"
        )
    try:
        glass_object(str(notes["object"]))
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error
    hands = find_angle_columns(table.header)
    named = notes.get("side")
    sides = [s for s in hands if s is not None] if named is None else [named]
    if len(sides) != 1:
        raise ValueError(f"{name} does not say which hand holds: add '# side: right' or left")
    side = sides[0]
    if side not in ("right", "left"):
        raise ValueError(f"{name}: side must be 'right' or 'left', got {side!r}")
    columns = hands.get(side, hands.get(None, {}))
    if absent := [a for a in ANGLE_NAMES if a not in columns]:
        raise ValueError(f"{name} lacks {len(absent)} angles of the {side} hand: {absent[0]} ...")
    time = _times(table, notes)
    hold_id, shape = str(notes.get("hold_id", table.path.stem)), _shape(notes, side, name)
    what = hold_id, str(notes["object"]), str(notes["kind"])
    poses = _placement(table, time)
    return Recording(*what, shape, time - time[0], _angles(table, columns), poses)


def recording_text(recording: Recording) -> str:
    """A recording as CSV: angles to 0.01 degrees, positions to 0.01 mm."""
    shape, usual = recording.shape, HandShape()
    notes: list[tuple[str, Any]] = [
        ("hold_id", recording.hold_id),
        ("object", recording.object_id),
        ("kind", recording.kind),
        ("side", shape.side),
        ("scale", repr(round(shape.scale, 4))),
    ]
    if shape.girth != usual.girth:
        notes.append(("girth", repr(round(shape.girth, 4))))
    for field in ("roots", "lengths"):
        value = getattr(shape, field)
        if value != getattr(usual, field):
            mm = {f: [round(1000 * float(v), 2) for v in value[f]] for f in FINGERS}
            notes.append((field, json.dumps(mm)))
    if shape.fan != usual.fan:
        degrees = {f: round(float(np.rad2deg(v)), 2) for f, v in shape.fan.items()}
        notes.append(("fan", json.dumps(degrees)))
    header = ["Frame", "Elapsed_Time_In_Milliseconds", *ANGLE_COLUMNS]
    header += [*POSITION_COLUMNS, *ROTATION_COLUMNS]
    quaternions = Rotation.from_matrix(recording.wrist_from_object[:, :3, :3]).as_quat()
    # One sign for the whole recording, so that the columns are smooth.
    quaternions = quaternions[:, [3, 0, 1, 2]]
    quaternions *= np.where(quaternions @ quaternions[0] < 0, -1.0, 1.0)[:, None]
    lines = [f"# {key}: {value}" for key, value in notes] + [",".join(header)]
    for row, seconds in enumerate(recording.time):
        cells = [str(row), f"{1000 * seconds:.2f}".rstrip("0").rstrip(".")]
        cells += [f"{v:.2f}" for v in np.rad2deg(recording.angles[row])]
        cells += [f"{v:.5f}" for v in recording.wrist_from_object[row, :3, 3]]
        cells += [f"{v:.5f}" for v in quaternions[row]]
        lines.append(",".join(cells))
    return "\n".join(lines) + "\n"


def write_recording(recording: Recording, path: str | Path) -> None:
    """Write a recording; the file appears whole or not at all."""
    write_whole(Path(path), recording_text(recording))


if __name__ == "__main__":
    from hadr.synthesis.recordings.motion import main

    main()
