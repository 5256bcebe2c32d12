import hashlib
from pathlib import Path

import pytest

from hadr.data.samples import samples_dir
from hadr.experiments.averages import table_rows
from hadr.experiments.conditions import keypoints_given, masks_given, unknown_given
from hadr.experiments.plan import (
    handover_steps,
    make_handover_table,
    plan,
    planned_attempts,
    table_steps,
)
from hadr.experiments.runner import Bench, Run
from hadr.experiments.steps import Step
from hadr.experiments.systems import LONGER, METHODS, PARTS, SWITCHES
from hadr.records.provenance import plain
from hadr.records.result_file import digest, read_result_file, seal_row
from hadr.simulation.trials import experiment, summary
from hadr.simulation.trials.trial import Trial

RESULTS = Path(__file__).resolve().parents[2] / "results"


def test_a_plan_takes_whole_methods():
    assert [run.name for run in plan(["known/hadr"])] == ["known/hadr/seed-0"]
    assert [run.name for run in plan(["known/hadr"], seeds=(0, 2))] == [
        "known/hadr/seed-0",
        "known/hadr/seed-2",
    ]
    assert {run.experiment for run in plan(["hadr-plus"])} == {"known", "unknown", "by-frame"}
    assert [run.method for run in plan(["known"])] == [
        *METHODS,
        *(part for part in PARTS if part not in METHODS),
        *SWITCHES,
    ]
    assert [run.method for run in plan(["by-frame"])] == ["hand-median", "hadr", "hadr-plus"]
    assert [run.method for run in plan(["ablation"])] == ["hadr", *PARTS]
    assert {run.name for run in plan(["ledger"])} == {
        "known/hadr/seed-0",
        *(f"known/{switch}/seed-0" for switch in SWITCHES),
        "by-frame/hadr/seed-0",
        "by-frame/hand-median/seed-0",
    }
    assert [run.seed for run in plan(["unknown/no-hand"])] == [0, 1, 2]
    assert [run.seed for run in plan(["unknown/no-hand"], size="tiny")] == [0]
    assert [run.seed for run in plan(["known/no-hand"])] == [0]
    assert len(plan(size="tiny")) == len({run.name for run in plan()}) - 4
    assert plan(["known/raw"], seeds=(1, 2)) == [Run("known", "raw", 0)]
    assert [run.name for run in plan(["hadr-long"])] == ["known/hadr-long/seed-0"]
    long = {run.name for run in plan(size="imagenet") if run.method.endswith("-long")}
    assert long == {f"{e}/{m}/seed-0" for e in ("known", "unknown") for m in LONGER}


def test_a_row_of_the_ablation_is_the_run_behind_it():
    assert [run.name for run in plan(["ablation/full"])] == ["known/hadr/seed-0"]
    assert [run.name for run in plan(["full"])] == ["known/hadr/seed-0"]
    assert [run.name for run in plan(["ablation/no-hand"])] == ["known/no-hand/seed-0"]
    assert plan(["Ablation"]) == plan(["ablation"])


def test_a_wish_that_fits_nothing_is_told():
    with pytest.raises(ValueError, match="no run fits 'known/lidf2'"):
        plan(["known/lidf2"])


@pytest.mark.parametrize("size", ["tiny", "mini", "imagenet", "paper"])
def test_every_system_has_every_preset_and_a_step(size, tmp_path):
    bench = Bench([samples_dir() / "frames"], tmp_path, size)
    runs = plan(size=size)
    steps = table_steps(bench, runs, {"known/hadr/seed-0": 5.0, "given all true": 3.0})
    given = [f"given {n}" for n in {**masks_given(bench), **keypoints_given(bench)}]
    assert not unknown_given(bench)  # the bundled finders have seen all objects
    if size == "imagenet":  # without a sensor; with its own finders, once there are both
        assert not any("sensor" in n for n in given)
        for kind in ("segmentation", "hand-keypoints"):
            assert "-imagenet.safetensors" in masks_given(bench)["predicted mask"].masks
            (tmp_path / "nets" / kind).mkdir(parents=True)
            (tmp_path / "nets" / kind / "last.safetensors").touch()
        assert str(tmp_path) in masks_given(bench)["predicted mask"].masks
    assert [step.name for step in steps[: len(plan(size=size))]] == [
        run.name for run in plan(size=size)
    ]
    assert [s.name for s in steps[len(runs) :]] == given
    assert not any(step.is_done for step in steps)
    timed = {step.name: step.seconds for step in steps if step.seconds is not None}
    assert timed == {"known/hadr/seed-0": 5.0} | {name: 3.0 for name in given[:1]}


def test_unknown_objects_are_scored_with_finders_that_never_saw_them(tmp_path):
    bench = Bench([samples_dir() / "frames"], tmp_path, "imagenet")
    homes = [tmp_path / "nets" / "unknown" / kind for kind in ("segmentation", "hand-keypoints")]
    for home in homes:
        assert not unknown_given(bench)
        home.mkdir(parents=True)
        (home / "last.safetensors").touch()
    found = unknown_given(bench)["predicted mask and keypoints"]
    assert [Path(found.masks).parent, Path(found.keypoints).parent] == homes
    assert "checkpoints" in masks_given(bench)["predicted mask"].masks  # of known ones still these
    runs = plan(["unknown/hadr", "unknown/raw", "known/no-hand"], seeds=[1], size="imagenet")
    left = {step.name: step.left for step in table_steps(bench, runs, {}) if "given" in step.name}
    unknown = {f"given {name}, unknown": "1 score" for name in unknown_given(bench)}
    known = {f"given {name}": "1 score" for name in ("all true", "predicted mask and keypoints")}
    assert left == known | unknown


def test_seeds_are_averaged():
    def row(seed, rmse, restored=True):
        return {
            "method": "hadr",
            "split": "known",
            "seed": seed,
            "rmse_m": rmse,
            "delta_105": 50.0,
            "frames": 4,
            "pooled": {"rmse_m": 2 * rmse},
            "restored": {"rmse_m": 3 * rmse if restored else None},
            "per_frame": {"stems": ["0001/a", "0002/b"], "rmse_m": [rmse, 3 * rmse]},
            "configuration": {},
            "config_sha256": str(seed),
            "provenance": {"commit": "a", "machine": "m"},
        }

    (found,) = table_rows([row(0, 0.01), row(1, 0.02), row(2, 0.03)])
    assert found["rmse_m"] == pytest.approx(0.02)
    assert found["seed_sd"]["rmse_m"] == pytest.approx(0.01)
    assert found["seed_sd"]["delta_105"] == 0
    assert found["by_seed"]["rmse_m"] == [0.01, 0.02, 0.03]
    assert found["pooled"]["rmse_m"] == pytest.approx(0.04)
    assert found["restored"]["rmse_m"] == pytest.approx(0.06)
    assert found["by_object"] == pytest.approx({"0001": 0.02, "0002": 0.06})
    assert (found["frames"], found["seeds"]) == (4, [0, 1, 2])
    assert table_rows([row(0, 0.01)])[0]["seed_sd"]["rmse_m"] is None
    part = table_rows([row(0, 0.01), row(1, 0.02, restored=False)])[0]
    assert part["restored"]["rmse_m"] is None


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
        summary, "condition_row",
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
