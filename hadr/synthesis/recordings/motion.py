"""Makes recordings: two seconds of a hold in which a hand is as restless as hands are.

The object drifts in the grip by a millimetre or so and the fingers follow it; a tremor runs over
the joints. Every row passes the checks of a hold.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import tyro
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation

from hadr.camera import Array
from hadr.hand import ANGLE_LIMITS
from hadr.records.writing import write_whole
from hadr.synthesis.glass.objects import OBJECTS
from hadr.synthesis.holding.grasp_optimisation import GraspOptimisation, hand_skins
from hadr.synthesis.holding.hold import Hold, check_hold, hold_kind, make_hold, mirrored_pose
from hadr.synthesis.holding.kinds import Placement, finger_plan
from hadr.synthesis.recordings.recording import (
    Recording,
    find_recordings,
    read_recording,
    write_recording,
)

#: Frequency of a hand's tremor, Hz.
_TREMOR = (7.5, 11.0)
_KNOTS = 4
#: Rows a second.
_RATE = 10.0


def _drifted(pose: Array, move: Array, rotvec: Array, about: Array) -> Array:
    """A pose moved (metres) and rotated (rotation vector) about a point, wrist frame."""
    result = pose.copy()
    rotation = Rotation.from_rotvec(rotvec).as_matrix()
    result[:3, :3] = rotation @ pose[:3, :3]
    result[:3, 3] = rotation @ (pose[:3, 3] - about) + about + move
    return result


def _motion(
    hold: Hold, time: Array, amount: float, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Angles and poses over time, without regard to the checks; as a right hand's."""
    right = replace(hold.shape, side="right")
    base = hold.wrist_from_object
    if hold.shape.side == "left":
        base = mirrored_pose(base)
    about = np.array([0.0, 0.085, 0.035]) * right.scale
    knots = np.linspace(0, time[-1], _KNOTS)
    moves = rng.normal(size=(_KNOTS, 3)) * 0.0008 * amount
    rotvecs = rng.normal(size=(_KNOTS, 3)) * np.deg2rad(0.9) * amount
    moves[0] = rotvecs[0] = 0
    hand = hand_skins(right)
    angles = [hold.angles]
    for move, rotvec in zip(moves[1:], rotvecs[1:], strict=True):
        placement = Placement(_drifted(base, move, rotvec, about), finger_plan(hold.kind))
        attempt = GraspOptimisation(hold.object_id, hand, placement)
        angles.append(attempt.settle(hold.angles, rng, (0.04, 0.02))[0])
    smooth = PchipInterpolator(knots, np.stack(angles), axis=0)(time)
    tremor = np.zeros_like(smooth)
    for _ in range(2):
        size = np.deg2rad(0.10) * amount * rng.random(20)
        wave = 2 * np.pi * rng.uniform(*_TREMOR) * time[:, None] + rng.uniform(0, 2 * np.pi, 20)
        tremor += size * np.sin(wave)
    angles_now = np.clip(smooth + tremor, ANGLE_LIMITS[:, 0], ANGLE_LIMITS[:, 1])
    moves_now = PchipInterpolator(knots, moves, axis=0)(time)
    rotvecs_now = PchipInterpolator(knots, rotvecs, axis=0)(time)
    poses = np.stack(
        [_drifted(base, m, t, about) for m, t in zip(moves_now, rotvecs_now, strict=True)]
    )
    return angles_now, poses


def record_hold(hold: Hold, seed: int = 0, *, seconds: float = 2.0) -> Recording:
    """Record a hold for some seconds as it reads back, every row a little other and in contact."""
    if seconds * _RATE < 2:
        raise ValueError(f"need at least two rows, got {seconds} s at {_RATE} Hz")
    if problems := check_hold(hold).problems:
        raise ValueError(f"{hold.hold_id} is no good hold: {'; '.join(problems)}")
    time = np.arange(round(seconds * _RATE)) / _RATE
    rng = np.random.default_rng([seed, zlib.crc32(hold.hold_id.encode()), 17])
    for amount in (1.0, 0.6, 0.3, 0.1, 0.0):
        angles, poses = _motion(hold, time, amount, rng)
        if hold.shape.side == "left":
            poses = np.stack([mirrored_pose(pose) for pose in poses])
        whole = Recording(hold.hold_id, hold.object_id, hold.kind, hold.shape, time, angles, poses)
        with TemporaryDirectory() as folder:
            write_recording(whole, path := Path(folder) / "rounded.csv")
            recording = read_recording(path)
        if next(failing_rows(recording), None) is None:
            return recording
    raise ValueError(f"{hold.hold_id} does not pass the checks once its numbers are rounded")


def failing_rows(recording: Recording) -> Iterator[tuple[int, tuple[str, ...]]]:
    """Rows of a recording that do not pass the checks of a hold, and why."""
    for row in range(len(recording.time)):
        if problems := recording.checked(row)[1].problems:
            yield row, problems


def write_recordings(
    folder: str | Path, objects: Sequence[str], holds: int, seed: int = 0
) -> Iterator[tuple[Path, bool]]:
    """Make the recordings of each object's first holds, ``{object}/{hold_id}.csv``.

    Gives each file's path, and whether it was made now; those that are there are left. The seed
    stands beside them, in ``seed.txt``: ValueError where theirs is another.
    """
    note = Path(folder) / "seed.txt"
    if note.is_file() and (theirs := note.read_text(encoding="utf-8").strip()) != str(seed):
        raise ValueError(
            f"{folder} has recordings of seed {theirs}, not {seed}: name another folder"
        )
    write_whole(note, f"{seed}\n")
    for object_id in objects:
        for number in range(holds):
            name = f"{object_id}-{hold_kind(object_id, number)}-{number:04d}.csv"
            path = Path(folder) / object_id / name
            made = not path.is_file()
            if made:
                write_recording(record_hold(make_hold(object_id, number, seed), seed), path)
            yield path, made


@dataclass(frozen=True)
class Options:
    """Make recordings of holds, or check a folder of them."""

    out: Path
    """Folder of the recordings."""
    seed: int = 0
    """Seed of holds and variation."""
    holds: int = 30
    """Holds per object."""
    objects: tuple[str, ...] = tuple(OBJECTS)
    """Which objects."""
    check: bool = False
    """Only check what is there."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Write recordings, or check a folder of them."""
    given = tyro.cli(
        Options,
        prog="python -m hadr.synthesis.recordings.recording",
        args=arguments,
        config=(tyro.conf.FlagCreatePairsOff,),
    )
    if given.check:
        problems = [
            f"{path.name} row {row + 1}: {'; '.join(found)}"
            for path in find_recordings(given.out)
            for row, found in failing_rows(read_recording(path))
        ]
        print("\n".join(problems) or "every row of every recording passes")
        raise SystemExit(int(bool(problems)))
    made = [new for _, new in write_recordings(given.out, given.objects, given.holds, given.seed)]
    print(f"{len(made)} recordings, {sum(made)} of them made now")
