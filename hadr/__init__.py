"""hadr: depth restoration of hand-held transparent objects, as a small library.

The library lies in three rings, and imports run inward only:

- the method: `camera`, `corruption`, `hand`, `ray_voxels`, `metrics`, `data`, `models`, `rivals`,
  `training`, `restoration`, `handover`, on the files of `records`;
- the workshops: `synthesis` makes frames, `simulation` a world for the robot, `experiments` tables;
- the press: `figures` draws, `press` makes the book.

What most users need is at the front door, ``from hadr import restore, read_depth``, and is loaded
when it is asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

FRONT_DOOR = {
    "Intrinsics": "camera",
    "load_intrinsics": "camera_file",
    "read_color": "frame_io",
    "read_depth": "frame_io",
    "read_hand": "frame_io",
    "read_mask": "frame_io",
    "frame_metrics": "metrics",
    "TransHand": "data.transhand",
    "open_samples": "data.samples",
    "Restorer": "restoration",
    "restore": "restoration",
}
"""What can be imported from here, and the module that has it."""


def __getattr__(name: str) -> Any:
    """Load a name of the front door from its module."""
    if name not in FRONT_DOOR:
        raise AttributeError(f"module 'hadr' has no attribute {name!r}")
    return getattr(import_module(f"hadr.{FRONT_DOOR[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *FRONT_DOOR])
