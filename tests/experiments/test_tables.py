"""The result files: which rows they have, under which conditions, and that a row can be rerun."""

from __future__ import annotations

import multiprocessing
import statistics
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from hadr.data.samples import samples_dir
from hadr.experiments import runner
from hadr.experiments.again import measure_again
from hadr.experiments.conditions import (
    BOTH,
    TRUE,
    condition_frames,
    condition_of,
    condition_rows,
    conditions_of,
    finished_condition,
    keypoints_given,
    masks_given,
    measure_condition,
)
from hadr.experiments.plan import measure_all, plan, table_steps
from hadr.experiments.runner import Bench, Run
from hadr.experiments.systems import recipe_of
from hadr.experiments.tables import FILES, against_next, write_tables
from hadr.press.paper_report import report
from hadr.press.report import DEFAULT, ledger_table, tuning_table
from hadr.records.result_file import read_result_file, seal_row, write_result_file
from hadr.training.frames.batches import load_frames
from hadr.training.recipe import Given, Preset

BENCH = Bench([], Path("out"), "tiny")
KEYPOINTS, MASKS = keypoints_given(BENCH), masks_given(BENCH)
PUBLISHED = Path(__file__).resolve().parents[2] / "results" / "paper_tables.json"


def small(method: str, size: str) -> Preset | None:
    """The recipe of preset tiny, for one epoch."""
    found = recipe_of(method, size)
    return found and replace(found, epochs=1, drop_epoch=1, true_voxel_epochs=1)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Bench, Path]:
    """A bench with some runs of one epoch, and the folder of its tables."""
    patch = pytest.MonkeyPatch()
    patch.setattr(runner, "recipe_of", small)
    home = tmp_path_factory.mktemp("tables")
    bench = Bench([samples_dir() / "frames"], home / "runs", "tiny", limit=4)
    wishes = ["known/hand-median", "known/hadr", "known/no-hand", "known/hand-2d"]
    wishes += ["known/coded-weights", "by-frame/hadr"]
    measure_all(bench, plan(wishes, size="tiny"), home / "tables")
    yield bench, home / "tables"
    patch.undo()


def test_each_file_has_its_rows(made: tuple[Bench, Path]) -> None:
    _, folder = made
    strange = ("unknown", "unknown_predicted")
    assert not any((folder / f"{name}.json").exists() for name in strange)
    found = {n: read_result_file(folder / f"{n}.json") for n in FILES if n not in strange}
    assert [r["method"] for r in found["known"].rows] == ["hand-median", "hadr", "no-hand"]
    assert [r["method"] for r in found["ablation"].rows] == ["no-hand", "hand-2d", "full"]
    assert [r["method"] for r in found["ledger"].rows] == [
        DEFAULT,
        "coded-weights",
        "split by frame",
    ]
    full, own = found["ablation"].row(method="full"), found["known"].row(method="hadr")
    assert {**full, "method": "hadr"} == {**own, "against_full": None}
    part = found["ablation"].row(method="no-hand")
    gap = part["against_full"]["mean_difference_m"]
    assert gap == pytest.approx(part["rmse_m"] - full["rmse_m"])
    assert own["configuration"]["recipe"]["epochs"] == 1
    assert set(own["provenance"]) == {
        "commit", "trained_at", "uncommitted_changes", "versions", "machine", "data_sha256",
    }  # fmt: skip
    keypoints = found["keypoints"]
    assert {(r["method"], r["given"]) for r in keypoints.rows} == {
        (method, name) for method in ("hand-median", "hadr") for name in KEYPOINTS
    }
    for row in keypoints.rows:  # nothing is predicted: the numbers of the table of known objects
        if row["given"] == TRUE:
            known = found["known"].row(method=row["method"])
            assert row["rmse_m"] == pytest.approx(known["rmse_m"], rel=1e-6)
            assert "against_true" not in row
        else:
            assert row["keypoints_m"] > 0
            assert row["against_true"]["frames"] == row["frames"]
    median = keypoints.row(method="hand-median", given=TRUE)["against_hadr"]
    both = [found["known"].row(method=m)["rmse_m"] for m in ("hand-median", "hadr")]
    assert median["mean_difference_m"] == pytest.approx(both[0] - both[1], abs=1e-6)
    assert abs(median["median_difference_m"]) < 1
    assert "against_hadr" not in keypoints.row(method="hadr", given=TRUE)
    masks = found["segmentation"]
    assert {r["given"] for r in masks.rows} == set(MASKS)
    assert masks.row(method="hadr", given=TRUE)["mask_iou"] == 1
    assert 0 < masks.row(method="hadr", given="predicted mask")["mask_iou"] < 1
    parts = found["ablation_predicted"]
    assert [(r["method"], r["given"]) for r in parts.rows] == [
        (method, name) for method in ("no-hand", "hand-2d", "hadr") for name in (TRUE, BOTH)
    ]
    assert parts.row(method="hadr", given=BOTH) == masks.row(method="hadr", given=BOTH)
    sensor = masks.row(method="hadr", given="simulated sensor")
    assert (sensor["corruption"], sensor["masks"]) == ("sensor", "true")


