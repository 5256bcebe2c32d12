"""The handover's table as a part of `hadr reproduce`: which attempts, what is left, the run.

OUT/handover/hadr/0004-902.json   an attempt, as `hadr handover` leaves it
OUT/tables/handover.json          the table's rows
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hadr.experiments.steps import Step, left_text
from hadr.records.provenance import machine_text, provenance
from hadr.records.result_file import read_result_file, write_result_file

if TYPE_CHECKING:
    from hadr.simulation.trials.trial import Condition, Trial

    Attempts = Mapping[Condition, Sequence[Trial]]

REPRODUCED: tuple[Condition, ...] = (
    "raw", "inpainted", "hadr", "hadr-plus", "perfect", "hadr-no-rescoring", "hadr-no-tracking",
)  # fmt: skip
"""The conditions of results/mini/handover.json; `hadr handover` alone leaves out hadr-plus."""


def planned_attempts(size: str, seed: int) -> dict[Condition, list[Trial]]:
    """The attempts of each condition: 48, and at preset tiny one, to see that everything runs."""
    from hadr.simulation.trials.experiment import attempts

    if size == "tiny":
        return {
            condition: attempts(condition, objects=["0004"], holds=[902], seed=seed)
            for condition in REPRODUCED
        }
    return {condition: attempts(condition, seed=seed) for condition in REPRODUCED}


def handover_steps(plan: Attempts, out: Path, times: Mapping[str, float]) -> list[Step]:
    """Describe the conditions as steps of a plan."""
    from hadr.simulation.trials.experiment import is_finished

    table, steps = out / "tables" / "handover.json", []
    rows = read_result_file(table).rows if table.is_file() else ()
    own = {row["condition"]: row["attempts"] * row["mean_wall_seconds"] for row in rows}
    for condition, trials in plan.items():
        left = sum(not is_finished(out / "handover", trial) for trial in trials)
        words = left_text(left, len(trials), "attempt")
        name = f"handover/{condition}"
        seconds = times.get(name) if left else own.get(condition, times.get(name))
        steps.append(Step("handover", name, words, seconds, "tables/handover.json"))
    return steps


def make_handover_table(plan: Attempts, out: Path, jobs: int) -> None:
    """Make the attempts that are missing, `jobs` at a time, and write the table."""
    from hadr.simulation.trials.experiment import condition_row, run_attempts

    rows = []
    for condition, trials in plan.items():
        rows.append(
            condition_row(condition, run_attempts(trials, out / "handover", jobs=jobs, report=_say))
        )
        print(f"{condition}: {rows[-1]['successes']} of {rows[-1]['attempts']}", flush=True)
    what = (
        f"handover attempts in simulation, {len(trials)} a condition, seed {trials[0].seed}; masks "
        "and keypoints from the simulator with noise; success by HandoverSim's rules"
    )
    origin = {**provenance(), "machine": machine_text()}
    write_result_file(out / "tables" / "handover.json", what, rows, origin)


def _say(trial: Trial, row: Mapping[str, Any]) -> None:
    print(f"{trial.condition:18} {trial.name}  {row['verdict']:14} {row['reason']}", flush=True)
