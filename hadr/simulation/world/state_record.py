"""A run's states on disk: one compressed .npz, single precision, some kilobytes a second."""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np
import numpy.typing as npt

from hadr.records.writing import write_arrays
from hadr.simulation.world.state import Holder, WorldState

_VERSION = 1
_SHAPES: dict[str, tuple[int, ...]] = {
    "time": (),
    "joints": (6,),
    "gripper_width": (),
    "base_from_wrist": (4, 4),
    "base_from_object": (4, 4),
    "hand_force": (),
    "hand_distance": (),
}
_HOLDERS: tuple[Holder, ...] = get_args(Holder)


def save_states(path: str | Path, states: Sequence[WorldState]) -> Path:
    """Write the states of one run.

    Args:
        path: A file that ends in .npz; folders are made.
        states: In the order of time, at least one.

    Returns:
        The path.

    Raises:
        ValueError: No states, their times fall, or the file's name ends otherwise.
    """
    path = Path(path)
    if path.suffix != ".npz":
        raise ValueError(f"states are written to a .npz file, got {path.name!r}")
    if not states:
        raise ValueError("there is no state to write")
    times = np.array([state.time for state in states])
    if (np.diff(times) < 0).any():
        at = int(np.argmax(np.diff(times) < 0))
        raise ValueError(f"times must not fall, got {times[at]} s and then {times[at + 1]} s")
    columns: dict[str, npt.NDArray[Any]] = {
        name: np.array([getattr(state, name) for state in states], dtype=np.float32)
        for name in _SHAPES
    }
    columns["holder"] = np.array([_HOLDERS.index(s.holder) for s in states], dtype=np.uint8)
    columns["version"] = np.array(_VERSION)
    write_arrays(path, **columns)
    return path


def load_states(path: str | Path) -> list[WorldState]:
    """Read what `save_states` wrote; numbers come back in single precision.

    Poses are made rigid again to double precision, so that they pass the checks of poses.

    Raises:
        ValueError: The file is broken, lacks a column, or a column has another shape or holds
            what is no number; the message names it.
        FileNotFoundError: There is no such file.
    """
    path = Path(path)
    try:
        with np.load(path, allow_pickle=False) as file:
            columns = {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise
    except (OSError, ValueError, EOFError, zipfile.BadZipFile, KeyError, AttributeError) as error:
        raise ValueError(f"{path.name} is no readable record of states: {error}") from error
    missing = [name for name in ("version", "holder", *_SHAPES) if name not in columns]
    if missing:
        raise ValueError(f"{path.name} lacks {', '.join(missing)}; it is no record of states")
    if int(columns["version"]) != _VERSION:
        raise ValueError(f"{path.name} has version {columns['version']}, expected {_VERSION}")
    count = len(columns["time"]) if columns["time"].ndim == 1 else 0
    if count == 0:
        raise ValueError(f"{path.name} holds no states")
    for name, shape in _SHAPES.items():
        column = columns[name]
        if column.shape != (count, *shape):
            raise ValueError(
                f"{path.name}: {name} must have shape {(count, *shape)}, got {column.shape}"
            )
        if name != "hand_distance" and not np.isfinite(column).all():
            raise ValueError(f"{path.name}: {name} must be finite, got NaN or infinity")
        columns[name] = column.astype(np.float64)
    holder = columns["holder"]
    if holder.shape != (count,) or not np.isin(holder, np.arange(len(_HOLDERS))).all():
        raise ValueError(f"{path.name}: holder must be {count} numbers from 0 to 3, got {holder}")
    for name in ("base_from_wrist", "base_from_object"):
        left, scale, right = np.linalg.svd(columns[name][:, :3, :3])
        if np.abs(scale - 1).max() > 1e-3 or (np.linalg.det(left @ right) < 0).any():
            raise ValueError(f"{path.name}: {name} holds what is no rotation")
        columns[name][:, :3, :3] = left @ right
    return [
        WorldState(
            time=float(columns["time"][k]),
            joints=columns["joints"][k],
            gripper_width=float(columns["gripper_width"][k]),
            base_from_wrist=columns["base_from_wrist"][k],
            base_from_object=columns["base_from_object"][k],
            holder=_HOLDERS[int(holder[k])],
            hand_force=float(columns["hand_force"][k]),
            hand_distance=float(columns["hand_distance"][k]),
        )
        for k in range(count)
    ]
