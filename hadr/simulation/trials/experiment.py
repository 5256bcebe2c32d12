"""The experiment: 8 objects, 6 holds each, once in every condition; resumable, on several cores.

    OUT/hadr/0004-902.json   a finished attempt: its outcome, sealed by a checksum
    OUT/hadr/0004-902.npz    the states of the world, for films and for a second look
    OUT/hadr/0004-902-log.npz  what the workflow saw and commanded, for a replay

An attempt is run again when its description, its code or its networks are others than its file
says (`hadr.records.dependencies`), when the file was changed by hand, or when its states or log are
missing or damaged.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import threading
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import closing, contextmanager
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from hadr.handover.stages import Stage, Transition
from hadr.records.caches import file_sha256
from hadr.records.provenance import plain, record_of
from hadr.records.result_file import digest, is_sealed, seal_row, sealed_row
from hadr.records.writing import set_aside
from hadr.simulation.film.film import film_frames, write_film
from hadr.simulation.trials import TRIAL_HOLDS, TRIAL_OBJECTS
from hadr.simulation.trials.trial import Trial, run_trial
from hadr.simulation.world.scenes import HeldScene, held_scene
from hadr.simulation.world.state import WorldState, load_states, save_states

INCIDENTS: dict[str, str] = {
    "human withdraws": "the hand withdrew",
    "mm from the gripper's path": "the hand was in the way",
    "out of reach": "the arm's reach ended",
    "singular": "the arm's reach ended",
    "protective stop": "the hand pushed the arm (protective stop)",
    "does not fit": "the glass was too wide there",
    "object dropped or lost": "nothing was between the fingers",
}
"""What a stop's reason says, and how that is called when attempts are summed up."""
_LATE = 3.0

Report = Callable[[Trial, dict[str, Any]], None]
"""Told of each attempt and its outcome, finished now or before."""


def attempts(
    condition: str,
    *,
    objects: Sequence[str] = TRIAL_OBJECTS,
    holds: Sequence[int] = TRIAL_HOLDS,
    seed: int = 0,
    template: Trial | None = None,
) -> list[Trial]:
    """List a condition's attempts, object by object.

    Seed and holds are the same in all conditions, which are thus paired; `template` has what else
    the attempts share, such as a faster hand.
    """
    shared = template or Trial(objects[0], holds[0])
    return [
        replace(shared, object_id=object_id, hold_number=hold, condition=condition, seed=seed)
        for object_id in objects
        for hold in holds
    ]


def run_attempts(
    trials: Iterable[Trial], out: Path, *, jobs: int = 1, report: Report | None = None
) -> list[dict[str, Any]]:
    """Run attempts, each one that is not finished yet, and give all outcomes in their order.

    Args:
        trials: The attempts.
        out: Folder of their files; made where it is missing.
        jobs: So many at a time, each with one thread: in this process, or each in its own.
        report: Told of each one as it is finished.

    Raises:
        KeyboardInterrupt: Interrupted. What was under way is lost, what was finished stays.
    """
    trials = list(trials)
    rows = {i: row for i, trial in enumerate(trials) if (row := _finished_row(out, trial))}
    missing = [i for i in range(len(trials)) if i not in rows]
    make = _here if jobs == 1 or not missing else _in_processes
    with closing(make(trials, missing, out, min(jobs, len(missing)))) as finished:
        for i, row in chain(list(rows.items()), finished):
            rows[i] = row
            if report is not None:
                report(trials[i], row)
    return [rows[i] for i in range(len(trials))]


def _here(
    trials: Sequence[Trial], missing: Iterable[int], out: Path, _: int
) -> Generator[tuple[int, dict[str, Any]]]:
    """As `_in_processes`, in this one."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # sums have one order then, whatever the number of jobs
    try:
        for i in missing:
            yield i, _attempt(trials[i], out)
    finally:
        torch.set_num_threads(threads)


def _in_processes(
    trials: Sequence[Trial], missing: Iterable[int], out: Path, jobs: int
) -> Generator[tuple[int, dict[str, Any]]]:
    """Make attempts in processes, and give each one's number and outcome as it is finished."""
    # processes are spawned: a forked one would inherit PyTorch's threads
    pool = ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), _begin_worker)
    try:
        with _interrupts_wait():
            under_way = {pool.submit(_attempt, trials[i], out): i for i in missing}
        for future in as_completed(under_way):
            yield under_way[future], future.result()
    except BaseException:
        for process in list((pool._processes or {}).values()):
            process.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _interrupts_wait() -> Iterator[None]:
    """Put Ctrl-C off; a process that is started meanwhile never hears of it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin_worker() -> None:
    """Make a process ready for attempts: Ctrl-C is its parent's business, and it ends with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    torch.set_num_threads(1)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def is_finished(out: Path, trial: Trial) -> bool:
    """Say whether an attempt is whole and of this code, so that it is not made again."""
    return _finished_row(out, trial) is not None