def test_what_is_finished_is_not_made_again(
    made: tuple[Bench, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    bench, folder = made
    runs = plan(["known/hand-median", "known/hadr"], size="tiny")
    times = {p: p.stat().st_mtime_ns for p in bench.out.rglob("*") if p.is_file()}
    before = read_result_file(folder / "known.json")
    measure_all(bench, runs, folder)
    assert {p: p.stat().st_mtime_ns for p in bench.out.rglob("*") if p.is_file()} == times
    assert capsys.readouterr().out.count("was there") == 2
    found = read_result_file(folder / "known.json")
    assert found.rows == before.rows
    assert found.provenance["data"]["sha256"] == bench.data["sha256"]
    row = found.row(method="hadr")
    assert (row["frames"], row["epochs"], row["seeds"]) == (4, 1, [0])
    assert row["parameters"] > 10_000
    assert row["rmse_m"] > 0
    steps = {step.name: step for step in table_steps(bench, runs, {})}
    assert steps["known/hadr/seed-0"].is_done
    assert steps["known/hadr/seed-0"].seconds == row["training_s"] + row["evaluation_s"]
    assert (bench.out.parent / steps["known/hadr/seed-0"].makes).is_file()
    assert steps["given predicted mask"].is_done
    assert len(list(bench.out.parent.glob(steps["given predicted mask"].makes))) == 4


def test_neighbours_of_the_papers_five_are_compared_frame_by_frame() -> None:
    def run(method: str, *errors: float) -> dict[str, Any]:
        per_frame = {"stems": ["a/0", "a/1", "a/2"], "rmse_m": list(errors)}
        return {"method": method, "split": "known", "per_frame": per_frame}

    rows = [run("lidf", 0.04, 0.05, 0.06), run("hadr", 0.02, 0.02, 0.02),
            run("tode", 0.03, 0.03, 0.03), run("hadr-plus", 0.01, 0.01, 0.01)]  # fmt: skip
    averaged = {
        ("known", row["method"]): {"rmse_m": statistics.fmean(row["per_frame"]["rmse_m"])}
        for row in rows
    }
    found = against_next(rows, averaged, "known", ["one", "one", "two"])
    assert {name: pair["method"] for name, pair in found.items()} == {
        "tode": "hadr",
        "lidf": "tode",
    }
    gap = found["lidf"]
    assert gap["mean_difference_m"] == pytest.approx(0.02)
    # deviations -0.01, 0 and +0.01, the first two of one hold
    assert gap["standard_error_m"] == pytest.approx((2 * (0.01**2 + 0.01**2)) ** 0.5 / 3)
    assert against_next(rows, averaged, "unknown") == {}


def test_frames_dealt_out_are_as_many_and_have_sisters(made: tuple[Bench, Path]) -> None:
    bench, _ = made
    whole = Bench(bench.roots, bench.out, "tiny")
    known, dealt = Run("known", "hadr"), Run("by-frame", "hadr")
    for run, leaks in ((known, False), (dealt, True)):
        names, holds = {}, {}
        for part in ("train", "val", "test"):
            source = whole.source(run, part)
            names[part] = source.names
            holds[part] = set(source.holds(source.names))
            assert len(names[part]) == len(whole.source(known, part))
        assert len({name for listed in names.values() for name in listed}) == sum(
            len(listed) for listed in names.values()
        )
        assert bool(holds["train"] & holds["test"]) == leaks


def test_conditions_are_measured_once_and_sealed(made: tuple[Bench, Path]) -> None:
    bench, folder = made
    run, name = Run("known", "hadr"), "predicted keypoints"
    path = bench.out / condition_of(run, name)
    before = path.read_bytes()
    row = measure_condition(bench, run, name, KEYPOINTS[name])
    assert path.read_bytes() == before
    path.write_text(path.read_text().replace('"rmse_m": ', '"rmse_m": 1', 1))
    write_tables(bench, folder)  # a row that was edited is no row
    rows = read_result_file(folder / "keypoints.json").rows
    assert (run.method, name) not in {(r["method"], r["given"]) for r in rows}
    again = measure_condition(bench, run, name, KEYPOINTS[name])
    assert again["rmse_m"] == row["rmse_m"]
    write_tables(bench, folder)
    with pytest.raises(ValueError, match="known/tode/seed-0 is not finished"):
        measure_condition(bench, Run("known", "tode"), name, KEYPOINTS[name])


def test_a_sensors_depth_in_the_given_mask_is_erased_as_restore_does() -> None:
    bench = Bench([samples_dir() / "frames"], Path("out"), "tiny", limit=4)
    run, size = Run("known", "hadr"), (64, 36)
    inputs = condition_frames(bench, run, size, Given("sensor")).inputs
    seen = load_frames(bench.source(run, "test"), size, "sensor", keep_all=True).inputs.depth
    assert (seen[inputs.mask] > 0).any()
    assert torch.equal(inputs.depth, seen * ~inputs.mask)


def test_a_condition_is_compared_with_all_true_and_with_hadr(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    errors = {
        ("hadr", TRUE): [0.02, 0.03, 0.03],
        ("hadr", "predicted keypoints"): [0.03, 0.03, 0.06],
        ("hand-median", "predicted keypoints"): [0.04, 0.05, 0.93],  # lost in one frame
    }

    def finished(_: Bench, run: Run, name: str, __: Given) -> dict[str, Any] | None:
        found = errors.get((run.method, name))
        return found and {"per_frame": {"stems": ["a/0", "a/1", "a/2"], "rmse_m": found}}

    monkeypatch.setattr("hadr.experiments.conditions.finished_condition", finished)
    median, true, hadr = condition_rows(BENCH, "keypoints", {})
    assert hadr["against_true"]["mean_difference_m"] == pytest.approx(0.04 / 3)
    assert median["against_hadr"]["mean_difference_m"] == pytest.approx(0.30)
    assert median["against_hadr"]["median_difference_m"] == pytest.approx(0.02)  # 1, 2, 87 cm
    assert all("against_true" not in row for row in (median, true))


def test_each_condition_is_listed_once() -> None:
    pairs = (("hadr", 2), ("hadr", 3), ("dfnet", 0), ("raw", 0))
    made = conditions_of([Run("known", method, seed) for method, seed in pairs], BENCH)
    assert {run.seed for run, _, _ in made if run.method == "hadr"} == {2}
    listed = [(run.method, name) for run, name, _ in made]
    assert len(listed) == len(set(listed))
    assert {name for method, name in listed if method == "hadr"} == {*KEYPOINTS, *MASKS}
    assert {name for method, name in listed if method == "dfnet"} == set(MASKS)
    assert "raw" not in dict(listed)


@pytest.mark.parametrize(("file", "method"), [("known", "hand-median"), ("ablation", "full")])
def test_a_row_runs_again_from_its_record(
    made: tuple[Bench, Path], monkeypatch: pytest.MonkeyPatch, file: str, method: str
) -> None:
    bench, folder = made
    # The present recipe is another one: what counts is the recorded one.
    monkeypatch.setattr(runner, "recipe_of", lambda *_: pytest.fail("the present recipe was asked"))
    said: list[str] = []
    assert measure_again(bench, folder / f"{file}.json", method, said.append), said
    assert not (bench.out / "again" / said[0].split()[0]).exists()  # the next time trains again
    _, recorded, now = said[1].split()
    assert recorded == now


def test_a_row_of_other_frames_runs_again_and_says_so(made: tuple[Bench, Path]) -> None:
    bench, folder = made
    other = Bench(bench.roots, bench.out, "tiny", limit=bench.limit)
    other.data = {**bench.data, "sha256": "0"}
    said: list[str] = []
    assert measure_again(other, folder / "known.json", "hand-median", said.append)
    assert "frames of --data are others" in said[0]


def test_logs_are_read_once_for_each_experiment(
    made: tuple[Bench, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench, _ = made
    asked: list[str] = []

    def holds(split: str, stems: list[str]) -> list[str]:
        asked.append(split)
        return Bench.holds(bench, split, stems)

    monkeypatch.setattr(bench, "holds", holds)
    write_tables(bench, tmp_path)
    assert sorted(asked) == ["by-frame", "known"]


def test_a_row_of_other_data_does_not_run_again(made: tuple[Bench, Path]) -> None:
    bench, folder = made
    other = Bench(bench.roots, bench.out, "tiny", limit=2)
    with pytest.raises(ValueError, match="measured with limit = 4, and --preset gives 2"):
        measure_again(other, folder / "known.json", "hadr")
    with pytest.raises(ValueError, match="0 of 3 rows have method = 'tode'"):
        measure_again(bench, folder / "known.json", "tode")
    with pytest.raises(
        ValueError, match=r"2 of 4 rows have method = 'hadr', expected one; rows of known.json"
    ):
        measure_again(bench, folder / "keypoints.json", "hadr")


def test_an_edited_file_makes_no_report(made: tuple[Bench, Path], tmp_path: Path) -> None:
    _, folder = made
    text = report(folder, PUBLISHED, "tiny")
    assert "<code>hadr reproduce --preset tiny --out OUT --only known/hadr</code>" in text
    assert "Unknown objects" not in text
    for name in ("known", "ledger"):
        content = (folder / f"{name}.json").read_text(encoding="utf-8")
        changed = content.replace('"rmse_m": ', '"rmse_m": 1', 1)
        assert changed != content
        (tmp_path / f"{name}.json").write_text(changed, encoding="utf-8")
    with pytest.raises(ValueError, match="checksum"):
        report(tmp_path, PUBLISHED)
    with pytest.raises(ValueError, match="checksum"):
        ledger_table(tmp_path / "ledger.json")


def test_the_ledgers_table_has_a_column_a_switch(made: tuple[Bench, Path]) -> None:
    _, folder = made
    lines = ledger_table(folder / "ledger.json").splitlines()
    head = [cell.strip() for cell in lines[0].strip("|").split("|")]
    assert head == [
        "metric", DEFAULT, "metrics pooled", "loss weights as coded", "split by frame",
    ]  # fmt: skip
    default = read_result_file(folder / "ledger.json").row(method=DEFAULT)
    cells = [cell.strip() for cell in lines[2].strip("|").split("|")]
    doubt = 100 * default["rmse_standard_error_m"]
    assert cells[1] == f"{100 * default['rmse_m']:.2f} ±\N{NO-BREAK SPACE}{doubt:.2f}"
    assert cells[2] == f"{100 * default['pooled']['rmse_m']:.2f}"


def test_trials_that_one_network_alone_had_stand_below_the_table(tmp_path: Path) -> None:
    def trial(network: str, name: str, rmse_m: float) -> dict[str, Any]:
        return {"network": network, "trial": name, "rmse_m": rmse_m}

    rows = [trial("hadr", "published", 0.04), trial("hadr", "cosine", 0.03),
            trial("hadr", "finer", 0.02), trial("tode", "published", 0.05),
            trial("tode", "cosine", 0.06)]  # fmt: skip
    write_result_file(tmp_path / "tuning.json", "trials", rows, {})
    lines = tuning_table(tmp_path / "tuning.json").splitlines()
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    assert cells[0] == ["network", "published", "cosine"]
    assert cells[2:4] == [["HADR", "4.00", "**3.00**"], ["TODE-Trans", "**5.00**", "6.00"]]
    assert lines[-1] == "Beyond these, HADR, finer: 2.00."


def test_another_training_is_another_condition(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runner, "recipe_of", small)
    bench = Bench([samples_dir() / "frames"], tmp_path, "tiny", limit=4)
    run, name = Run("known", "unet-hand"), "predicted keypoints"
    row = bench.measure(run)
    first = measure_condition(bench, run, name, KEYPOINTS[name])
    seal_row(bench.out / run.name / runner.ROW, {**row, "training_s": 1.0})
    assert finished_condition(bench, run, name, KEYPOINTS[name]) is None
    again = measure_condition(bench, run, name, KEYPOINTS[name])
    assert again["rmse_m"] == first["rmse_m"]
    seal_row(bench.out / run.name / runner.ROW, {**row, "epochs": 2})
    with pytest.raises(ValueError, match="a row after 2 epochs and a network after 1"):
        measure_condition(bench, run, name, KEYPOINTS[name])


def test_files_without_rows_are_removed(tmp_path: Path) -> None:
    bench = Bench([samples_dir() / "frames"], tmp_path / "runs", "tiny", limit=4)
    measure_all(bench, plan(["raw"], size="tiny"), tmp_path)
    assert (tmp_path / "unknown.json").exists()
    other = Bench(bench.roots, bench.out, "tiny", "analytic", limit=4)
    measure_all(other, plan(["known/raw"], size="tiny"), tmp_path)
    assert [path.name for path in tmp_path.glob("*.json")] == ["known.json"]


def test_several_processes_give_the_rows_of_one_and_the_failing_one_is_named(
    made: tuple[Bench, Path], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    one, folder = made
    bench = Bench(one.roots, tmp_path / "runs", one.size, limit=one.limit)
    broken = bench.out / "known" / "unet-hand" / "seed-0"
    broken.mkdir(parents=True)
    (broken / "last.safetensors").write_bytes(b"cut off")
    runs = plan(["known/hand-median", "known/unet-hand"], size="tiny")
    with pytest.raises(RuntimeError, match=r"not finished: known/unet-hand/seed-0 \(ValueError: "):
        measure_all(bench, runs, tmp_path / "tables", jobs=2)
    (row,) = read_result_file(tmp_path / "tables" / "known.json").rows
    alone = read_result_file(folder / "known.json").row(method="hand-median")
    assert row["rmse_m"] == alone["rmse_m"]
    assert "last.safetensors" in capfd.readouterr().err
    with pytest.raises(ValueError, match="jobs must be at least 1, got 0"):
        measure_all(bench, runs, tmp_path, jobs=0)


def test_where_a_table_cannot_be_written_the_trainings_beside_it_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr("hadr.experiments.plan.write_tables", full)
    bench = Bench([samples_dir() / "frames"], tmp_path / "runs", "tiny")
    with pytest.raises(OSError, match="no space left") as caught:
        measure_all(bench, plan(["known/raw", "known/hadr"], size="tiny"), tmp_path, jobs=2)
    assert caught.tb  # what it holds keeps nothing running
    ended = []
    for process in multiprocessing.active_children():
        process.join(10)
        ended.append(process.exitcode)
        process.kill()
    assert all(code is not None for code in ended)
