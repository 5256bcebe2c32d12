"""`benchmarks/handover/handover_tables.py`: what it plans, and what it does with some of it."""

import shutil
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from hadr.experiments.plan import REPRODUCED
from hadr.figures.tables.handover import WORSE
from hadr.records.result_file import read_result_file
from hadr.simulation.trials.experiment import attempts, run_attempts
from hadr.simulation.trials.trial import Trial


@pytest.fixture
def tables(load_benchmark: Callable[[str], ModuleType]) -> ModuleType:
    return load_benchmark("handover/handover_tables")


def test_attempts_that_differ_have_files_of_their_own(tables: ModuleType, tmp_path: Path) -> None:
    seen: dict[Path, Trial] = {}
    nothing = tables.Rows(tmp_path, None)
    for file in tables.TITLES:
        for part in tables.parts(nothing, file, 10):
            for out, trials in part.made:
                for trial in trials:
                    path = out / trial.condition / trial.name
                    assert seen.setdefault(path, trial) == trial, path
    main = list(tables.parts(nothing, "handover", 10))
    assert [part.condition for part in main] == list(REPRODUCED)
    assert {len(trials) for part in main for _, trials in part.made} == {48}
    pooled = {p.condition: len(p.made) for p in tables.parts(nothing, "seeds", 3)}
    assert (pooled["perfect"], pooled["hadr-networks"]) == (3, 1)
    for part in tables.parts(nothing, "worse", 10):
        assert set(part.changed) == {*WORSE, "restless", "time_limit"}


def test_what_is_there_is_summed_up_and_what_is_missing_is_said(
    tables: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def few(condition: str, **changed: object) -> list[Trial]:
        like = Trial("0000", 0, time_limit=0.1)
        return attempts(condition, objects=["0010"], holds=[900, 901], template=like)

    monkeypatch.setattr(tables, "attempts", few)
    monkeypatch.setattr(tables, "REPRODUCED", ("raw", "perfect"))
    runs, results = tmp_path / "runs", tmp_path / "results"
    run_attempts(few("perfect")[:1], runs / "seed-0")
    kept = ["--kept", str(tmp_path / "attempts.gz")]
    words = ["", "--out", str(runs), "--only", "handover", "--results", str(results), *kept]
    monkeypatch.setattr("sys.argv", [*words, "--write"])
    tables.main()
    file = read_result_file(results / "handover.json")
    assert [(row["condition"], row["attempts"]) for row in file.rows] == [("perfect", 1)]
    assert "3 attempts are still to be made" in file.what
    monkeypatch.setattr("sys.argv", words)
    tables.main()
    file = read_result_file(results / "handover.json")
    assert [row["attempts"] for row in file.rows] == [2, 2]
    assert "still" not in file.what

    # another machine, which has the kept rows alone, has nothing left to make
    shutil.rmtree(runs)
    asked: list[list[Trial]] = []
    monkeypatch.setattr(tables, "run_attempts", lambda trials, *_, **__: asked.append(trials))
    tables.main()
    assert asked == [[]]
    assert read_result_file(results / "handover.json").rows == file.rows


def test_more_time_is_given_only_to_what_the_clock_ended(
    tables: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ends = {"0000-900": "success", "0000-901": "time-out"}  # the others are still to be made
    rows = tables.Rows(tmp_path, None)
    found = {name: {"verdict": verdict} for name, verdict in ends.items()}
    monkeypatch.setattr(rows, "of", lambda _, trial: found.get(trial.name))
    asked = tables.patient(rows, "perfect", 0)
    made = {trial.name: (out.name, trial.time_limit) for out, (trial,) in asked}
    assert len(made) == 48
    assert made["0000-900"] == ("seed-0", 13.0)
    assert made["0000-901"] == made["0000-902"] == ("time_limit-26-seed-0", 26.0)
