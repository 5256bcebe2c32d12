"""Recorded times: read per preset, noted from finished steps, never guessed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hadr.experiments.handover_table import REPRODUCED
from hadr.experiments.run_times import TRAINING_CHAPTERS, read_run_times, write_run_times
from hadr.experiments.systems import LEARNED, METHODS, PARTS, SWITCHES
from hadr.records.result_file import read_result_file, write_result_file

ROOT = Path(__file__).resolve().parents[2]


def test_times_of_preset_mini_are_those_of_the_tables() -> None:
    times = read_run_times("mini")
    known, unknown = (
        read_result_file(ROOT / "results" / "mini" / f"{name}.json")
        for name in ("known", "unknown")
    )
    assert set(times.training) == {*LEARNED, *PARTS, *SWITCHES}
    rates = [
        (row := file.row(method="tode"))["training_s"] / row["epochs"] / row["training_frames"]
        for file in (known, unknown)
    ]
    assert times.training["tode"] == pytest.approx(sum(rates) / 2)
    long = known.row(method="hadr-long")
    wanted = long["training_s"] + long["evaluation_s"]
    assert times.of_run("hadr-long", 48, long["training_frames"]) == pytest.approx(wanted)
    handover = read_result_file(ROOT / "results" / "mini" / "handover.json")
    assert times.attempts["hadr"] == handover.row(arm="hadr")["mean_wall_seconds"]


@pytest.mark.parametrize("size", ["tiny", "mini"])
def test_every_step_of_the_small_presets_has_a_time(size: str) -> None:
    times = read_run_times(size)
    assert {*LEARNED, *PARTS, *SWITCHES} <= set(times.training)
    assert set(METHODS) <= set(times.scoring)
    chapters = {path.stem for path in (ROOT / "notebooks").glob("*.ipynb")}
    if size != "tiny":
        chapters -= set(TRAINING_CHAPTERS)
    assert chapters <= set(times.chapters)
    assert set(REPRODUCED) <= set(times.attempts)
    every = [times.training, times.scoring, times.chapters, times.attempts, times.conditions]
    assert all(seconds > 0 for each in every for seconds in each.values())


def test_without_result_files_nothing_has_a_time(tmp_path: Path) -> None:
    for size in ("tiny", "mini", "paper"):
        times = read_run_times(size, tmp_path)
        assert times.of_run("hadr", 3, 10) is None
        assert times.of_run("raw", 0, 0) is None
        assert not times.chapters


def test_what_was_noted_is_read(tmp_path: Path) -> None:
    row = {"configuration": {"run": "known/hadr/seed-0"}, "training_s": 60.0, "epochs": 3,
           "training_frames": 10, "evaluation_s": 4.0, "threads": 1, "seeds": [0]}  # fmt: skip
    write_result_file(tmp_path / "tables" / "known.json", "rows", [row], {})
    same = {**row, "method": "as by default"}  # of the same run: noted once
    write_result_file(tmp_path / "tables" / "ledger.json", "rows", [same], {})
    arm = {"arm": "raw", "attempts": 2, "mean_wall_seconds": 7.0}
    write_result_file(tmp_path / "tables" / "handover.json", "rows", [arm], {})
    given = tmp_path / "runs" / "known" / "hadr" / "seed-0" / "given"
    given.mkdir(parents=True)
    for name, seconds in (("A", 2.0), ("B", 4.0)):
        content = {"given": "predicted mask", "evaluation_s": seconds, "frames": 10}
        (given / f"{name}.json").write_text(json.dumps(content))
    chapters = {"chapters": {"00_a": {"duration_s": 12.5, "results": None}}}
    (tmp_path / "results.json").write_text(json.dumps(chapters))
    noted = write_run_times(tmp_path)
    assert noted is not None
    assert len(read_result_file(noted).rows) == 4
    (tmp_path / "tiny").mkdir()
    noted.rename(tmp_path / "tiny" / noted.name)
    times = read_run_times("tiny", tmp_path)
    assert times.of_run("hadr", 2, 5) == pytest.approx(2 * 5 * 60 / 30 + 4)
    assert times.attempts == {"raw": 7.0}
    assert times.chapters == {"00_a": 12.5}
    assert times.conditions == {"predicted mask": pytest.approx(0.3)}


def test_a_chapters_own_time_at_preset_mini_comes_before_the_one_at_tiny(tmp_path: Path) -> None:
    noted = {"00_a": 1.0, "01_b": 2.0, "06_training": 3.0}
    for size, seconds in (("tiny", noted), ("mini", {"01_b": 9.0})):
        rows = [{"step": n, "part": "chapter", "seconds": s} for n, s in seconds.items()]
        write_result_file(tmp_path / size / "run_times.json", "times", rows, {})
    assert read_run_times("tiny", tmp_path).chapters == noted
    assert read_run_times("mini", tmp_path).chapters == {"00_a": 1.0, "01_b": 9.0}
    assert read_run_times("paper", tmp_path).chapters == {}


def test_nothing_finished_is_nothing_to_note(tmp_path: Path) -> None:
    assert write_run_times(tmp_path) is None
    assert list(tmp_path.iterdir()) == []
