"""The plan of `hadr reproduce`: each step with what is left of it, its time and what it makes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

from hadr.records.provenance import usable_cores

MAKING_DATA = "data"
"""The part of a plan that makes the data; a plan has it where no data folder is there."""


@dataclass(frozen=True)
class Step:
    """One step of a reproduction.

    Attributes:
        part: "data", "tables", "handover" or "chapters".
        name: What is made.
        left: What is left to be done, in words; "done" where nothing is.
        seconds: Estimate of what is left, from recorded times; None where nobody has timed it.
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


def steps_text(steps: Sequence[Step], jobs: int = 1) -> str:
    """Set a plan as text: a line a step, then the sum.

    Args:
        steps: The steps, part by part.
        jobs: So many trainings or attempts at a time; chapters run one by one.

    Returns:
        Lines for a terminal.
    """
    width = max([len(step.name) for step in steps] + [8]) + 2
    lines = [f"  {'step':<{width}} {'left':<18} {'estimate':>10}  makes"]
    for part, group in groupby(steps, key=lambda step: step.part):
        lines.append(part)
        for step in group:
            time = "-" if step.is_done else seconds_text(step.seconds)
            lines.append(f"  {step.name:<{width}} {step.left:<18} {time:>10}  {step.makes}")
    lines += ["", *_sums(steps, jobs)]
    return "\n".join(lines)


def seconds_text(seconds: float | None) -> str:
    """An estimate for readers: ``40 s``, ``24 min``, ``11 h 05 min``; ``?`` where there is none."""
    if seconds is None:
        return "?"
    if seconds < 99.5:
        return f"{max(round(seconds), 1)} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 100 else f"{minutes // 60} h {minutes % 60:02d} min"


def _sums(steps: Sequence[Step], jobs: int) -> list[str]:
    left = [step for step in steps if not step.is_done]
    if not left:
        return [f"all of {len(steps)} steps are done"]
    timed = [(step.part, step.seconds) for step in left if step.seconds is not None]
    told = f"{len(left)} of {len(steps)} steps are left"
    if not timed:
        return [f"{told}; none of them has a time on record"]
    told += f": about {seconds_text(sum(s for _, s in timed))}, one after the other"
    at_once = min(jobs, usable_cores(), len(left))
    if at_once > 1:
        alone = ("chapters", MAKING_DATA)
        shared = sum(s / (1 if part in alone else at_once) for part, s in timed)
        told += f"; about {seconds_text(shared)}, {at_once} at a time"
    lines = [told]
    if unknown := len(left) - len(timed):
        lines.append(f"not counted: {unknown} of them, marked ?, which have no time on record")
    lines.append(
        "estimates are what the same steps took when they were last measured (files in results/)"
    )
    lines += [
        f"the data are not there: all of this is planned for the {step.left} that\n"
        f"  {step.name} --out DIR\n"
        "makes, and the bundled samples beside them (--data DIR data_samples/frames); which "
        "trainings of the\noutput folder are finished, only the data can tell: here none is"
        for step in left
        if step.part == MAKING_DATA
    ]
    return lines
