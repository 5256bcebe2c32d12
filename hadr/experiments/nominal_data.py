"""The plan of a preset whose data nobody has made yet: how many frames there will be, and when.

`hadr reproduce --preset mini --dry-run` shows it without a data folder.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hadr.data.splits import OBJECT_IDS, UNKNOWN_OBJECTS
from hadr.experiments.reproduction_plan import MAKING_DATA, Step
from hadr.experiments.runner import Bench, Run
from hadr.experiments.splits import Experiment, Part
from hadr.records.checkout import checkout_root
from hadr.records.result_file import read_sealed
from hadr.synthesis.generation.settings import PRESETS

SHARES: Mapping[Part, float] = {"train": 0.7, "val": 0.2, "test": 0.1}
"""What each part of a data set has of its frames (7:2:1, by holds)."""


def nominal_frames(size: str, experiment: Experiment, part: Part) -> int:
    """Say how many frames a part will have: the preset's own and the bundled samples'.

    Args:
        size: "mini" or "paper".
        experiment: "known", "unknown" or "by-frame".
        part: "train", "val" or "test".

    Returns:
        Frames; a set that was made has a few more or less, for its holds are dealt out whole.
    """
    frames = PRESETS[size].frames + PRESETS["samples"].frames
    held_out = len(UNKNOWN_OBJECTS) / len(OBJECT_IDS)
    if experiment != "unknown":
        return round(SHARES[part] * frames)
    return round(held_out * frames if part == "test" else (1 - held_out) * SHARES[part] * frames)


class NominalBench(Bench):
    """A bench without data, for a plan alone: no run is finished on it, and none can be made.

    Args:
        out: Folder of the runs.
        size: "mini" or "paper".
        missing: Data folders that were named and are not there; may be empty.
    """

    def __init__(self, out: str | Path, size: str, missing: tuple[Path, ...] = ()) -> None:
        super().__init__((), out, size)
        self.missing = missing

    def count(self, run: Run, part: Part) -> int:
        """Say how many frames a part of a run will have."""
        return nominal_frames(self.size, run.experiment, part)

    def finished(self, run: Run) -> dict[str, Any] | None:
        """None: whether a run fits data that are not there, nobody can say."""
        return None

    def epochs_done(self, run: Run) -> int:
        """0, for the same reason."""
        return 0


def data_steps(bench: Bench) -> list[Step]:
    """Describe the making of the data, where the plan is one without.

    Args:
        bench: The plan's bench.

    Returns:
        One step with its recorded time on two cores (preset paper: on one); for a bench with
        data, none.
    """
    if not isinstance(bench, NominalBench):
        return []
    frames = PRESETS[bench.size].frames
    makes = "DIR, a data folder" if not bench.missing else ", ".join(map(str, bench.missing))
    name = f"hadr generate --preset {bench.size}"
    return [Step(MAKING_DATA, name, f"{frames:,} frames", _seconds(bench.size), makes)]


def _seconds(size: str) -> float | None:
    """What the making of a preset's frames took, or would take; None where nothing is on record."""
    try:
        folder = checkout_root() / "results" / "generation"
    except FileNotFoundError:
        return None
    path = folder / ("mini_run.json" if size == "mini" else "benchmark.json")
    if not path.is_file():
        return None
    told = read_sealed(path)
    if size == "mini":
        return float(told["seconds"])
    return float(told["paper_frames"]["cost"][0]["hours"]) * 3600