def _path(out: Path, trial: Trial) -> Path:
    return out / trial.condition / f"{trial.name}.json"


def _companions(path: Path) -> dict[str, Path]:
    """The other files of an attempt, by the name of their checksum in its row."""
    log = path.with_name(f"{path.stem}-log.npz")
    return {"states_sha256": path.with_suffix(".npz"), "log_sha256": log}


def _finished_row(out: Path, trial: Trial) -> dict[str, Any] | None:
    """An attempt's row where nothing of it is to be made again."""
    path = _path(out, trial)
    row = sealed_row(path, trial.record)
    if row is None:
        return None
    for name, file in _companions(path).items():
        if not file.is_file() or row.get(name) != file_sha256(file):
            return None
    return row


def _attempt(trial: Trial, out: Path) -> dict[str, Any]:
    path = _path(out, trial)
    path.parent.mkdir(parents=True, exist_ok=True)
    sha = digest(trial.record)  # of the code as it is before the attempt
    run = run_trial(trial)
    files = _companions(path)
    _keep_changed(path, files)
    save_states(files["states_sha256"], run.states)
    run.log.save(files["log_sha256"])
    sums = {name: file_sha256(file) for name, file in files.items()}
    outcome = plain({**record_of(run.outcome), "config_sha256": sha})
    changes = [[t.time, t.before.value, t.after.value, t.reason] for t in run.transitions]
    described = {"trial": plain(record_of(trial)), **outcome, **sums}
    return seal_row(path, {**described, "transitions": changes})


def _keep_changed(path: Path, files: Mapping[str, Path]) -> None:
    """Set files aside that are not as the row of their attempt says."""
    if path.is_file() and is_sealed(path):  # without a row it was never finished
        sums = read_row(path)
        for name, file in files.items():
            if file.is_file() and sums.get(name) != file_sha256(file):
                set_aside(file)


def finished_attempt(
    out: Path, trial: Trial
) -> tuple[dict[str, Any], list[WorldState], list[Transition], HeldScene]:
    """Read an attempt below the folder of `run_attempts`, whatever settings all attempts shared.

    Returns:
        Its row, its states, its changes of stage and what was held out.

    Raises:
        FileNotFoundError: It is not finished, or it was another attempt, or its row was edited.
        ValueError: A file of it is cut off or damaged. Each message has the path and what to do.
    """
    path = _path(out, trial)
    if not path.is_file():
        raise FileNotFoundError(f"there is no finished attempt {path}; hadr handover makes it")
    row = read_row(path)
    content = {name: value for name, value in row.items() if name != "sha256"}
    if row.get("sha256") != digest(content) or row.get("trial") != plain(record_of(trial)):
        raise FileNotFoundError(
            f"{path} is of another attempt, or was changed by hand; hadr handover makes it again"
        )
    file = path.with_suffix(".npz")
    if not file.is_file():
        raise FileNotFoundError(f"{file} is missing: hadr handover makes the attempt again")
    if row.get("states_sha256") != file_sha256(file):
        raise ValueError(f"{file} is cut off or was changed: hadr handover makes the attempt again")
    states = load_states(file)
    changes = [Transition(t, Stage(a), Stage(b), why) for t, a, b, why in row["transitions"]]
    scene = held_scene(trial.object_id, trial.hold_number, trial.seed)
    return row, states, changes, scene


def read_row(path: Path) -> dict[str, Any]:
    """Read an attempt's row, whatever attempt it is of; ValueError where it is cut off or none."""
    try:
        row = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(
            f"{path} is cut off or no JSON ({error}); hadr handover makes the attempt again"
        ) from error
    if not isinstance(row, dict):
        raise ValueError(
            f"{path} holds a {type(row).__name__} and no attempt; hadr handover makes it again"
        )
    return row


def film_path(out: Path, trial: Trial) -> Path:
    """Where `film_of_attempt` writes to."""
    return _path(out, trial).with_suffix(".mp4")


def film_of_attempt(out: Path, trial: Trial) -> Path:
    """Write a finished attempt's film beside its files; errors as of `finished_attempt`."""
    row, states, changes, scene = finished_attempt(out, trial)
    frames = film_frames(states, scene, changes, ending=ending_of(row))
    return write_film(film_path(out, trial), frames)


def ending_of(row: dict[str, Any]) -> str:
    """The last words of an attempt's film, such as ``drop after 4.7 s``."""
    return f"{row['verdict']} after {row['decided_at']:.1f} s"


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


