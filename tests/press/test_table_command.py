"""The tables' part of `hadr reproduce` from the command line: what it makes, says and returns."""

from __future__ import annotations

from pathlib import Path

import pytest

from hadr.press import reproduce
from hadr.press import table_command as command
from hadr.records.result_file import read_result_file


@pytest.fixture(autouse=True)
def few_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command, "TINY_FRAMES", 6)


def run(*words: str | Path) -> int:
    return reproduce.main([str(word) for word in words])


def test_runs_end_in_tables_and_a_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("--only", "raw", "--out", tmp_path) == 0
    said = capsys.readouterr().out
    assert said.count("[1/2]") == said.count("[2/2]") == 1
    text = (tmp_path / "report.md").read_text(encoding="utf-8")
    assert "## Known objects" in text
    assert "## Unknown objects" in text
    assert {p.name for p in (tmp_path / "tables").iterdir()} == {"known.json", "unknown.json"}


def test_a_run_of_the_ledger_alone_needs_no_report(tmp_path: Path) -> None:
    assert run("--only", "by-frame/hand-median", "--out", tmp_path) == 0
    assert not (tmp_path / "report.md").exists()


def test_a_row_is_run_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--only", "known/hand-median", "--out", tmp_path) == 0
    table = tmp_path / "tables" / "known.json"
    capsys.readouterr()
    assert run("--again", table, "hand-median", "--out", tmp_path / "again", "--dry-run") == 0
    assert "would be run again" in capsys.readouterr().out
    assert run("--again", table, "hand-median", "--out", tmp_path / "again") == 0
    recorded = read_result_file(table).row(method="hand-median")["rmse_m"]
    assert f"{recorded:.6f}     {recorded:.6f}" in capsys.readouterr().out
    assert run("--again", table, "tode", "--out", tmp_path / "again") == 2
    assert run("--again", table, "tode", "--out", tmp_path / "again", "--dry-run") == 2
    assert "0 of 1 rows have method = 'tode'" in capsys.readouterr().err
    changed = table.read_text(encoding="utf-8").replace('"rmse_m": ', '"rmse_m": 1', 1)
    table.write_text(changed, encoding="utf-8")
    assert run("--again", table, "hand-median", "--out", tmp_path / "again") == 2
    assert "does not fit its checksum" in capsys.readouterr().err


def test_a_row_that_gives_other_numbers_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from hadr.experiments import again

    assert run("--only", "known/nearest", "--out", tmp_path) == 0
    whole = again.score_cheap
    monkeypatch.setattr(again, "score_cheap", lambda truth, _: whole(truth, "inpainting"))
    table = tmp_path / "tables" / "known.json"
    assert run("--again", table, "nearest", "--out", tmp_path / "again") == 1
    assert "differs" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--jobs", "0"], "--jobs must be at least 1, got 0"),
        (["--seeds", "-1"], "--seeds must be at least 0, got -1"),
        (["--only", "known/gan"], "no run fits 'known/gan'"),
        (["--only", "known/hadr/seed-7"], "seeds are chosen with --seeds"),
        (["--preset", "mini", "--only", "known"], "need --data DIR"),
    ],
)
def test_wrong_words_are_told_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    assert run("--only", "tables", "--out", tmp_path / "out", *words) == 2
    error = capsys.readouterr().err
    assert said in error
    assert len(error.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_an_output_that_is_a_file_is_told_first(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "out").write_text("taken")
    assert run("--only", "raw", "--out", tmp_path / "out") == 2
    assert "is a file" in capsys.readouterr().err
