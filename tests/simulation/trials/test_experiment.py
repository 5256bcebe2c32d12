"""The experiment: what is run again and what is not, and how a condition's row is summed up."""

import json
import os
import pickle
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from hadr.data.samples import samples_dir
from hadr.handover.logs.replay import replay
from hadr.handover.logs.run_log import read_run_log
from hadr.records import dependencies
from hadr.records.dependencies import modules_behind
from hadr.records.provenance import record_of
from hadr.records.result_file import digest
from hadr.simulation.camera.sight import CHECKPOINTS, SOURCES
from hadr.simulation.trials import experiment
from hadr.simulation.trials.experiment import (
    attempts,
    ending_of,
    film_of_attempt,
    finished_attempt,
    is_finished,
    run_attempts,
)
from hadr.simulation.trials.trial import CODE, CONDITIONS, Run, Trial, _code, depth_source
from hadr.training.checkpoints import load_checkpoint


@pytest.fixture
def made(whole: Run, monkeypatch: pytest.MonkeyPatch) -> Counter[Trial]:
    """How often each attempt was made; the whole attempt's run stands for all of them."""
    count: Counter[Trial] = Counter()

    def run_trial(trial: Trial) -> Run:
        count[trial] += 1
        return replace(whole, trial=trial)

    monkeypatch.setattr(experiment, "run_trial", run_trial)
    return count


def test_attempts_are_paired_between_conditions() -> None:
    template = Trial("0000", 920, hand_speed=3.0, time_limit=5.0)
    hadr = attempts("hadr", objects=("0004", "0010"), holds=(921, 920), seed=4, template=template)
    assert [(t.object_id, t.hold_number) for t in hadr] == [
        ("0004", 921), ("0004", 920), ("0010", 921), ("0010", 920),
    ]  # fmt: skip
    shared = {(t.condition, t.seed, t.hand_speed, t.time_limit) for t in hadr}
    assert shared == {("hadr", 4, 3.0, 5.0)}
    raw = attempts("raw", objects=("0004", "0010"), holds=(921, 920), seed=4, template=template)
    assert [replace(t, condition="hadr") for t in raw] == hadr
    assert len(attempts("raw")) == 48


def test_a_finished_attempt_is_read_back(whole: Run, made: Counter[Trial], tmp_path: Path) -> None:
    trial = whole.trial
    name, folder = trial.name, tmp_path / "perfect"
    (row,) = run_attempts([trial], tmp_path)
    assert row["verdict"] == "success"
    assert row["trial"] == json.loads(json.dumps(record_of(trial)))
    files = [f"{name}-log.npz", f"{name}.json", f"{name}.npz"]
    assert sorted(p.name for p in folder.iterdir()) == files
    again, states, changes, scene = finished_attempt(tmp_path, trial)
    assert again == row
    assert tuple(changes) == whole.transitions
    assert scene.hold.hold_id == whole.scene.hold.hold_id
    np.testing.assert_array_equal(scene.base_from_wrist, whole.scene.base_from_wrist)
    assert len(states) == len(whole.states)
    np.testing.assert_allclose(states[-1].joints, whole.states[-1].joints, atol=1e-6)
    log = read_run_log(folder / files[0])
    assert tuple(replay(log).transitions) == whole.transitions
    with pytest.raises(FileNotFoundError, match=rf"{name}\.json is of another attempt"):
        finished_attempt(tmp_path, replace(trial, seed=7))
    with pytest.raises(FileNotFoundError, match=rf"there is no finished attempt .*{name}9\.json"):
        finished_attempt(tmp_path, replace(trial, hold_number=int(f"{trial.hold_number}9")))
    path = folder / files[1]
    path.write_text(path.read_text().replace('"verdict": "success"', '"verdict": "drop"'))
    with pytest.raises(FileNotFoundError, match=r"changed by hand; hadr handover makes it again"):
        finished_attempt(tmp_path, trial)


