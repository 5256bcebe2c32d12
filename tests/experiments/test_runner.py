"""Runs of the tables: from data folder to row and table, kept, measured again where it must be."""

from __future__ import annotations

import csv
import itertools
import json
import shutil
import statistics
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from hadr.data.samples import samples_dir
from hadr.experiments import runner
from hadr.experiments.averages import paired, standard_error
from hadr.experiments.runner import Bench, Run
from hadr.experiments.scoring import EVALUATION_SIZE, cheap_depth, hand_offset, score_depth
from hadr.experiments.systems import CHEAP, recipe_of
from hadr.experiments.tables import write_tables
from hadr.models.networks import NETWORKS
from hadr.records import dependencies, provenance
from hadr.records.result_file import read_result_file
from hadr.training.recipe import Preset


def small(method: str, size: str) -> Preset | None:
    """The recipe of preset tiny, for one epoch."""
    found = recipe_of(method, size)
    return found and replace(found, epochs=1, drop_epoch=1, true_voxel_epochs=1)


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Bench:
    monkeypatch.setattr(runner, "recipe_of", small)
    return Bench([samples_dir() / "frames"], tmp_path / "runs", "tiny", limit=4)


def test_the_table_has_every_finished_run(bench: Bench, tmp_path: Path) -> None:
    runs = [Run("known", method) for method in (*CHEAP, "unet-hand")]
    rows = {run: bench.measure(run) for run in runs}
    write_tables(bench, tmp_path)
    table = read_result_file(tmp_path / "known.json")
    assert [row["method"] for row in table.rows] == [run.method for run in runs]
    raw, learned = table.row(method="raw"), table.row(method="unet-hand")
    assert raw["coverage"] == 0  # depth is erased in the mask, and raw restores nothing
    assert raw["restored"]["rmse_m"] is None
    assert raw["rmse_m"] > 0.3  # each pixel counts as depth 0
    assert learned["coverage"] > 0.99
    assert learned["training_frames"] == 4
    assert learned["frames"] == 4
    assert raw["curve"] is None
    (row,) = csv.DictReader((bench.out / runs[-1].name / "history.csv").open())
    assert learned["curve"]["validation_rmse_m"] == [float(row["validation_rmse_m"])]
    per_frame = rows[runs[-1]]["per_frame"]["rmse_m"]
    stems = rows[runs[-1]]["per_frame"]["stems"]
    first = stems[0].split("/")[0]
    own = [error for stem, error in zip(stems, per_frame, strict=True) if stem[:4] == first]
    assert learned["by_object"][first] == pytest.approx(sum(own) / len(own))
    assert learned["rmse_m"] == pytest.approx(sum(per_frame) / 4)


def test_the_hands_offset_is_learned_from_training_frames_and_lies_behind(bench: Bench) -> None:
    run = Run("known", "hand-offset")
    learned, test = (bench.frames(run, part, EVALUATION_SIZE) for part in ("train", "test"))
    depth = cheap_depth(test, "hand-median") + hand_offset(learned)
    assert bench.measure(run)["rmse_m"] == score_depth(depth, test).columns()["rmse_m"]


def test_a_row_of_other_data_is_measured_again(bench: Bench) -> None:
    run = Run("known", "nearest")
    row = bench.measure(run)
    assert bench.finished(run) == row
    other = Bench(bench.roots, bench.out, "tiny", limit=2)
    assert other.finished(run) is None
    assert other.measure(run)["frames"] == 2
    assert bench.finished(run) is None


