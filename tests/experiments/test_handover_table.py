"""The handover experiment as a part of `hadr reproduce`."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from hadr.experiments.handover_table import handover_steps, make_handover_table, planned_attempts
from hadr.experiments.steps import Step
from hadr.records.provenance import plain
from hadr.records.result_file import digest, read_result_file, seal_row
from hadr.simulation.trials import experiment
from hadr.simulation.trials.trial import Trial

RESULTS = Path(__file__).resolve().parents[2] / "results"


def finish(out: Path, trial: Trial, **changed: float) -> None:
    """Leave the file of an attempt as `hadr.simulation.trials.experiment` does."""
    path = out / trial.condition / f"{trial.name}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    empty = hashlib.sha256().hexdigest()
    row = {
        "trial": plain(trial.record),
        "config_sha256": digest({**trial.record, **changed}),
        "states_sha256": empty,
        "log_sha256": empty,
    }
    seal_row(path, row)
    for name in (f"{trial.name}.npz", f"{trial.name}-log.npz"):
        (path.parent / name).touch()


def test_tiny_makes_one_attempt_a_condition_and_the_others_48() -> None:
    table = read_result_file(RESULTS / "mini" / "handover.json")
    for size, count in (("tiny", 1), ("mini", 48), ("paper", 48)):
        plan = planned_attempts(size, 3)
        assert sorted(plan) == sorted(row["condition"] for row in table.rows)
        assert {len(trials) for trials in plan.values()} == {count}
        assert {trial.seed for trials in plan.values() for trial in trials} == {3}


def test_finished_attempts_are_not_in_the_plan(tmp_path: Path) -> None:
    def steps(size: str) -> dict[str, Step]:
        times = {"handover/hadr": 480.0}
        found = handover_steps(planned_attempts(size, 0), tmp_path, times)
        return {step.name: step for step in found}

    whole = steps("mini")
    assert (whole["handover/hadr"].left, whole["handover/hadr"].seconds) == (
        "48 attempts", 480.0,
    )  # fmt: skip
    assert whole["handover/raw"].seconds is None
    out = tmp_path / "handover"
    finish(out, Trial("0004", 902, "hadr"))
    finish(out, Trial("0004", 903, "hadr"), hand_speed=2.0)  # another attempt than asked for
    assert steps("mini")["handover/hadr"].left == "47 of 48 attempts"
    assert steps("tiny")["handover/hadr"].is_done
    assert not steps("tiny")["handover/raw"].is_done


def test_the_table_has_a_row_a_condition(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def attempted(trials: list[Trial], out: Path, **_: object) -> list[str]:
        assert out == tmp_path / "handover"
        return [trial.name for trial in trials]

    monkeypatch.setattr(experiment, "run_attempts", attempted)
    monkeypatch.setattr(
        experiment, "condition_row",
        lambda condition, names: {"condition": condition, "successes": 1, "attempts": len(names),
                            "mean_wall_seconds": 4.0},
    )  # fmt: skip
    plan = planned_attempts("tiny", 0)
    make_handover_table(plan, tmp_path, jobs=1)
    rows = read_result_file(tmp_path / "tables" / "handover.json").rows
    assert [row["condition"] for row in rows] == list(plan)
    for trials in plan.values():
        finish(tmp_path / "handover", trials[0])
    assert {step.seconds for step in handover_steps(plan, tmp_path, {})} == {4.0}


def test_an_attempt_counts_as_finished_by_its_settings(tmp_path: Path) -> None:
    trial = Trial("0004", 902, "raw")
    assert not experiment.is_finished(tmp_path, trial)
    finish(tmp_path, trial)
    assert experiment.is_finished(tmp_path, trial)
    assert not experiment.is_finished(tmp_path, Trial("0004", 902, "raw", seed=1))