def test_files_that_are_gone_or_cut_are_made_again(made: Counter[Trial], tmp_path: Path) -> None:
    trial = Trial("0010", 922, "perfect")
    run_attempts([trial], tmp_path)
    folder = tmp_path / "perfect"
    times = 1
    for name in ("0010-922.npz", "0010-922-log.npz"):
        file = folder / name
        for content in (None, file.read_bytes()[:-1], b""):
            file.unlink() if content is None else file.write_bytes(content)
            assert not is_finished(tmp_path, trial)
            run_attempts([trial], tmp_path)
            times += 1
            assert made[trial] == times
            assert is_finished(tmp_path, trial)
        assert (folder / f"{name}.changed2").read_bytes() == b"", "what was there is kept"
    (folder / "0010-922-log.npz").unlink()
    assert not is_finished(tmp_path, trial)
    assert len(finished_attempt(tmp_path, trial)[1]) > 50  # for a film it is not needed


def test_what_cannot_be_read_is_named_with_what_to_do(made: Counter[Trial], tmp_path: Path) -> None:
    trial = Trial("0010", 922, "perfect")
    run_attempts([trial], tmp_path)
    path = tmp_path / "perfect" / "0010-922.json"
    states = path.with_suffix(".npz")
    whole, kept = states.read_bytes(), path.read_text()
    states.write_bytes(whole[:-10])
    with pytest.raises(ValueError, match=rf"{states} is cut off or was changed: hadr handover"):
        finished_attempt(tmp_path, trial)
    states.unlink()
    with pytest.raises(FileNotFoundError, match=rf"{states} is missing: hadr handover makes"):
        finished_attempt(tmp_path, trial)
    for text, says in ((kept[:200], " is not valid JSON"), ("[1]", ": must be named values")):
        path.write_text(text)
        with pytest.raises(ValueError, match=rf"{path}{says}.*hadr handover makes"):
            finished_attempt(tmp_path, trial)


def test_other_networks_are_other_attempts(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "checkpoints").mkdir()
    for file in CHECKPOINTS.values():
        (tmp_path / "checkpoints" / file).write_bytes(b"one")
    monkeypatch.setattr("hadr.simulation.camera.sight.samples_dir", lambda: tmp_path)

    def settings() -> dict[str, str]:
        return {name: digest(Trial("0010", 922, name).record) for name in CONDITIONS}

    def changed_by(change: Callable[[], object]) -> set[str]:
        before = settings()
        change()
        after = settings()
        return {name for name in before if before[name] != after[name]}

    assert settings() == settings()
    by_networks = {name for name in CONDITIONS if name.endswith("-networks")}
    of = {source: {n for n in CONDITIONS if depth_source(n) == source} for source in SOURCES}
    assert {len(names) for names in of.values()} == {8}
    for name, concerned in [
        *((name, of[name]) for name in ("unet-hand", "hadr", "hadr-plus")),
        ("segmentation", by_networks),
        ("keypoints", by_networks),
    ]:
        file = tmp_path / "checkpoints" / CHECKPOINTS[name]
        assert changed_by(lambda file=file: file.write_bytes(b"another")) == concerned