@pytest.fixture
def code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A copy of the library in which code may be changed: what it says is what rows depend on."""
    litter = shutil.ignore_patterns("__pycache__")
    shutil.copytree(dependencies.LIBRARY, tmp_path / "library", ignore=litter)
    monkeypatch.setattr(dependencies, "LIBRARY", tmp_path / "library")
    runner.code_of.cache_clear()
    yield tmp_path / "library"
    runner.code_of.cache_clear()


def append(path: Path, line: str = "VALUE = 1") -> None:
    """Change code, as if the process had begun with it."""
    path.write_text(f"{path.read_text()}{line}\n")
    runner.code_of.cache_clear()


def longer(method: str, size: str) -> Preset:
    return replace(small(method, size), epochs=2)


def test_a_row_of_other_code_is_measured_again(bench: Bench, code: Path) -> None:
    run, other = Run("known", "nearest"), Run("known", "tode")
    row, before = bench.measure(run), bench.configuration(other)
    append(code / "handover" / "workflow.py")
    append(code / "training" / "presets.py")  # recipes count as values
    append(code / "experiments" / "scoring.py", "# a comment")
    assert (bench.finished(run), bench.configuration(other)) == (row, before)
    append(code / "rivals" / "tode.py")
    assert bench.finished(run) == row
    assert bench.configuration(other) != before
    append(code / "metrics.py")
    assert bench.finished(run) is None
    again = bench.measure(run)
    assert again["rmse_m"] == row["rmse_m"]
    assert bench.finished(run) == again


def test_which_frames_and_which_slow_parts_a_run_has_count(
    bench: Bench, code: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, recipe = Run("known", "tode"), small("tode", "tiny")

    def key() -> tuple[str, str]:
        return bench.configuration(run)["code"], bench.data_of(run, recipe)["code"]

    keys = [key()]
    append(code / "experiments" / "protocol.py")
    keys.append(key())
    monkeypatch.setitem(NETWORKS, "tode", replace(NETWORKS["tode"], encoders=()))
    runner.code_of.cache_clear()
    keys.append(key())
    assert [len(set(codes)) for codes in zip(*keys, strict=True)] == [3, 3]


def test_code_that_scores_keeps_a_training_and_code_that_trains_sets_it_aside(
    bench: Bench, code: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Run("known", "unet-hand")
    row, last = bench.measure(run), bench.out / run.name / "last.safetensors"
    weights = last.read_bytes()
    append(code / "experiments" / "scoring.py")
    assert (bench.finished(run), bench.epochs_done(run)) == (None, 1)
    assert bench.measure(run)["rmse_m"] == row["rmse_m"]
    assert last.read_bytes() == weights
    append(code / "training" / "tasks" / "images.py")
    assert (bench.finished(run), bench.epochs_done(run)) == (None, 0)
    bench.measure(run)
    assert (bench.finished(run) or {})["epochs"] == 1
    aside = bench.out / "known" / "unet-hand" / "seed-0.old-1"
    assert (aside / "last.safetensors").read_bytes() == weights
    write_tables(bench, bench.out.parent)
    assert len(read_result_file(bench.out.parent / "known.json").rows) == 1  # without that one
    monkeypatch.setattr(runner, "recipe_of", longer)
    assert (bench.finished(run), bench.epochs_done(run)) == (None, 0)


def test_a_whole_training_of_other_code_counts_where_that_is_asked_for(
    bench: Bench, code: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Run("known", "unet-hand")
    row, last = bench.measure(run), bench.out / run.name / "last.safetensors"
    weights = last.read_bytes()
    append(code / "training" / "tasks" / "images.py")
    keeping = Bench(bench.roots, bench.out, "tiny", limit=4, keep_trained=True)
    assert (bench.epochs_done(run), keeping.epochs_done(run)) == (0, 1)
    assert keeping.finished(run) is None  # it is scored by the code of now
    again = keeping.measure(run)
    assert last.read_bytes() == weights
    assert (again["rmse_m"], again["training_s"]) == (row["rmse_m"], row["training_s"])
    assert again["provenance"]["trained_at"] == row["provenance"]["trained_at"]
    assert bench.finished(run) == again
    # not one of another recipe, and not one that was stopped
    append(code / "training" / "tasks" / "images.py", "VALUE = 2")
    monkeypatch.setattr(runner, "recipe_of", longer)
    assert (keeping.epochs_done(run), keeping.measure(run)["epochs"]) == (0, 2)
    assert keeping.epochs_done(run) == 2
    aside = bench.out / "known" / "unet-hand" / "seed-0.old-1"
    assert (aside / "last.safetensors").read_bytes() == weights


def test_commit_is_that_of_the_beginning_and_threads_are_the_trainings(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, commits = Run("known", "unet-hand"), itertools.count()
    monkeypatch.setattr(provenance, "_commit", lambda: {"commit": next(commits)})
    row = bench.measure(run)
    assert (row["provenance"]["commit"], row["provenance"]["trained_at"]) == (0, 1)
    (bench.out / run.name / "row.json").unlink()
    monkeypatch.setattr(torch, "get_num_threads", lambda: 99)
    assert bench.measure(run)["threads"] == row["threads"] != 99


def test_two_methods_frame_by_frame() -> None:
    own = {"stems": ["a", "b"], "rmse_m": [0.01, 0.05]}
    other = {"stems": ["a", "b"], "rmse_m": [0.04, 0.04]}
    found = paired(own, other)
    assert found["mean_difference_m"] == pytest.approx(-0.01)  # -0.03 and +0.01
    assert found["standard_error_m"] == pytest.approx(0.02)
    assert (found["better_on_frames"], found["frames"]) == (1, 2)
    with pytest.raises(ValueError, match="only the same frames can be compared, got 2 and 2"):
        paired(own, {"stems": ["b", "a"], "rmse_m": [0.04, 0.04]})


def test_frames_of_two_folders_with_one_name_are_compared_each_with_its_own() -> None:
    own = {"stems": ["a", "a"], "rmse_m": [0.01, 0.05]}
    other = {"stems": ["a", "a"], "rmse_m": [0.02, 0.01]}
    assert paired(own, other)["mean_difference_m"] == pytest.approx(0.015)


def test_frames_that_are_alike_do_not_make_a_mean_surer() -> None:
    values = [1.0, 3.0, 2.0, 6.0]
    alone = standard_error(values, range(4))
    assert alone == pytest.approx(statistics.stdev(values) / 2)
    twice = [value for value in values for _ in range(2)]
    assert standard_error(twice, [n // 2 for n in range(8)]) == pytest.approx(alone)
    assert standard_error(twice, range(8)) < 0.7 * alone
    assert standard_error([1.0, 2.0], ["one", "one"]) is None
    assert standard_error([], []) is None


def test_a_row_that_was_edited_by_hand_is_measured_again(bench: Bench) -> None:
    run = Run("known", "raw")
    row = bench.measure(run)
    path = bench.out / run.name / "row.json"
    edited = json.loads(path.read_text()) | {"rmse_m": 0.001}
    path.write_text(json.dumps(edited))
    assert bench.finished(run) is None
    assert bench.measure(run)["rmse_m"] == row["rmse_m"]
