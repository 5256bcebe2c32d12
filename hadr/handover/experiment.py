"""The experiment: 8 objects, 6 holds each, once for every arm; resumable, on several cores.

    OUT/hadr/0004-902.json   a finished attempt: its outcome, sealed by a checksum
    OUT/hadr/0004-902.npz    the states of the world, for films and for a second look
    OUT/hadr/0004-902-log.npz  what the workflow saw and commanded, for a replay

An attempt is run again when its description or the attempts' settings differ from what its file
says, or when the file was changed by hand. A change of the code is not noticed: it needs a new OUT.
"""

from __future__ import annotations

import json
import multiprocessing
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.stats import binomtest

from hadr.handover.film import film_frames, write_film
from hadr.handover.scenes import TRIAL_HOLDS, TRIAL_OBJECTS, HeldScene, held_scene
from hadr.handover.state_record import load_states, save_states
from hadr.handover.trial import Arm, Trial, run_trial
from hadr.handover.workflow import Stage, Transition
from hadr.handover.world_state import WorldState
from hadr.provenance import plain, record_of
from hadr.result_file import digest, seal_row, sealed_row

Report = Callable[[Trial, dict[str, Any]], None]
"""Told of each attempt and its outcome, finished now or before."""


def attempts(
    arm: Arm,
    *,
    objects: Sequence[str] = TRIAL_OBJECTS,
    holds: Sequence[int] = TRIAL_HOLDS,
    seed: int = 0,
    template: Trial | None = None,
) -> list[Trial]:
    """List an arm's attempts, object by object.

    Args:
        arm: Which arm of the experiment.
        objects: Ids of the objects.
        holds: Numbers of the holding poses.
        seed: Seed of places, motions and noise; the same for all arms, so that they are paired.
        template: What else the attempts share, such as a faster hand.

    Returns:
        ``len(objects) * len(holds)`` attempts.
    """
    shared = template or Trial(objects[0], holds[0])
    return [
        replace(shared, object_id=object_id, hold_number=hold, arm=arm, seed=seed)
        for object_id in objects
        for hold in holds
    ]


def run_attempts(
    trials: Iterable[Trial], out: Path, *, jobs: int = 1, report: Report | None = None
) -> list[dict[str, Any]]:
    """Run attempts, each one that is not finished yet.

    Args:
        trials: The attempts.
        out: Folder of their files; made where it is missing.
        jobs: So many at a time, each with one thread: in this process, or each in its own.
        report: Told of each one as it is finished.

    Returns:
        The outcomes in the attempts' order.

    Raises:
        ValueError: jobs is less than 1.
    """
    if jobs < 1:
        raise ValueError(f"jobs must be at least 1, got {jobs}")
    trials = list(trials)
    found = [sealed_row(_path(out, t), t.record) for t in trials]
    missing = [i for i, row in enumerate(found) if row is None]
    for i, row in enumerate(found):
        if row is not None and report is not None:
            report(trials[i], row)
    if jobs == 1:
        threads = torch.get_num_threads()
        _one_thread()
        try:
            for i in missing:
                found[i] = _attempt(trials[i], out)
                if report is not None:
                    report(trials[i], found[i] or {})
        finally:
            torch.set_num_threads(threads)
    elif missing:
        # processes are spawned: a forked one would inherit PyTorch's threads
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(min(jobs, len(missing)), context, _one_thread) as pool:
            waiting = {i: pool.submit(_attempt, trials[i], out) for i in missing}
            for i, future in waiting.items():
                found[i] = future.result()
                if report is not None:
                    report(trials[i], found[i] or {})
    return [row for row in found if row is not None]


def _one_thread() -> None:
    """Sums have one order then, whatever the number of jobs."""
    torch.set_num_threads(1)


def is_finished(out: Path, trial: Trial) -> bool:
    """Say whether an attempt was made with these settings, so that it is not made again.

    Args:
        out: The folder that `run_attempts` writes to.
        trial: Which attempt.
    """
    return sealed_row(_path(out, trial), trial.record) is not None


def _path(out: Path, trial: Trial) -> Path:
    return out / trial.arm / f"{trial.name}.json"


