"""The experiment: 8 objects, 6 holds each, once in every condition; resumable, on several cores.

    OUT/hadr/0004-902.json   a finished attempt: its outcome, sealed by a checksum
    OUT/hadr/0004-902.npz    the states of the world, for films and for a second look
    OUT/hadr/0004-902-log.npz  what the workflow saw and commanded, for a replay

An attempt is run again when its description, its code or its networks are others than its file
says (`hadr.records.dependencies`), when the file was changed by hand, or when its states or log are
missing or damaged.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

import torch

from hadr.handover.stages import Stage, Transition
from hadr.records.caches import file_sha256
from hadr.records.processes import one_thread, run_tasks
from hadr.records.provenance import plain, record_of
from hadr.records.reading import read_json, structured
from hadr.records.result_file import digest, is_sealed, seal_row, sealed_row
from hadr.records.writing import set_aside
from hadr.simulation.film.film import film_frames, write_film
from hadr.simulation.trials import TRIAL_HOLDS, TRIAL_OBJECTS
from hadr.simulation.trials.trial import Trial, run_trial
from hadr.simulation.world.scenes import HeldScene, held_scene
from hadr.simulation.world.state import WorldState, load_states, save_states

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
    trials: Iterable[Trial],
    out: Path | Iterable[Path],
    *,
    jobs: int = 1,
    report: Report | None = None,
) -> list[dict[str, Any]]:
    """Run attempts, each one that is not finished yet, and give all outcomes in their order.

    Args:
        trials: The attempts.
        out: Folder of their files, or one for each attempt; made where it is missing.
        jobs: So many at a time, each with one thread: in this process, or each in its own.
        report: Told of each one as it is finished.

    Raises:
        KeyboardInterrupt: Interrupted. What was under way is lost, what was finished stays.
        ChildProcessError: A process died.
    """
    trials = list(trials)
    outs = [out] * len(trials) if isinstance(out, Path) else out
    tasks = list(zip(outs, trials, strict=True))
    rows = {i: row for i, task in enumerate(tasks) if (row := _finished_row(*task))}
    missing = [i for i in range(len(tasks)) if i not in rows]
    made = run_tasks(_attempt, [tasks[i] for i in missing], jobs)
    with closing(made):
        for i, row in chain(list(rows.items()), ((missing[n], row) for n, row in made)):
            rows[i] = row
            if report is not None:
                report(trials[i], row)
    return [rows[i] for i in range(len(trials))]


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


def _attempt(task: tuple[Path, Trial]) -> dict[str, Any]:
    path, trial = _path(*task), task[1]
    path.parent.mkdir(parents=True, exist_ok=True)
    sha = digest(trial.record)  # of the code as it is before the attempt
    # sums have one order then, whatever the number of jobs
    with one_thread(torch.get_num_threads, torch.set_num_threads):
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
        return structured(read_json(path), dict[str, Any], path)
    except ValueError as error:
        raise ValueError(f"{error}; hadr handover makes the attempt again") from error


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