def _stage(row: dict[str, Any]) -> str:
    """The stage in which an attempt's time ran out."""
    changes = row["transitions"]
    return str(changes[-1][2]) if changes else Stage.WAIT_AND_OBSERVE.value


def incidents(row: dict[str, Any]) -> set[str]:
    """What happened in an attempt, by its row: words of `INCIDENTS`; "never stopped" with no stop.

    A stop that none of them tells of is "stopped for another reason". Besides, "no grasp for 3 s"
    where none was chosen in that time, and "went in again beside" where a finger met the object.
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
    return found


def condition_row(condition: str, outcomes: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Sum a condition's outcomes of `run_attempts` up as a row of the result file.

    Returns:
        Attempts, successes, their rate with Wilson's 95 % interval, how many objects reach 0.5, 0.8
        and 1.0 as in the paper's table, successes and attempts by the hand's motion, failures by
        kind, time-outs by the stage in which they came, for each of the `incidents` the successes
        and attempts in which it happened, mean times in seconds, the smallest distance to the hand
        in metres, the largest force on it in newtons, also by way and stage, the mean share of the
        object's points that were right to 2 cm in successes and in failures, and each attempt's
        verdict.

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
        "points_right": {
            "success": mean("points_right", succeeded),
            "failure": mean("points_right", failed),
        },
        "verdicts": verdicts(outcomes),
    }


def pooled(first: dict[str, Any], second: dict[str, Any]) -> dict[str, Any]:
    """Two rows of `condition_row`, of one condition and other attempts, as one.

    Means are weighted by the attempts that are summed up (successes, where they are of these).
    Incidents are of the rows that have them. ValueError for an attempt that both have.
    """
    twice = sorted(first["verdicts"].keys() & second["verdicts"].keys())
    if twice or first["condition"] != second["condition"]:
        whose = " and ".join(row["condition"] for row in (first, second))
        raise ValueError(f"rows of {whose} can't be pooled, both have {', '.join(twice) or 'none'}")
    won, tried = (np.array([row[n] for row in (first, second)]) for n in ("successes", "attempts"))

    def mean(values: Sequence[float | None], weights: npt.NDArray[np.int64]) -> float:
        known = [k for k, value in enumerate(values) if value is not None and weights[k]]
        if not known:
            return float("nan")
        return float(np.average([values[k] for k in known], weights=weights[known]))

    def added(name: str) -> dict[str, Any]:
        total: dict[str, Any] = {}
        for row in (first, second):
            for key, count in row.get(name, {}).items():
                total[key] = (np.array(total.get(key, 0)) + np.array(count)).tolist()
        return dict(sorted(total.items()))

    both = {**first["verdicts"], **second["verdicts"]}
    forces = sorted({**first["largest_forces_n"], **second["largest_forces_n"]})
    out = {"condition": first["condition"], **_rates(both), "verdicts": both}
    out |= {n: added(n) for n in ("by_motion", "failures", "time_out_in", "incidents")}
    for name, value in first.items():
        pair = (value, second[name])
        if name == "mean_seconds":
            out[name] = mean(pair, won)
        elif name.startswith("mean_"):
            out[name] = mean(pair, tried)
    of = (first["points_right"], second["points_right"])
    out["points_right"] = {
        "success": mean([row["success"] for row in of], won),
        "failure": mean([row["failure"] for row in of], tried - won),
    }
    out["smallest_hand_distance_m"] = min(
        row["smallest_hand_distance_m"] for row in (first, second)
    )
    out["largest_force_n"] = max(row["largest_force_n"] for row in (first, second))
    out["largest_forces_n"] = {
        n: max(row["largest_forces_n"].get(n, 0.0) for row in (first, second)) for n in forces
    }
    return {name: out[name] for name in (*first, *out)}


def _rates(ends: Mapping[str, str]) -> dict[str, Any]:
    """What `verdicts` alone say."""
    from scipy.stats import binomtest  # takes a second to import, which no worker needs

    won = {name: verdict == "success" for name, verdict in ends.items()}
    of_object: dict[str, list[bool]] = {}
    for name in sorted(won):
        of_object.setdefault(name.partition("-")[0], []).append(won[name])
    rates = {name: float(np.mean(tries)) for name, tries in of_object.items()}
    interval = binomtest(sum(won.values()), len(won)).proportion_ci(0.95, "wilson")
    return {
        "attempts": len(won),
        "successes": sum(won.values()),
        "rate": sum(won.values()) / len(won),
        "interval": [float(interval.low), float(interval.high)],
        "objects_at_50_percent": sum(rate > 0.5 for rate in rates.values()),
        "objects_at_80_percent": sum(rate > 0.8 for rate in rates.values()),
        "objects_at_100_percent": sum(rate >= 1.0 for rate in rates.values()),
        "rate_by_object": rates,
    }
