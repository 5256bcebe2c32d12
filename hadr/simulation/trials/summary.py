"""What attempts come to: a row of the result file for each condition."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.stats import norm

from hadr.handover.stages import Stage

INCIDENTS: dict[str, str] = {
    "human withdraws": "the hand withdrew",
    "mm from the gripper's path": "the hand was in the way",
    "out of reach": "the arm's reach ended",
    "singular": "the arm's reach ended",
    "protective stop": "a protective stop",
    "does not fit": "the glass was too wide there",
    "closed on nothing": "nothing was between the fingers",
    "object dropped or lost": "the glass slipped out of the fingers",
}
"""What a stop's reason says, and how that is called when attempts are summed up."""
BELIEVED = ("points_right", "points_right_at_grasp", "grasp_off")
"""What the robot's belief was worth when it chose the last grasp, see `Outcome`."""
_LATE = 3.0


def verdicts(outcomes: Sequence[dict[str, Any]]) -> dict[str, str]:
    """The judge's word on each attempt, by name and seed; ValueError where one is twice."""
    found: dict[str, str] = {}
    for row in outcomes:
        trial = row["trial"]
        name = f"{trial['object_id']}-{trial['hold_number']}"
        if trial["seed"]:
            name += f"-{trial['seed']}"
        if name in found:
            raise ValueError(f"attempt {name} is there twice")
        found[name] = row["verdict"]
    return found


def hold_of(name: str) -> str:
    """Object and hold of an attempt's name in `verdicts`, which other seeds share: "0001-905"."""
    return "-".join(name.split("-")[:2])


def success_interval(won: Mapping[str, bool]) -> list[float]:
    """Wilson's 95 % interval of a rate of success, from each attempt's by name; two shares, 0..1.

    Attempts of one hold with several seeds are alike. The number of attempts is therefore divided
    by Kish's design effect, how much more the holds' means vary than those of independent attempts
    would; at least one attempt a hold is left, and no more than there are.
    """
    of_hold: dict[str, list[bool]] = {}
    for name, success in won.items():
        of_hold.setdefault(hold_of(name), []).append(success)
    count, holds, rate = len(won), len(of_hold), float(np.mean(list(won.values())))
    apart = sum((sum(tries) - len(tries) * rate) ** 2 for tries in of_hold.values())
    variance = apart / count**2 * holds / max(holds - 1, 1)
    alike = rate * (1 - rate) / max(variance, 1e-12)  # independent attempts that would vary so
    n = float(np.clip(alike, holds, count))
    z = float(norm.ppf(0.975))
    middle, half = rate + z**2 / (2 * n), z * np.sqrt(rate * (1 - rate) / n + (z / (2 * n)) ** 2)
    return [float((middle + side * half) / (1 + z**2 / n)) for side in (-1, 1)]


def _stage(row: dict[str, Any]) -> str:
    """The stage in which an attempt's time ran out."""
    changes = row["transitions"]
    return str(changes[-1][2]) if changes else Stage.WAIT_AND_OBSERVE.value


def incidents(row: dict[str, Any]) -> set[str]:
    """What happened in an attempt, by its row: words of `INCIDENTS`; "never stopped" with no stop.

    A stop that none of them tells of is "stopped for another reason". Besides, "no grasp for 3 s"
    where none was chosen in that time, "went in again beside" where a finger met the object, and
    "the glass was torn out of the hand".
    """
    stops = [why for _, _, after, why in row["transitions"] if after == Stage.STOPPED.value]
    found = {
        next(
            (name for part, name in INCIDENTS.items() if part in why), "stopped for another reason"
        )
        for why in stops
    } or {"never stopped"}
    if row["first_grasp_at"] is None or not row["first_grasp_at"] < _LATE:
        found.add("no grasp for 3 s")
    if row["corrections"]:
        found.add("went in again beside")
    if row["torn"]:
        found.add("the glass was torn out of the hand")
    return found


def condition_row(condition: str, outcomes: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Sum a condition's outcomes of `run_attempts` up as a row of the result file.

    Returns:
        Attempts, successes, their rate with its 95 % interval (`success_interval`), how many
        objects reach 0.5, 0.8 and 1.0 as in the paper's table, successes and attempts by the hand's
        motion, failures by kind, time-outs by the stage in which they came, for each of the
        `incidents` the successes and attempts in which it happened, mean times in seconds, the
        smallest distance to the hand in metres, the largest force on it in newtons, also by way and
        stage, the means of `BELIEVED` in successes and in failures, and each attempt's verdict.

    Raises:
        ValueError: There is no outcome, or an attempt is there twice.
    """
    if not outcomes:
        raise ValueError(f"no attempt of condition {condition!r} to sum up")
    succeeded = [row for row in outcomes if row["verdict"] == "success"]
    failed = [row for row in outcomes if row["verdict"] != "success"]
    timed_out = [row for row in failed if row["verdict"] == "time-out"]
    forces = sorted({name for row in outcomes for name in row["forces"]})

    def mean(name: str, rows: Sequence[dict[str, Any]]) -> float:
        values = [row[name] for row in rows if row.get(name) is not None]
        return float(np.mean(values)) if values else float("nan")

    def won_of(names: Callable[[dict[str, Any]], Iterable[str]]) -> dict[str, list[int]]:
        tried = Counter(name for row in outcomes for name in names(row))
        won = Counter(name for row in succeeded for name in names(row))
        return {name: [won[name], tried[name]] for name in sorted(tried)}

    return {
        "condition": condition,
        **_rates(verdicts(outcomes)),
        "by_motion": won_of(lambda row: [row["motion"]]),
        "failures": dict(sorted(Counter(row["verdict"] for row in failed).items())),
        "time_out_in": dict(sorted(Counter(map(_stage, timed_out)).items())),
        "incidents": won_of(incidents),
        "mean_seconds": mean("decided_at", succeeded),
        "mean_seconds_to_first_grasp": mean("first_grasp_at", outcomes),
        "mean_planning_wall_seconds": mean("planning_wall_seconds", outcomes),
        "mean_wall_seconds": mean("wall_seconds", outcomes),
        "smallest_hand_distance_m": min(row["smallest_distance"] for row in outcomes),
        "largest_force_n": max(row["largest_force"] for row in outcomes),
        "largest_forces_n": {n: max(row["forces"].get(n, 0.0) for row in outcomes) for n in forces},
        **{n: {"success": mean(n, succeeded), "failure": mean(n, failed)} for n in BELIEVED},
        "verdicts": verdicts(outcomes),
    }


def _rates(ends: Mapping[str, str]) -> dict[str, Any]:
    """What `verdicts` alone say."""
    won = {name: verdict == "success" for name, verdict in ends.items()}
    of_object: dict[str, list[bool]] = {}
    for name in sorted(won):
        of_object.setdefault(name.partition("-")[0], []).append(won[name])
    rates = {name: float(np.mean(tries)) for name, tries in of_object.items()}
    return {
        "attempts": len(won),
        "successes": sum(won.values()),
        "rate": sum(won.values()) / len(won),
        "interval": success_interval(won),
        "objects_at_50_percent": sum(rate > 0.5 for rate in rates.values()),
        "objects_at_80_percent": sum(rate > 0.8 for rate in rates.values()),
        "objects_at_100_percent": sum(rate >= 1.0 for rate in rates.values()),
        "rate_by_object": rates,
    }
