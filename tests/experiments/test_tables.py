"""The result files: which rows they have, under which conditions, and that a row can be rerun."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from hadr.data.samples import samples_dir
from hadr.experiments import runner
from hadr.experiments.again import measure_again
from hadr.experiments.conditions import (
    KEYPOINTS,
    MASKS,
    TRUE,
    condition_of,
    conditions_of,
    measure_condition,
)
from hadr.experiments.plan import measure_all, plan
from hadr.experiments.report import DEFAULT, ledger_table, report
from hadr.experiments.runner import Bench, Run
from hadr.experiments.systems import System, system
from hadr.experiments.tables import ABLATION, FILES, write_tables
from hadr.result_file import read_result_file

PUBLISHED = Path(__file__).resolve().parents[2] / "results" / "paper_tables.json"


def small(method: str, size: str) -> System:
    """The system of preset tiny, trained for one epoch."""
    found = system(method, size)
    recipe = found.recipe and replace(found.recipe, epochs=1, drop_epoch=1, true_voxel_epochs=1)
    return replace(found, recipe=recipe)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Bench, Path]:
    """A bench with some runs of one epoch, and the folder of its tables."""
    patch = pytest.MonkeyPatch()
    patch.setattr(runner, "system", small)
    home = tmp_path_factory.mktemp("tables")
    bench = Bench([samples_dir() / "frames"], home / "runs", "tiny", limit=8)
    wishes = ["known/hand-median", "known/hadr", "known/no-hand", "known/hand-2d"]
    wishes += ["known/coded-weights", "by-frame/hadr"]
    measure_all(bench, plan(wishes, size="tiny"), home / "tables")
    yield bench, home / "tables"
    patch.undo()


def test_each_file_has_its_rows(made: tuple[Bench, Path]) -> None:
    _, folder = made
    found = {name: read_result_file(folder / f"{name}.json") for name in FILES if name != "unknown"}
    assert not (folder / "unknown.json").exists()
    assert [r["method"] for r in found["known"].rows] == ["hand-median", "hadr", "no-hand"]
    assert [r["method"] for r in found["ablation"].rows] == ["no-hand", "hand-2d", "full"]
    assert [r["method"] for r in found["ledger"].rows] == [
        DEFAULT,
        "coded-weights",
        "split by frame",
    ]
    full, own = found["ablation"].row(method="full"), found["known"].row(method="hadr")
    assert {**full, "method": "hadr"} == own
    assert own["configuration"]["recipe"]["epochs"] == 1
    assert set(own["provenance"]) == {"commit", "versions", "machine", "data_sha256"}
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
    masks = found["segmentation"]
    assert {r["given"] for r in masks.rows} == set(MASKS)
    assert masks.row(method="hadr", given=TRUE)["mask_iou"] == 1
    assert 0 < masks.row(method="hadr", given="predicted mask")["mask_iou"] < 1
    sensor = masks.row(method="hadr", given="simulated sensor")
    assert (sensor["corruption"], sensor["masks"]) == ("sensor", "true")


def test_the_ablation_is_the_papers() -> None:
    paper = json.loads(PUBLISHED.read_text(encoding="utf-8"))["ablation"]
    assert len(ABLATION) == len(paper)


def test_frames_by_frame_are_as_many_and_have_sisters(made: tuple[Bench, Path]) -> None:
    bench, _ = made
    whole = Bench(bench.roots, bench.out, "tiny")
    known, dealt = Run("known", "hadr"), Run("by-frame", "hadr")
    holds = {}
    for part in ("train", "val", "test"):
        assert whole.count(dealt, part) == whole.count(known, part)
        source = whole.source(dealt, part)
        stems = [f"{f.object_id}/{f.stem}" for f in (source[0], source[len(source) - 1])]
        assert len(set(stems)) == 2
        holds[part] = stems
    assert len({stem for stems in holds.values() for stem in stems}) == 6


def test_conditions_are_measured_once_and_sealed(made: tuple[Bench, Path]) -> None:
    bench, folder = made
    run, name = Run("known", "hadr"), "predicted keypoints"
    path = bench.out / condition_of(run, name)
    before = path.read_bytes()
    row = measure_condition(bench, run, name, KEYPOINTS[name])
    assert path.read_bytes() == before
    path.write_text(path.read_text().replace('"rmse_m": 0.', '"rmse_m": 9.', 1))
    write_tables(bench, folder)  # a row that was edited is no row
    rows = read_result_file(folder / "keypoints.json").rows
    assert (run.method, name) not in {(r["method"], r["given"]) for r in rows}
    again = measure_condition(bench, run, name, KEYPOINTS[name])
    assert again["rmse_m"] == row["rmse_m"]
    write_tables(bench, folder)
    with pytest.raises(ValueError, match="known/tode/seed-0 is not finished"):
        measure_condition(bench, Run("known", "tode"), name, KEYPOINTS[name])


def test_each_condition_is_listed_once() -> None:
    listed = [(run.method, name) for run, name, _ in conditions_of(["hadr", "dfnet", "raw"])]
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
    monkeypatch.setattr(runner, "system", lambda *_: pytest.fail("the present recipe was asked"))
    found = measure_again(bench, folder / f"{file}.json", method)
    assert found.same, found.text()
    assert found.now["rmse_m"] == pytest.approx(found.recorded["rmse_m"], rel=1e-6)
    assert "differs" not in found.text()


def test_a_row_of_other_data_does_not_run_again(made: tuple[Bench, Path]) -> None:
    bench, folder = made
    other = Bench(bench.roots, bench.out, "tiny", limit=4)
    with pytest.raises(ValueError, match="was measured on data"):
        measure_again(other, folder / "known.json", "hadr")
    with pytest.raises(ValueError, match="0 of 3 rows have method = 'tode'"):
        measure_again(bench, folder / "known.json", "tode")


def test_an_edited_file_makes_no_report(made: tuple[Bench, Path], tmp_path: Path) -> None:
    _, folder = made
    text = report(folder, PUBLISHED, "tiny")
    row = read_result_file(folder / "known.json").row(method="hadr")
    rmse, paper = 100 * row["rmse_m"], 0.9
    assert f"0.9 → **{rmse:.2f}** ({rmse - paper:+.2f})" in text
    assert "`--preset tiny --only known/hadr`" in text
    assert "Unknown objects" not in text
    for name in ("known", "ablation", "ledger"):
        content = (folder / f"{name}.json").read_text(encoding="utf-8")
        changed = content.replace('"rmse_m": 0.0', '"rmse_m": 0.1', 1)
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
    assert head == ["metric", DEFAULT, "metrics pooled", "coded-weights", "split by frame"]
    default = read_result_file(folder / "ledger.json").row(method=DEFAULT)
    cells = [cell.strip() for cell in lines[2].strip("|").split("|")]
    assert cells[1] == f"{100 * default['rmse_m']:.2f}"
    assert cells[2] == f"{100 * default['pooled']['rmse_m']:.2f}"


def test_several_processes_give_the_rows_of_one(tmp_path: Path) -> None:
    roots = [samples_dir() / "frames"]
    runs = plan(["known/raw", "known/nearest"], size="tiny")
    one = Bench(roots, tmp_path / "one", "tiny", limit=6)
    two = Bench(roots, tmp_path / "two", "tiny", limit=6)
    said: list[str] = []
    measure_all(one, runs, tmp_path / "tables-one", said.append)
    measure_all(two, runs, tmp_path / "tables-two", said.append, jobs=2)
    assert len([line for line in said if line.startswith("[")]) == 4
    tables = [read_result_file(tmp_path / f"tables-{n}" / "known.json") for n in ("one", "two")]
    assert [r["rmse_m"] for r in tables[0].rows] == [r["rmse_m"] for r in tables[1].rows]
    with pytest.raises(ValueError, match="jobs must be at least 1, got 0"):
        measure_all(one, runs, tmp_path, jobs=0)
