"""The protocol: on which frames the systems are compared.

Known: trained, tuned and tested on all objects, with other holding poses in each part. Unknown:
trained and tuned on six objects, tested on every frame of the two that were held out. By frame:
the same frames as known and as many in each part, but dealt out one by one, so that most test
frames have a sister of the same hold in training. It is there to measure how that flatters.

Source: paper, "Comparison with SOTA"; ledger, rows 14 and 22.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from hadr.data.folders import FrameSource, open_folder
from hadr.data.splits import OBJECT_IDS, UNKNOWN_OBJECTS, split_by_frame
from hadr.data.transhand import SPLITS

Experiment = Literal["known", "unknown", "by-frame"]
Part = Literal["train", "val", "test"]
EXPERIMENTS: tuple[Experiment, ...] = get_args(Experiment)
PARTS_OF_DATA: tuple[Part, ...] = get_args(Part)


def open_part(roots: Sequence[str | Path], experiment: Experiment, part: Part) -> FrameSource:
    """Open one part of an experiment's frames, of all data folders in this order.

    ValueError where there is no folder, or no such experiment; FileNotFoundError where a folder is
    missing or lacks an object.
    """
    if experiment not in EXPERIMENTS:
        raise ValueError(f"experiment must be one of {EXPERIMENTS}, got {experiment!r}")
    if not roots:
        raise ValueError("no data folder given")
    unseen = set(UNKNOWN_OBJECTS)
    splits: tuple[str, ...] = (part,)
    if experiment == "known":
        wanted = list(OBJECT_IDS)
    elif experiment == "by-frame":
        return _dealt_out(roots, part)
    elif part == "test":
        wanted, splits = sorted(unseen), SPLITS
    else:
        wanted = [name for name in OBJECT_IDS if name not in unseen]
    return FrameSource([open_folder(root, splits, wanted) for root in roots])


def _dealt_out(roots: Sequence[str | Path], part: Part) -> FrameSource:
    """Deal the known objects' frames out to the parts one by one, always in the same way."""
    sizes = [len(open_part(roots, "known", each)) for each in PARTS_OF_DATA]
    whole = FrameSource([open_folder(root, SPLITS, list(OBJECT_IDS)) for root in roots])
    dealt = split_by_frame(len(whole), np.random.default_rng(0), sizes)
    return FrameSource(whole.folders, np.flatnonzero(dealt == part).tolist())
