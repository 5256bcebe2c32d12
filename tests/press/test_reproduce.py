"""`hadr reproduce` from the command line: its plan, what it makes, says and returns."""

import json
from pathlib import Path
from typing import Any

import nbformat
import pytest

from hadr.cli import main
from hadr.experiments.steps import seconds_text
from hadr.press import reproduce
from hadr.records.checkout import checkout_root
from hadr.records.result_file import is_sealed_page, read_result_file


@pytest.fixture(autouse=True)
def few_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reproduce, "TINY_FRAMES", 6)


def run(*words: str | Path) -> int:
    return main(["reproduce", *map(str, words)])


def test_runs_end_in_tables_and_a_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("--only", "raw", "--out", tmp_path) == 0
    said = capsys.readouterr().out
    assert said.count("[1/2]") == said.count("[2/2]") == 1
    text = (tmp_path / "report.md").read_text(encoding="utf-8")
    assert "## Known objects" in text
    assert "## Unknown objects" in text
    tables = {"known.json", "unknown.json"}
    assert {p.name for p in (tmp_path / "tables").iterdir()} == tables
    assert run("--only", "raw", "--out", tmp_path) == 0  # again, over its own
    assert {p.name for p in (tmp_path / "tables").iterdir()} == tables
    changed = "report.md", "tables/known.json", "runs/known/raw/seed-0/row.json"
    for name in changed:
        (tmp_path / name).write_text("mine")
    assert run("--only", "raw", "--out", tmp_path) == 0
    assert [(tmp_path / f"{name}.changed").read_text() for name in changed] == ["mine"] * 3
    assert is_sealed_page(tmp_path / "report.md")


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
    from hadr.experiments.runner import Bench, Run

    assert run("--only", "known/nearest", "--out", tmp_path) == 0
    whole = Bench.score_cheap
    monkeypatch.setattr(
        Bench, "score_cheap", lambda bench, _: whole(bench, Run("known", "inpainting"))
    )
    table = tmp_path / "tables" / "known.json"
    assert run("--again", table, "nearest", "--out", tmp_path / "again") == 1
    assert "differs" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--jobs", "0"], "--jobs must be from 1 to 1024, got 0"),
        (["--seeds", "-1"], "--seeds must be from 0 to 9223372036854775807, got -1"),
        (["--seeds", "4", "4"], "--seeds names 4 twice"),
        (["--only", "known/gan"], "no run fits 'known/gan'"),
        (["--only", "known/hadr/seed-7"], "seeds are chosen with --seeds"),
        (["--preset", "mini", "--only", "known"], "hadr generate --preset mini --out DIR"),
        (["--data", "nowhere"], "there is no data folder nowhere"),
        (
            ["--preset", "imagenet"],
            "hadr generate --preset mini --no-sensor --frames 3000 --out DIR",
        ),
        (["--preset", "imagenet", "--only", "07"], "has tables alone, got --only 07"),
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


