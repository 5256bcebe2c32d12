"""The plan's text, and how long steps took: read per preset, noted from finished steps."""

from __future__ import annotations

from pathlib import Path

import pytest

from hadr.experiments.steps import Step, keep_run_times, last_run_times, seconds_text, steps_text
from hadr.records.result_file import write_result_file

STEPS = [
    Step("tables", "known/raw/seed-0", "done", 2.0, "runs/known/raw/seed-0/row.json"),
    Step("tables", "known/hadr/seed-0", "3 of 12 epochs", 600.0, "runs/known/hadr"),
    Step("chapters", "00_introduction", "execution", None, "executed/00_introduction.ipynb"),
]


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.84, "0.8 s"), (9.96, "10 s"), (14.4, "14 s"), (59.7, "1 min 00 s"), (125, "2 min 05 s"),
        (599.6, "10 min"), (1440, "24 min"), (39900, "11 h 05 min"),
    ],
)  # fmt: skip
def test_durations_for_readers(seconds: float, text: str) -> None:
    assert seconds_text(seconds) == text


def test_a_plan_says_what_is_left_and_how_long_its_last_run_took() -> None:
    lines = steps_text(STEPS).splitlines()
    assert [line.split()[0] for line in lines[1:6]] == [
        "tables", "known/raw/seed-0", "known/hadr/seed-0", "chapters", "00_introduction",
    ]  # fmt: skip
    assert lines[3].split("  ")[1:] != []
    assert "3 of 12 epochs         10 min  runs/known/hadr" in lines[3]
    assert " -  executed" in lines[5]
    assert lines[-1] == ("2 of 3 steps are left; the last runs of 1 of them took 10 min together")
    assert steps_text(STEPS[:1]).endswith("all 1 are done")


def test_times_of_finished_steps_are_kept_beside_those_of_others(tmp_path: Path) -> None:
    keep_run_times(tmp_path, STEPS[1:])
    assert list(tmp_path.iterdir()) == []
    for seconds in (2.0, 3.0):
        step = Step("tables", "known/raw/seed-0", "done", seconds, "row.json")
        keep_run_times(tmp_path, [step])
    keep_run_times(tmp_path, [Step("chapters", "00_x", "done", 7.0, "00_x.ipynb")])
    times = last_run_times(tmp_path, "paper")
    assert times == {"known/raw/seed-0": 3.0, "00_x": 7.0}
    path = tmp_path / "run_times.json"
    path.write_text(path.read_text(encoding="utf-8").replace("7.0", "6.0"), encoding="utf-8")
    with pytest.raises(ValueError, match="does not fit its checksum"):
        last_run_times(tmp_path, "paper")


def test_a_row_that_is_no_steps_is_named(tmp_path: Path) -> None:
    row = {"part": "tables", "step": "known/raw/seed-0", "seconds": "long"}
    write_result_file(tmp_path / "run_times.json", "times", [row], {})
    with pytest.raises(ValueError, match=r"run_times.json.*seconds.*must be a number, got 'long'"):
        last_run_times(tmp_path, "paper")


def test_the_repository_knows_how_long_its_own_runs_took(tmp_path: Path) -> None:
    for size, step in (("tiny", "13_handover_experiment"), ("mini", "handover/hadr")):
        times = last_run_times(tmp_path, size)
        assert {"known/hadr/seed-0", step} <= times.keys()
        assert all(seconds > 0 for seconds in times.values())
