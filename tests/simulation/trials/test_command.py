"""`hadr handover`: its manual, its errors, its files."""

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from hadr.cli import main
from hadr.records.result_file import read_result_file
from hadr.simulation.camera.sight import SOURCES
from hadr.simulation.trials import TRIAL_OBJECTS, experiment
from hadr.simulation.trials import command as handover_command
from hadr.simulation.trials.trial import ADDED, Run, Trial


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "attempts"


@pytest.fixture
def quick(whole: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """The whole attempt's run stands for every attempt."""
    monkeypatch.setattr(experiment, "run_trial", lambda trial: replace(whole, trial=trial))


def call(out: Path, *words: object) -> int:
    return main(["handover", "--out", str(out), *map(str, words)])


def test_help_is_a_manual_and_imports_nothing_heavy() -> None:
    code = (
        "import sys; from hadr.cli import main\n"
        "try: main(['handover', '--help'])\n"
        "except SystemExit: pass\n"
        "print({'torch', 'cv2', 'matplotlib', 'numpy', 'mujoco', 'scipy'} & set(sys.modules))"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    *lines, heavy = shown.stdout.splitlines()
    assert heavy == "set()"
    text = "\n".join(lines)
    for said in ("metres", "newtons", "handover.json", "-log.npz"):
        assert said in text
    for said in (*SOURCES, *(f"-{words}" for words in ADDED), *TRIAL_OBJECTS, "degrees"):
        assert f" {said}" in text


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--conditions", "rau"],
         "condition must be one of raw, inpainted, unet-hand, hadr, hadr-plus, perfect, and may "
         "have -no-rescoring, -no-tracking, -networks in this order, got 'rau'"),
        (["--conditions", "raw-networks-no-tracking"], "in this order, got 'raw-networks-no-tr"),
        (["--time-limit", "0"], "time_limit must be seconds above 0, got 0.0"),
        (["--conditions", "raw", "raw"], "--conditions names raw twice"),
        (["--jobs", f"1{30 * '0'}"], "--jobs must be from 1 to 1024, got 1000"),
        (["--seed", "-1"], "--seed must be from 0 to 9223372036854775807, got -1"),
        (["--hand-speed", "1000"], "--hand-speed must be from 0.01 to 10.0, got 1000"),
        (["--extrinsics-error", "nan"], "--extrinsics-error must be from 0 to 90, got nan"),
        (["--objects", "0099"], "no object '0099' here; there are 0000, 0001"),
        (["--objects", "0004", "0010", "0004"], "--objects names 0004 twice"),
        (["--holds", "920", "920"], "--holds names 920 twice"),
        (["--holds", "920", "-3"], "--holds must be from 0 to 999999, got -3"),
        (["--watch", "--film"], "--watch keeps no files to film"),
    ],
)  # fmt: skip
def test_wrong_arguments_are_named_in_one_line(
    words: Sequence[str], says: str, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(out, *words) == 2
    said = capsys.readouterr()
    assert said.err.startswith("hadr handover: error: ")
    assert says in said.err
    assert said.err.count("\n") == 1
    assert said.out == ""
    assert not out.exists()


def test_places_that_cannot_be_written_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "file"
    file.write_text("kept")
    assert call(file, "--dry-run") == 2
    assert f"{file} can't be a folder" in capsys.readouterr().err
    assert call(tmp_path / "out", "--dry-run", "--json", tmp_path) == 2
    assert f"{tmp_path} is a folder" in capsys.readouterr().err
    own = tmp_path / "taken" / "perfect" / "0004-902.json"
    own.parent.mkdir(parents=True)
    own.write_text("mine")
    assert call(tmp_path / "taken", "--dry-run") == 2
    assert "taken was not made by hadr" in capsys.readouterr().err
    assert file.read_text() == "kept"


def test_a_place_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["handover", "--dry-run"]) == 2
    assert "give one of --out and --replay" in capsys.readouterr().err


def test_a_replay_prints_changes_and_cautions(
    whole: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = whole.log.save(tmp_path / "a-log.npz")
    assert main(["handover", "--replay", str(file)]) == 0
    lines = capsys.readouterr().out.splitlines()
    told = [line for line in lines if " -> " in line]
    for line, change in zip(told, whole.transitions, strict=True):
        assert f"{change.before.value} -> {change.after.value}" in line
        assert line.endswith(change.reason)
        assert float(line.split()[0]) == pytest.approx(change.time, abs=0.006)
    cautions = [words for _, words in whole.log.cautions if words]
    assert [n.partition("caution: ")[2] for n in lines if "caution: " in n] == cautions
    times = [float(line.split()[0]) for line in lines[:-1]]
    assert times == sorted(times)
    assert lines[-1] == f"replayed {file}: the same {len(told)} changes of stage, the same commands"
    (tmp_path / "b.npz").write_bytes(file.read_bytes()[:500])
    assert main(["handover", "--replay", str(tmp_path / "b.npz")]) == 2
    assert "b.npz is no .npz of arrays" in capsys.readouterr().err
    assert main(["handover", "--replay", str(tmp_path / "none.npz")]) == 2
    assert "none.npz" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("conditions", "says"),
    [
        (["raw", "hadr"], "; masks and keypoints from the simulator with noise; "),
        (["hadr-plus-networks"], "; masks and keypoints from networks for hadr-plus-networks; "),
        (["raw", "hadr-plus-networks", "hadr"], "; masks and keypoints from the simulator with "
         "noise for raw, hadr and from networks for hadr-plus-networks; "),
    ],
)  # fmt: skip
def test_the_rows_file_says_whose_masks_and_keypoints(
    conditions: list[str], says: str, out: Path, quick: None
) -> None:
    words = ["--objects", "0010", "--holds", 922, "--jobs", 1]
    assert call(out, "--conditions", *conditions, *words) == 0
    assert says in read_result_file(out / "handover.json").what


