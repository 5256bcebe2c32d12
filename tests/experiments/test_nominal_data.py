"""The plan of a preset without its data: as many frames as the data had that were made."""

from __future__ import annotations

from pathlib import Path

import pytest

from hadr.experiments.nominal_data import SHARES, NominalBench, data_steps, nominal_frames
from hadr.experiments.plan import estimated_seconds, plan
from hadr.experiments.run_times import read_run_times
from hadr.experiments.runner import Bench
from hadr.records.result_file import read_result_files

ROOT = Path(__file__).resolve().parents[2]


def test_nominal_frames_are_about_those_of_the_tables() -> None:
    table = read_result_files(ROOT / "results" / "mini", "known", "unknown")
    for row in table.rows:
        assert nominal_frames("mini", row["split"], "test") == pytest.approx(
            row["frames"], rel=0.01
        )
        if "training_frames" in row:
            nominal = nominal_frames("mini", row["split"], "train")
            assert nominal == pytest.approx(row["training_frames"], rel=0.01)
    assert sum(SHARES.values()) == pytest.approx(1)


def test_estimates_are_those_of_the_trainings_on_record(tmp_path: Path) -> None:
    bench = NominalBench(tmp_path / "runs", "mini")
    times = read_run_times("mini")
    (run,) = plan(["known/hadr-long"])
    table = read_result_files(ROOT / "results" / "mini", "known")
    row = table.row(method="hadr-long")
    wanted = row["training_s"] + row["evaluation_s"]
    assert estimated_seconds(bench, run, times) == pytest.approx(wanted, rel=0.01)


def test_the_data_are_a_step_where_they_are_not_there(tmp_path: Path) -> None:
    (step,) = data_steps(NominalBench(tmp_path, "mini", (Path("mine"),)))
    assert (step.part, step.left, step.makes) == ("data", "4,000 frames", "mine")
    (large,) = data_steps(NominalBench(tmp_path, "paper"))
    assert large.left == "14,100 frames"
    assert large.seconds is not None
    assert step.seconds is not None
    assert large.seconds > 10 * step.seconds
    assert data_steps(Bench([tmp_path], tmp_path)) == []
