"""The plan of `hadr reproduce`: each step, done or left, and how long its last run took.

Times are of whole runs: the step's own in the output folder, else those that the repository has of
the preset, in ``results/PRESET/run_times.json``. Nothing is estimated.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

from hadr.records.checkout import checkout_root
from hadr.records.provenance import provenance
from hadr.records.reading import structured
from hadr.records.result_file import read_result_file, write_result_file

NAME = "run_times.json"


@dataclass(frozen=True)
class Step:
    """One step of a reproduction.

    Attributes:
        part: "data", "tables", "handover" or "chapters".
        name: What is made.
        left: What is left to be done, in words; "done" where nothing is.
        seconds: Wall-clock seconds of its last run; None where they are not known.
        makes: The file that it leaves, below the output folder.
    """

    part: str
    name: str
    left: str
    seconds: float | None
    makes: str

    @property
    def is_done(self) -> bool:
        """Whether nothing is left to be done."""
        return self.left == "done"


def left_text(left: int, of: int, what: str) -> str:
    """What is left, in words: ``9 scores`` if it is all of them, ``3 of 9 scores``, ``done``."""
    if not left:
        return "done"
    return f"{left} of {of} {what}s" if left < of else f"{of} {what}" + "s" * (of > 1)


def steps_text(steps: Sequence[Step]) -> str:
    """Set a plan as text for a terminal: a line a step, then how many are left."""
    width = max([len(step.name) for step in steps] + [8]) + 2
    lines = [f"  {'step':<{width}} {'left':<18} {'last run':>10}  makes"]
    for part, group in groupby(steps, key=lambda step: step.part):
        lines.append(part)
        for step in group:
            time = "-" if step.seconds is None else seconds_text(step.seconds)
            lines.append(f"  {step.name:<{width}} {step.left:<18} {time:>10}  {step.makes}")
    left = [step for step in steps if not step.is_done]
    told = f"{len(left)} of {len(steps)} steps are left" if left else f"all {len(steps)} are done"
    if known := [step.seconds for step in left if step.seconds is not None]:
        told += f"; the last runs of {len(known)} of them took {seconds_text(sum(known))} together"
    return "\n".join([*lines, "", told])


def seconds_text(seconds: float) -> str:
    """A duration for readers: ``0.8 s``, ``14 s``, ``2 min 05 s``, ``24 min``, ``11 h 05 min``."""
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    whole, minutes = round(seconds), round(seconds / 60)
    if whole < 600:
        return f"{whole} s" if whole < 60 else f"{whole // 60} min {whole % 60:02d} s"
    return f"{minutes} min" if minutes < 100 else f"{minutes // 60} h {minutes % 60:02d} min"


def last_run_times(out: Path, size: str) -> dict[str, float]:
    """Wall-clock seconds by step: the repository's of a preset, over them a folder's own.

    ValueError where a file was changed by hand.
    """
    paths = [out / NAME]
    with contextlib.suppress(FileNotFoundError):  # installed without its checkout
        paths.insert(0, checkout_root() / "results" / size / NAME)
    return {
        row.step: row.seconds
        for path in paths
        if path.is_file()
        for row in structured([*read_result_file(path).rows], list[_Time], path, further=True)
    }


@dataclass(frozen=True)
class _Time:
    """A row of run times."""

    step: str
    seconds: float


def keep_run_times(out: Path, steps: Sequence[Step]) -> None:
    """Note how long the finished steps took, beside what ``OUT/run_times.json`` has of others."""
    path = out / NAME
    rows = {row["step"]: row for row in read_result_file(path).rows} if path.is_file() else {}
    rows |= {
        step.name: {"part": step.part, "step": step.name, "seconds": step.seconds}
        for step in steps
        if step.is_done and step.seconds is not None
    }
    if rows:
        what = "wall-clock seconds of the last run of each step of `hadr reproduce`"
        write_result_file(path, what, list(rows.values()), provenance())
