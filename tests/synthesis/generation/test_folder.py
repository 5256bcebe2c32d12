"""The folder of a data set that is being made: its settings, its lock, what a stop leaves."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from hadr.data.frame import frame_places
from hadr.synthesis.generation.folder import SETTINGS_FILE, generation_folder, settings_record
from hadr.synthesis.generation.settings import GenerationSettings

SETTINGS = GenerationSettings(width=64, height=36, quality="fast")


def put_frame(root, place="train/0000/depth/log_json/000000.json"):
    """A log, which makes a frame."""
    (root / place).parent.mkdir(parents=True, exist_ok=True)
    (root / place).write_text("{}")


def take(root, settings=SETTINGS):
    with generation_folder(root, settings):
        pass


def test_the_settings_are_written_once_and_compared(tmp_path):
    take(tmp_path / "new/set")
    record = json.loads((tmp_path / "new/set" / SETTINGS_FILE).read_text())
    assert record["width"] == 64
    assert record == settings_record(SETTINGS)
    take(tmp_path / "new/set")
    put_frame(tmp_path / "new/set")
    with pytest.raises(ValueError, match=r"other settings: seed is 0 there, 5 here; width is 64 t"):
        take(tmp_path / "new/set", replace(SETTINGS, seed=5, width=128))
    with pytest.raises(ValueError, match=r"objects is None there, \['0004'\] here"):
        take(tmp_path / "new/set", replace(SETTINGS, objects=("0004",)))


def test_somebodys_file_of_that_name_stays_and_a_run_that_fails_leaves_nothing(tmp_path):
    (tmp_path / SETTINGS_FILE).write_text('{"mine": 1}')
    with pytest.raises(ValueError, match=rf"{SETTINGS_FILE} is not replaced"):
        take(tmp_path)
    with pytest.raises(RuntimeError), generation_folder(tmp_path / "new", SETTINGS):
        raise RuntimeError
    assert not (tmp_path / "new").exists()


def test_settings_that_no_version_knows_are_named(tmp_path):
    take(tmp_path)
    put_frame(tmp_path)
    path = tmp_path / SETTINGS_FILE
    path.write_text(json.dumps(json.loads(path.read_text()) | {"lens": "fish-eye"}))
    with pytest.raises(ValueError, match="lens is 'fish-eye' there, None here"):
        take(tmp_path)
    path.write_text("{")
    with pytest.raises(ValueError, match=rf"{SETTINGS_FILE} is not valid JSON"):
        take(tmp_path)


def test_frames_of_another_origin_are_left_alone(tmp_path):
    (tmp_path / "train").mkdir()
    (tmp_path / "train/keep.txt").write_text("mine")
    with pytest.raises(ValueError, match=r"holds frames, but no generation\.json"):
        take(tmp_path)
    assert (tmp_path / "train/keep.txt").read_text() == "mine"


def test_leftovers_of_a_stopped_run_go_and_whole_frames_stay(tmp_path):
    take(tmp_path)
    base = tmp_path / "val/0004/depth"
    whole = ("log_json/000001.json", "rgb/000001.jpg")
    half = {
        *frame_places("000002", jpeg_quality=90, raw="depth").values(),
        *frame_places("1234567", depth_format="png", raw="disparity").values(),
    } - {Path("log_json/000002.json"), Path("log_json/1234567.json")}
    for name in (*whole, *half):
        (base / name).parent.mkdir(parents=True, exist_ok=True)
        (base / name).write_text("x")
    take(tmp_path)
    left = {p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*") if p.is_file()}
    assert left == {SETTINGS_FILE, *(f"val/0004/depth/{name}" for name in whole)}


def test_somebodys_own_files_stay(tmp_path):
    take(tmp_path)
    put_frame(tmp_path)
    base = tmp_path / "train/0000/depth"
    own = (
        "rgb/notes.txt", "rgb/glass.png", "rgb/000002.png.bak", "rgb/000002.tif", "rgb/2.png",
        "rgb/000002_edited.png", "normals/000002.npy", "mine/000002.png", "rgb/000003.png/mine",
        "rgb/old/000002.png",
    )  # fmt: skip
    for name in own:
        (base / name).parent.mkdir(parents=True, exist_ok=True)
        (base / name).write_text("mine")
    take(tmp_path)
    assert [name for name in own if not (base / name).is_file()] == []


def test_a_folder_that_is_read_from_counts_by_its_contents(tmp_path):
    for name in ("one", "two"):
        (tmp_path / name / "0004").mkdir(parents=True)
        (tmp_path / name / "0004/hold.csv").write_text("time\n0\n")
    one, two = (replace(SETTINGS, recordings=str(tmp_path / name)) for name in ("one", "two"))
    assert settings_record(one) == settings_record(two)
    take(tmp_path / "set", one)
    put_frame(tmp_path / "set")
    (tmp_path / "two/0004/hold.csv").write_text("time\n1\n")
    with pytest.raises(ValueError, match=r"recordings is '[0-9a-f]{16}' there, '[0-9a-f]{16}' he"):
        take(tmp_path / "set", two)
    (tmp_path / "empty").mkdir()
    with pytest.raises(ValueError, match=r"empty holds no recording \(\.csv\)"):
        take(tmp_path / "new", replace(SETTINGS, recordings=str(tmp_path / "empty")))
    assert not (tmp_path / "new").exists()


def test_only_files_that_are_read_count(tmp_path):
    (tmp_path / "photographs/more").mkdir(parents=True)
    (tmp_path / "photographs/a.jpg").write_text("a")
    (tmp_path / "recordings").mkdir()
    (tmp_path / "recordings/hold.csv").write_text("time\n0\n")
    settings = replace(
        SETTINGS, backgrounds=str(tmp_path / "photographs"), recordings=str(tmp_path / "recordings")
    )
    before = settings_record(settings)
    (tmp_path / "photographs/more/b.jpg").write_text("b")
    (tmp_path / "recordings/settings.json").write_text("{}")
    assert settings_record(settings) == before
    (tmp_path / "photographs/b.jpg").write_text("b")
    assert settings_record(settings)["backgrounds"] != before["backgrounds"]
    for name in ("hold.json", "hold.placement.csv"):
        before = settings_record(settings)
        (tmp_path / "recordings" / name).write_text("{}")
        assert settings_record(settings)["recordings"] != before["recordings"], name


def test_settings_of_a_run_without_a_frame_bind_nobody(tmp_path):
    take(tmp_path)
    half = tmp_path / "train/0000/depth/rgb/000000.png"
    half.parent.mkdir(parents=True)
    half.write_text("half a frame of seed 0")
    take(tmp_path, replace(SETTINGS, seed=5))
    assert json.loads((tmp_path / SETTINGS_FILE).read_text())["seed"] == 5
    assert not half.exists()
    put_frame(tmp_path)
    with pytest.raises(ValueError, match="seed is 5 there, 0 here"):
        take(tmp_path)


def test_a_file_in_the_place_of_the_folder_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    for root in (tmp_path / "file", tmp_path / "file/set"):
        with pytest.raises(ValueError, match=rf"{root} can't be a folder: .*/file is a file"):
            take(root)
