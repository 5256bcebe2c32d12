"""The handover experiment as a part of `hadr reproduce`."""

from __future__ import annotations

from pathlib import Path

import pytest

from hadr.experiments import handover_table
from hadr.experiments.handover_table import handover_steps, open_handover
from hadr.experiments.run_times import RunTimes
from hadr.records.provenance import plain
from hadr.records.result_file import digest, read_result_file, seal_row
from hadr.simulation.trials import experiment
from hadr.simulation.trials.trial import Trial
from hadr.simulation.trials.trial_set import TRIAL_HOLDS, TRIAL_OBJECTS

RESULTS = Path(__file__).resolve().parents[2] / "results"
TIMES = RunTimes({}, {}, {}, {"hadr": 10.0}, {})


def finish(out: Path, trial: Trial, **changed: float) -> None:
    """Leave the file of an attempt as `hadr.simulation.trials.experiment` does."""
    path = out / trial.arm / f"{trial.name}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    row = {"trial": plain(trial.record), "config_sha256": digest({**trial.record, **changed})}
    seal_row(path, row)
    for name in (f"{trial.name}.npz", f"{trial.name}-log.npz"):
        (path.parent / name).touch()


def test_tiny_makes_one_attempt_an_arm_and_the_others_48(tmp_path: Path) -> None:
    one = open_handover(tmp_path, "tiny", 0, 1)
    assert (len(one.objects), len(one.holds)) == (1, 1)
    table = read_result_file(RESULTS / "mini" / "handover.json")
    assert sorted(one.arms) == sorted(row["arm"] for row in table.rows)
    for size in ("mini", "paper"):
        args = open_handover(tmp_path, size, 3, 2)
        assert args.objects == list(TRIAL_OBJECTS)
        assert args.holds == list(TRIAL_HOLDS)
        assert (args.seed, args.jobs) == (3, 2)
        assert args.json == tmp_path / "tables" / "handover.json"
    assert list(tmp_path.iterdir()) == []


def test_finished_attempts_are_not_in_the_plan(tmp_path: Path) -> None:
    args = open_handover(tmp_path, "mini", 0, 1)
    whole = {step.name: step for step in handover_steps(args, TIMES)}
    assert whole["handover/hadr"].left == "48 of 48 attempts"
    assert whole["handover/hadr"].seconds == 480.0
    assert whole["handover/raw"].seconds is None
    finish(args.out, Trial("0004", 902, "hadr"))
    finish(args.out, Trial("0004", 903, "hadr"), hand_speed=2.0)  # another attempt than asked for
    left = {step.name: step for step in handover_steps(args, TIMES)}
    assert (left["handover/hadr"].left, left["handover/hadr"].seconds) == ("47 of 48 attempts", 470)
    tiny = open_handover(tmp_path, "tiny", 0, 1)
    done = {step.name: step for step in handover_steps(tiny, TIMES)}
    assert done["handover/hadr"].is_done
    assert not done["handover/raw"].is_done


def test_a_missing_package_is_told_before_anything_is_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing() -> None:
        raise ValueError("attempts need mujoco, not installed here")

    monkeypatch.setattr(handover_table, "check_packages", missing)
    with pytest.raises(ValueError, match=r"need mujoco.*leave them out: --only tables chapters"):
        open_handover(tmp_path, "tiny", 0, 1)


def test_an_attempt_counts_as_finished_by_its_settings(tmp_path: Path) -> None:
    trial = Trial("0004", 902, "raw")
    assert not experiment.is_finished(tmp_path, trial)
    finish(tmp_path, trial)
    assert experiment.is_finished(tmp_path, trial)
    assert not experiment.is_finished(tmp_path, Trial("0004", 902, "raw", seed=1))
