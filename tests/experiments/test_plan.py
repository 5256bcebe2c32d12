from dataclasses import replace

import pytest

from hadr.data.samples import samples_dir
from hadr.experiments import runner
from hadr.experiments.averages import table_rows
from hadr.experiments.conditions import KEYPOINTS, MASKS
from hadr.experiments.plan import plan, table_steps
from hadr.experiments.runner import Bench, Run
from hadr.experiments.systems import LONG_RUN, METHODS, PARTS, SWITCHES, System, system
from hadr.models.hadr import HADRConfig
from hadr.training.losses import CODED


def test_a_plan_takes_whole_methods():
    assert [run.name for run in plan(["known/hadr"])] == ["known/hadr/seed-0"]
    assert [run.name for run in plan(["known/hadr"], seeds=(0, 2))] == [
        "known/hadr/seed-0",
        "known/hadr/seed-2",
    ]
    assert {run.experiment for run in plan(["hadr-plus"])} == {"known", "unknown"}
    assert [run.method for run in plan(["known"])] == [
        *METHODS,
        *(part for part in PARTS if part not in METHODS),
        *SWITCHES,
    ]
    assert [run.method for run in plan(["by-frame"])] == ["hand-median", "hadr"]
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


def test_a_row_of_the_ablation_is_the_run_behind_it():
    assert [run.name for run in plan(["ablation/full"])] == ["known/hadr/seed-0"]
    assert [run.name for run in plan(["full"])] == ["known/hadr/seed-0"]
    assert [run.name for run in plan(["ablation/no-hand"])] == ["known/no-hand/seed-0"]
    assert plan(["Ablation"]) == plan(["ablation"])


def test_a_wish_that_fits_nothing_is_told():
    with pytest.raises(ValueError, match="no run fits 'known/lidf2'"):
        plan(["known/lidf2"])


@pytest.mark.parametrize("size", ["tiny", "mini", "paper"])
def test_every_system_has_every_preset_and_a_step(size, tmp_path):
    bench = Bench([samples_dir() / "frames"], tmp_path, size)
    steps = table_steps(bench, plan(), {"known/hadr/seed-0": 5.0, "given all true": 3.0})
    assert [step.name for step in steps[: len(plan())]] == [run.name for run in plan()]
    assert [s.name for s in steps[len(plan()) :]] == [f"given {n}" for n in {**MASKS, **KEYPOINTS}]
    assert not any(step.is_done for step in steps)
    timed = {step.name: step.seconds for step in steps if step.seconds is not None}
    assert timed == {"known/hadr/seed-0": 5.0, "given all true": 3.0}


def test_systems_differ_from_hadr_in_one_thing():
    base = system("hadr", "mini").recipe
    long, handless = system("hadr-long", "mini").recipe, system("no-hand", "mini").recipe
    assert (long.epochs, long.drop_epoch) == (LONG_RUN * base.epochs, LONG_RUN * base.drop_epoch)
    assert replace(long, epochs=base.epochs, drop_epoch=base.drop_epoch) == base
    assert handless.model.hand == "none"
    assert replace(handless, model=replace(handless.model, hand="3d")) == base
    assert system("raw", "mini").recipe is None
    for name, fields in {
        "no-aggregation": {"aggregation": True},
        "no-point-fusion": {"point_fusion": True},
        "hand-2d": {"hand": "3d"},
        "wrist-translation": {"wrist_rotation": True},
        "clamped-probability": {"clamp_probability": False},
    }.items():
        changed = system(name, "mini").recipe
        assert changed != base
        assert replace(changed, model=replace(changed.model, **fields)) == base
    coded = system("coded-weights", "mini").recipe
    assert coded.weights == CODED
    assert replace(coded, weights=base.weights) == base
    with pytest.raises(ValueError, match=r"method must be one of .* got 'gan'"):
        system("gan", "mini")


@pytest.fixture
def bench(tmp_path, monkeypatch):
    """A bench whose HADR has one epoch on six frames."""
    recipe = replace(system("hadr", "tiny").recipe, epochs=1, drop_epoch=1)
    assert isinstance(recipe.model, HADRConfig)
    monkeypatch.setattr(
        runner, "system", lambda m, size: System(m, recipe) if m == "hadr" else system(m, size)
    )
    return Bench([samples_dir() / "frames"], tmp_path / "runs", "tiny", limit=6)


def test_another_recipe_is_another_row(bench, tmp_path, monkeypatch):
    run = Run("known", "hand-median")
    row = bench.measure(run)
    assert bench.finished(run) == row
    (step,) = table_steps(bench, [run], {run.name: 99.0})[:1]
    assert (step.left, step.seconds) == ("done", row["evaluation_s"])
    monkeypatch.setattr(bench, "corruption", "analytic")
    assert bench.finished(run) is None


def test_a_damaged_row_is_measured_again(bench):
    run = Run("known", "raw")
    row = bench.measure(run)
    path = bench.out / run.name / runner.ROW
    path.write_text(path.read_text()[:100])
    assert bench.finished(run) is None
    assert bench.measure(run)["rmse_m"] == row["rmse_m"]


def test_seeds_are_averaged():
    def row(seed, rmse):
        return {
            "method": "hadr",
            "split": "known",
            "seed": seed,
            "rmse_m": rmse,
            "delta_105": 50.0,
            "frames": 4,
            "pooled": {"rmse_m": 2 * rmse},
            "restored": {"rmse_m": 3 * rmse},
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