@pytest.fixture
def code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A copy of the library in which code may be changed: what it says is what attempts are."""
    litter = shutil.ignore_patterns("__pycache__")
    shutil.copytree(dependencies.LIBRARY, tmp_path / "library", ignore=litter)
    monkeypatch.setattr(dependencies, "LIBRARY", tmp_path / "library")
    _code.cache_clear()
    yield tmp_path / "library"
    _code.cache_clear()


@pytest.mark.parametrize(
    ("file", "old", "new", "counts"),
    [
        ("handover/grasping/selection.py", "MOST_CHECKED = 25", "MOST_CHECKED = 26", True),
        ("simulation/trials/trial.py", "advance_speed=0.12", "advance_speed=0.11", True),
        ("simulation/world/judge.py", "GOAL_RADIUS, HOLD_TIME", "HOLD_TIME, GOAL_RADIUS", True),
        ("simulation/camera/sight.py", "KEYPOINT_NOISE = 0.004", "KEYPOINT_NOISE = 0.0", True),
        ("models/hadr.py", "import torch\n", "import torch as pytorch\n", True),
        ("models/hadr_plus.py", "import torch\n", "import torch as pytorch\n", True),
        ("handover/grasping/selection.py", "Chooses a grasp", "Selects a grasp", False),
        ("rivals/tode.py", "import torch\n", "import torch as pytorch\n", False),
        ("training/loop.py", "import torch\n", "import torch as pytorch\n", False),
        ("simulation/film/film.py", "import textwrap\n", "import textwrap as wrapping\n", False),
    ],
)
def test_attempts_of_other_code_are_made_again(
    made: Counter[Trial], tmp_path: Path, code: Path, file: str, old: str, new: str, counts: bool
) -> None:
    trial = Trial("0010", 922, "perfect")
    (row,) = run_attempts([trial], tmp_path / "out")
    text = (code / file).read_text()
    assert text.count(old) == 1
    (code / file).write_text(text.replace(old, new))
    _code.cache_clear()
    assert is_finished(tmp_path / "out", trial) == (not counts)
    assert finished_attempt(tmp_path / "out", trial)[0] == row  # films and tables still read it
    run_attempts([trial], tmp_path / "out")
    assert made[trial] == 1 + counts
    assert is_finished(tmp_path / "out", trial)


def test_every_bundled_network_is_part_of_the_code() -> None:
    used = modules_behind(*CODE, without=("hadr.models.networks",))
    for file in CHECKPOINTS.values():
        network, _ = load_checkpoint(samples_dir() / "checkpoints" / file)
        assert type(network).__module__ in used


SLOW = """
import os, pickle, sys, time
from pathlib import Path
from hadr.simulation.trials import experiment
from hadr.simulation.trials.trial import Trial

out = Path(sys.argv[1])

def run_trial(trial):
    (out / f"begun-{trial.hold_number}").write_text(str(os.getpid()))
    if trial.hold_number == 900:
        return pickle.loads((out / "whole").read_bytes())
    time.sleep(3600)

experiment.run_trial = run_trial
if __name__ == "__main__":
    try:
        numbers = range(*map(int, sys.argv[2:]))
        experiment.run_attempts([Trial("0010", n, "perfect") for n in numbers], out, jobs=2)
    except KeyboardInterrupt:
        sys.exit(130)