def _attempt(trial: Trial, out: Path) -> dict[str, Any]:
    path = _path(out, trial)
    path.parent.mkdir(parents=True, exist_ok=True)
    run = run_trial(trial)
    save_states(path.with_suffix(".npz"), run.states)
    run.log.save(path.with_name(f"{trial.name}-log.npz"))
    outcome = plain({**record_of(run.outcome), "config_sha256": digest(trial.record)})
    changes = [[t.time, t.before.value, t.after.value, t.reason] for t in run.transitions]
    return seal_row(path, {"trial": plain(record_of(trial)), **outcome, "transitions": changes})


def finished_attempt(
    out: Path, trial: Trial
) -> tuple[dict[str, Any], list[WorldState], list[Transition], HeldScene]:
    """Read a finished attempt, whatever the settings were that all attempts shared then.

    Args:
        out: The folder that `run_attempts` wrote to.
        trial: Which attempt.

    Returns:
        Its row, its states, its changes of stage and what was held out.

    Raises:
        FileNotFoundError: It is not finished, or it was another attempt, or its row was edited.
    """
    path = _path(out, trial)
    if not path.is_file():
        raise FileNotFoundError(f"there is no finished attempt {path}")
    row = json.loads(path.read_text(encoding="utf-8"))
    content = {name: value for name, value in row.items() if name != "sha256"}
    if row.get("sha256") != digest(content) or row["trial"] != plain(record_of(trial)):
        raise FileNotFoundError(f"{path} is of another attempt, or was changed by hand")
    changes = [Transition(t, Stage(a), Stage(b), why) for t, a, b, why in row["transitions"]]
    scene = held_scene(trial.object_id, trial.hold_number, trial.seed)
    return row, load_states(path.with_suffix(".npz")), changes, scene


def film_of_attempt(out: Path, trial: Trial) -> Path:
    """Write a finished attempt's film beside its files.

    Raises:
        FileNotFoundError: As `finished_attempt`.
    """
    _, states, changes, scene = finished_attempt(out, trial)
    return write_film(_path(out, trial).with_suffix(".mp4"), film_frames(states, scene, changes))


def arm_row(arm: str, outcomes: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Sum an arm's attempts up as a row of the result file.

    Args:
        arm: The arm's name.
        outcomes: What `run_attempts` gave.

    Returns:
        Attempts, successes, their rate with Wilson's 95 % interval, how many objects reach 0.5,
        0.8 and 1.0 as in the paper's table, failures by kind, mean times in seconds, the smallest
        distance to the hand in metres and the largest force on it in newtons.

    Raises:
        ValueError: There is no outcome.
    """
    if not outcomes:
        raise ValueError(f"no attempt of arm {arm!r} to sum up")
    won = np.array([row["verdict"] == "success" for row in outcomes])
    objects = np.array([row["trial"]["object_id"] for row in outcomes])
    by_object = {name: float(won[objects == name].mean()) for name in sorted(set(objects))}
    interval = binomtest(int(won.sum()), len(won)).proportion_ci(0.95, "wilson")
    succeeded = [row for row in outcomes if row["verdict"] == "success"]

    def mean(name: str, rows: Sequence[dict[str, Any]]) -> float:
        values = [row[name] for row in rows if row[name] is not None]
        return float(np.mean(values)) if values else float("nan")

    return {
        "arm": arm,
        "attempts": len(won),
        "successes": int(won.sum()),
        "rate": float(won.mean()),
        "interval": [float(interval.low), float(interval.high)],
        "objects_at_50_percent": sum(rate > 0.5 for rate in by_object.values()),
        "objects_at_80_percent": sum(rate > 0.8 for rate in by_object.values()),
        "objects_at_100_percent": sum(rate >= 1.0 for rate in by_object.values()),
        "rate_by_object": by_object,
        "failures": dict(
            sorted(Counter(r["verdict"] for r in outcomes if r["verdict"] != "success").items())
        ),
        "mean_seconds": mean("decided_at", succeeded),
        "mean_seconds_to_first_grasp": mean("first_grasp_at", outcomes),
        "mean_planning_wall_seconds": mean("planning_wall_seconds", outcomes),
        "mean_wall_seconds": mean("wall_seconds", outcomes),
        "smallest_hand_distance_m": min(row["smallest_distance"] for row in outcomes),
        "largest_force_n": max(row["largest_force"] for row in outcomes),
    }