def test_a_folder_keeps_to_one_preset(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--only", "known/raw", "--out", tmp_path) == 0
    table = tmp_path / "tables" / "known.json"
    before = table.read_bytes()
    assert run("--only", "known/raw", "--out", tmp_path, "--preset", "mini", "--dry-run") == 2
    assert "known.json is of preset tiny, not mini: give each its own" in capsys.readouterr().err
    assert table.read_bytes() == before


def test_what_it_did_not_write_is_not_replaced(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = tmp_path / "out" / "tables" / "known.json"
    own.parent.mkdir(parents=True)
    own.write_text("years of work")
    assert run("--only", "raw", "--out", tmp_path / "out") == 2
    assert "was not made by hadr" in capsys.readouterr().err
    assert own.read_text() == "years of work"


@pytest.fixture
def chapters(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A checkout whose chapters are two small ones, one of which fails."""
    root = tmp_path / "root"
    root.mkdir()
    (root / "notebooks").symlink_to(folder)
    monkeypatch.setattr(reproduce, "checkout_root", lambda: root)
    return folder


def test_a_failure_is_printed_whole(
    chapters: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert run("--only", "1", "--out", out) == 2
    assert "ZeroDivisionError" in capsys.readouterr().err
    assert not (out / "results.json").exists()
    assert run("--only", "77", "--out", out) == 2
    assert (
        "no chapter begins with '77'; the chapters are 00_good, 01_bad" in capsys.readouterr().err
    )


def test_the_plan_is_printed_first_and_what_is_finished_is_not_repeated(
    notebook_of: Any, chapters: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    words = ("--only", "0", "--out", out)
    assert run(*words) == 0
    said = capsys.readouterr().out
    assert said.index("1 of 1 steps are left") < said.index("[ 1/1] 00_good")
    (noted,) = read_result_file(out / "run_times.json").rows
    before = nbformat.read(out / "executed" / "00_good.ipynb", 4).metadata.papermill.end_time
    assert run(*words) == 0
    said = capsys.readouterr().out
    assert "all 1 are done" in said
    (line,) = (line for line in said.splitlines() if line.startswith("  00_good"))
    assert line.split("  ")[-2].strip() == seconds_text(noted["seconds"])
    assert "(was there)" in said
    after = nbformat.read(out / "executed" / "00_good.ipynb", 4).metadata.papermill.end_time
    assert after == before
    collected = json.loads((out / "results.json").read_text())
    assert collected["chapters"]["00_good"]["results"] == {"seed": 0, "preset": "tiny"}
    nbformat.write(notebook_of("2"), chapters / "02_more.ipynb")
    assert run("--only", "2", "--out", out) == 0
    merged = json.loads((out / "results.json").read_text())["chapters"]
    assert merged["00_good"] == collected["chapters"]["00_good"]
    assert list(merged) == ["00_good", "02_more"]
    assert "has 2 of 3 chapters" in capsys.readouterr().out  # the third one fails
    times = {row["step"]: row for row in read_result_file(out / "run_times.json").rows}
    assert times["00_good"] == noted
    assert run(*words, "--seed", "1") == 0
    assert "1 of 1 steps are left; the last runs of 1 of them took" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("wishes", "said", "unsaid"),
    [
        ([], ["preset tiny, seed 0", "known/hadr-plus", "handover/perfect", "08_metrics"], []),
        (
            ["known/hadr"],
            ["known/hadr/seed-0", "everything goes to"],
            ["known/hadr-plus", "08_metrics", "handover/"],
        ),
        (["tables"], ["unknown/raw/seed-0", "known/hadr-long/seed-0"], ["08_metrics", "handover/"]),
        (["chapters"], ["08_metrics"], ["known/", "handover/"]),
        (["handover"], ["handover/raw", " 1 attempt "], ["known/", "08_metrics"]),
        (["3", "raw"], ["03_ray", "known/raw", "unknown/raw"], ["08_metrics", "nearest"]),
    ],
)
def test_a_dry_run_plans_what_is_asked_for_and_makes_nothing(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    wishes: list[str],
    said: list[str],
    unsaid: list[str],
) -> None:
    only = ["--only", *wishes] if wishes else []
    assert run("--dry-run", *only, "--out", tmp_path / "out") == 0
    found = capsys.readouterr().out
    assert [text for text in said if text not in found] == []
    assert [text for text in unsaid if text in found] == []
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("data", [[], ["--data", "nowhere"]])
def test_a_large_preset_is_planned_without_its_data(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    data: list[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run("--dry-run", "--preset", "mini", "--out", "out", *data) == 0
    said = capsys.readouterr().out
    steps = {line.split("  ")[1]: line for line in said.splitlines() if line.startswith("  ")}
    assert "6,000 frames" in steps["hadr generate --preset mini --out DIR"]
    assert "12 epochs" in steps["known/hadr/seed-0"]
    row = read_result_file(checkout_root() / "results/mini/known.json").row(method="hadr")
    took = seconds_text(row["training_s"] + row["evaluation_s"])
    assert f" {took} " in steps["known/hadr/seed-0"]
    assert "handover/hadr-plus" in steps
    assert list(tmp_path.iterdir()) == []


def test_a_missing_package_is_told_before_anything_is_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def missing() -> None:
        raise ValueError("attempts need mujoco, not installed here")

    monkeypatch.setattr(reproduce, "check_packages", missing)
    assert run("--out", tmp_path / "out") == 2
    assert "need mujoco, not installed here; or leave it out: --only" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