def test_the_rows_file_is_no_attempt_s(
    out: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--conditions", "perfect", "--objects", "0010", "--holds", 922]
    for name in ("perfect/0010-922.json", "perfect", "raw/sub/x.json", ".hadr-lock"):
        assert call(out, *words, "--json", out / name) == 2
        assert "lies among the attempts' own files" in capsys.readouterr().err


def test_films_are_drawn_after_the_rows_are_written(
    out: Path, quick: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(*_: object) -> None:
        raise OSError("the disk is full")

    monkeypatch.setattr(experiment, "film_of_attempt", broken)
    words = ["--conditions", "raw", "perfect", "--objects", "0010", "--holds", 922, "--jobs", 1]
    assert call(out, *words, "--film") == 2
    said = capsys.readouterr()
    assert "the disk is full" in said.err
    assert said.out.endswith(f"drawing {out / 'raw' / '0010-922.mp4'}\n")
    assert len(read_result_file(out / "handover.json").rows) == 2


def test_a_dry_run_says_what_it_would_do_and_writes_nothing(
    out: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(out, "--dry-run", "--jobs", 2) == 0
    assert capsys.readouterr().out == (
        "288 attempts: 8 objects, 6 holds, 6 conditions, 2 at a time\n"
        f"finished already: 0 of 288 in {out}\n"
    )
    words = ["--conditions", "raw", "--objects", "0004", "--holds", 920, "--dry-run", "--jobs", 1]
    assert call(out, *words) == 0
    assert capsys.readouterr().out.startswith(
        "1 attempt: 1 object, 1 hold, 1 condition, 1 at a time"
    )
    assert list(tmp_path.iterdir()) == []


def test_watching_needs_a_display(
    out: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(handover_command.sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert call(out, "--watch") == 2
    said = capsys.readouterr().err
    assert "there is no display" in said
    assert "--film writes an MP4 of each attempt instead" in said
    assert not out.exists()
    monkeypatch.setenv("DISPLAY", ":0")
    handover_command.check_display()  # no word against it


def test_missing_packages_are_named(
    out: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = handover_command.importlib.util.find_spec
    monkeypatch.setattr(
        handover_command.importlib.util,
        "find_spec",
        lambda name, *rest: None if name == "mujoco" else whole(name, *rest),
    )
    assert call(out, "--dry-run") == 2
    said = capsys.readouterr().err
    assert "attempts need mujoco, not installed here: pip install 'hadr[handover]'" in said


def test_attempts_are_told_and_summed_up(
    whole: Run, out: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run_trial(trial: Trial) -> Run:
        verdict = "success" if trial.condition == "perfect" or trial.hold_number == 922 else "drop"
        result = replace(whole.outcome, verdict=verdict, largest_force=1.25)
        return replace(whole, trial=trial, outcome=result)

    monkeypatch.setattr(experiment, "run_trial", run_trial)
    words = ["--conditions", "raw", "perfect", "--objects", "0010", "--holds", 922, 923,
             "--jobs", 1]  # fmt: skip
    assert call(out, *words, "--hand-speed", 2) == 0
    said = capsys.readouterr().out
    assert "4 attempts: 1 object, 2 holds, 2 conditions, 1 at a time" in said
    assert "raw: 1 of 2 (50.0 %, 95 % interval 9 to 91); failures: 1 drop; " in said
    assert "perfect: 2 of 2 (100.0 %, 95 % interval 34 to 100); failures: none; " in said
    assert said.count("largest force 1.2 N") == 2
    assert f"the rows: {out / 'handover.json'}" in said
    file = read_result_file(out / "handover.json")
    assert [row["condition"] for row in file.rows] == ["raw", "perfect"]
    assert file.row(condition="raw")["failures"] == {"drop": 1}
    assert "hand's speed x2, camera turned by 0 degrees" in file.what
    assert {"mujoco", "mink"} <= set(file.provenance["versions"])
    # once more: nothing is run, the same rows
    monkeypatch.setattr(experiment, "run_trial", None)
    capsys.readouterr()
    assert call(out, *words, "--hand-speed", 2, "--dry-run") == 0
    assert f"finished already: 4 of 4 in {out}" in capsys.readouterr().out
    assert call(out, *words, "--hand-speed", 2, "--json", out / "rows.json") == 0
    assert read_result_file(out / "rows.json").rows == file.rows
