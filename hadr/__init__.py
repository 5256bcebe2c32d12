"""hadr: depth restoration of hand-held transparent objects, as a small library.

The library lies in three rings, and imports run inward only:

- the method: `camera`, `corruption`, `hand`, `ray_voxels`, `metrics`, `data`, `models`, `rivals`,
  `training`, `restoration`, `handover`, on the files of `records`;
- the workshops: `synthesis` makes frames, `simulation` a world for the robot, `experiments` tables;
- the press: `figures` draws, `press` makes the book.

Import what you need, for example ``from hadr.restoration import restore``.
"""

__version__ = "0.1.0"