"""


@contextmanager
def under_way(
    whole: Run, out: Path, first: int, last: int, *at_work: int
) -> Iterator[tuple[subprocess.Popen[str], list[int]]]:
    """A process with attempts of these numbers, and the ids of those at work; 900 is finished."""
    (out / "slow.py").write_text(SLOW)
    (out / "whole").write_bytes(pickle.dumps(replace(whole, scene=None)))
    process = subprocess.Popen(
        [sys.executable, str(out / "slow.py"), str(out), str(first), str(last)],
        stderr=subprocess.PIPE, text=True, start_new_session=True,
        # where the tests run in the background, SIGINT may be ignored, and that is inherited
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    begun = [out / f"begun-{number}" for number in at_work]
    try:
        assert happens(lambda: all(f.is_file() and f.read_text() for f in begun))
        yield process, [int(file.read_text()) for file in begun]
    finally:
        process.kill()
        process.wait()
        assert process.stderr is not None
        process.stderr.close()


PATIENCE = 600
"""Seconds: however busy the machine, and yet long before an attempt would end by itself."""


def happens(event: Callable[[], bool]) -> bool:
    end = time.monotonic() + PATIENCE
    while not event():
        if time.monotonic() > end:
            return False
        time.sleep(0.05)
    return True


def runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


on_linux = pytest.mark.skipif(sys.platform != "linux", reason="looks at processes in /proc")


@on_linux
def test_an_interrupt_ends_all_processes_and_keeps_what_is_finished(
    whole: Run, tmp_path: Path
) -> None:
    with under_way(whole, tmp_path, 900, 906, 901, 902) as (process, workers):
        assert all(map(runs, workers))
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the workers, too
        assert process.wait(PATIENCE) == 130
        assert happens(lambda: not any(map(runs, workers)))
        assert process.stderr is not None
        assert process.stderr.read() == ""
    # so many at a time, and no more were begun
    assert sorted(f.name for f in tmp_path.glob("begun-*")) == [
        f"begun-{n}" for n in range(900, 903)
    ]
    assert [is_finished(tmp_path, Trial("0010", n, "perfect")) for n in (900, 901)] == [True, False]


@on_linux
def test_a_process_ends_with_the_one_that_started_it(whole: Run, tmp_path: Path) -> None:
    with under_way(whole, tmp_path, 901, 902, 901) as (process, workers):
        assert all(map(runs, workers))
        process.kill()
        assert happens(lambda: not any(map(runs, workers)))


def test_what_is_no_longer_true_is_run_again(made: Counter[Trial], tmp_path: Path) -> None:
    trial = Trial("0010", 922, "perfect")
    path = tmp_path / "perfect" / "0010-922.json"
    (row,) = run_attempts([trial], tmp_path)
    # edited by hand
    path.write_text(path.read_text().replace('"largest_force": 0.0', '"largest_force": 0.5'))
    assert json.loads(path.read_text())["largest_force"] == 0.5
    assert run_attempts([trial], tmp_path) == [row]
    assert made[trial] == 2
    # cut off while it was written
    path.write_text(path.read_text()[:100])
    run_attempts([trial], tmp_path)
    assert made[trial] == 3
    # another description under the same name
    run_attempts([replace(trial, hand_speed=3.0)], tmp_path)
    run_attempts([trial], tmp_path)
    assert made == {trial: 4, replace(trial, hand_speed=3.0): 1}


def test_another_process_gives_what_this_one_gives(
    whole: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    finished, missing = trials = attempts(
        "perfect",
        objects=("0010",),
        holds=(923, 922),
        template=Trial("0010", 922, time_limit=0.2),
    )
    threads = torch.get_num_threads()
    (here,) = run_attempts([missing], tmp_path / "one")
    assert torch.get_num_threads() == threads
    with monkeypatch.context() as patch:
        patch.setattr(experiment, "run_trial", lambda trial: replace(whole, trial=trial))
        (before,) = run_attempts([finished], tmp_path / "two")
    told: list[Trial] = []
    rows = run_attempts(trials, tmp_path / "two", jobs=2, report=lambda t, _: told.append(t))
    assert told == trials  # what was finished is told first
    assert rows[0] == before
    for row in (here, rows[1]):
        for name in ("wall_seconds", "planning_wall_seconds", "sha256"):
            row.pop(name)
    assert rows[1] == here
    assert here["verdict"] == "time-out"
    first, second = (finished_attempt(tmp_path / n, missing)[1][-1] for n in ("one", "two"))
    np.testing.assert_array_equal(first.joints, second.joints)
    np.testing.assert_array_equal(first.base_from_object, second.base_from_object)


def test_the_last_caption_says_the_verdict(
    made: Counter[Trial], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trial = Trial("0010", 922, "perfect")
    (row,) = run_attempts([trial], tmp_path)
    assert ending_of(row) == f"success after {row['decided_at']:.1f} s"
    given: dict[str, Any] = {}

    def frames(*_: object, **words: Any) -> list[object]:
        given.update(words)
        return []

    monkeypatch.setattr(experiment, "film_frames", frames)
    monkeypatch.setattr(experiment, "write_film", lambda path, _: path)
    assert film_of_attempt(tmp_path, trial) == tmp_path / "perfect" / "0010-922.mp4"
    assert given["ending"] == ending_of(row)
