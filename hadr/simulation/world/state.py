"""What is true in the world at one moment: what pictures are drawn from and judges look at.

A run's states are kept as one compressed .npz, single precision, some kilobytes a second.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from hadr.camera import Array
from hadr.records.reading import read_arrays
from hadr.records.writing import write_arrays

Holder = Literal["hand", "both", "gripper", "nobody"]
"""Who holds the object: the hand alone, hand and fingers, the fingers alone, or it is falling."""


@dataclass(frozen=True)
class WorldState:
    """The world at one moment; base frame, metres, radians, newtons, seconds.

    Attributes:
        time: Since the start.
        joints: The arm's joint angles, shape (6,).
        gripper_width: Distance between the fingers' pads.
        base_from_wrist: Pose of the hand, shape (4, 4).
        base_from_object: Pose of the object, shape (4, 4).
        holder: Who holds the object.
        hand_force: Largest force of the robot on the hand in the world's last step, newtons.
        through_force: Largest force on the hand through the object in that step, newtons: the
            gripper's on the object as long as the hand holds it (less the glass's own inertia is
            what the hand feels), then the object's on the hand.
        hand_distance: Smallest distance of robot and hand now; 0 where they touch.
        opened: How far each finger has opened, shape (5,): 0 as it held the object, 1 straight.
    """

    time: float
    joints: Array
    gripper_width: float
    base_from_wrist: Array
    base_from_object: Array
    holder: Holder
    hand_force: float
    hand_distance: float
    through_force: float = field(default=0.0, kw_only=True)
    opened: Array = field(default_factory=lambda: np.zeros(5), kw_only=True)


_VERSION = 2
_HOLDERS: tuple[Holder, ...] = get_args(Holder)
_SCHEMA = {
    "time": "f4 states", "joints": "f4 states 6", "gripper_width": "f4 states",
    "base_from_wrist": "f4 states 4 4", "base_from_object": "f4 states 4 4",
    "hand_force": "f4 states", "through_force": "f4 states", "hand_distance": "f4 states",
    "opened": "f4 states 5", "holder": "u1 states", "version": "i8",
}  # fmt: skip
_NUMBERS = [f.name for f in fields(WorldState) if f.name != "holder"]


def save_states(path: Path, states: Sequence[WorldState]) -> None:
    """Write the states of one run, in the order of time, as an .npz."""
    columns: dict[str, npt.NDArray[Any]] = {
        name: np.array([getattr(state, name) for state in states], dtype=np.float32)
        for name in _NUMBERS
    }
    columns["holder"] = np.array([_HOLDERS.index(s.holder) for s in states], dtype=np.uint8)
    columns["version"] = np.array(_VERSION)
    write_arrays(path, **columns)


def load_states(path: Path) -> list[WorldState]:
    """Read what `save_states` wrote; who calls compares the file's checksum.

    Numbers come back in single precision, but poses are made rigid again to double precision, so
    that they pass the checks of poses. Errors as of `read_arrays`, and for another version.
    """
    arrays = read_arrays(path, _SCHEMA)
    if arrays["version"] != _VERSION:
        raise ValueError(f"{path} has version {arrays['version']}, expected {_VERSION}")
    if max(arrays["holder"], default=0) >= len(_HOLDERS):
        raise ValueError(f"{path}: holder must be below {len(_HOLDERS)}")
    columns = {name: arrays[name].astype(np.float64) for name in _NUMBERS}
    holders = [_HOLDERS[number] for number in arrays["holder"]]
    for name in ("base_from_wrist", "base_from_object"):
        left, _, right = np.linalg.svd(columns[name][:, :3, :3])
        columns[name][:, :3, :3] = left @ right
    rows: list[dict[str, Any]] = [
        {name: v[k] if v.ndim > 1 else float(v[k]) for name, v in columns.items()}
        for k in range(len(holders))
    ]
    return [WorldState(holder=holder, **row) for holder, row in zip(holders, rows, strict=True)]
