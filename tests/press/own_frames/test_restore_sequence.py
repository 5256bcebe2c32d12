"""A folder of frames: each has its result, the film shows all, and what is refused is named."""

import json
import os
from pathlib import Path

import cv2
import imageio.v3 as iio
import numpy as np
import pytest

from hadr.cli import main

NAMES = ("0001", "0002", "0010.5")


@pytest.fixture
def frames(tmp_path):
    """Three small frames, a plane that comes nearer with a hole in it, and the words for them."""
    for part in ("rgb", "depth", "mask"):
        (tmp_path / part).mkdir()
    mask = np.zeros((48, 64), np.uint8)
    mask[10:30, 20:40] = 255
    for number, name in enumerate(NAMES):
        depth = np.where(mask, 0, 900 - 100 * number).astype(np.uint16)
        color = np.random.default_rng(number).integers(0, 255, (48, 64, 3)).astype(np.uint8)
        for part, image in (("rgb", color), ("depth", depth), ("mask", mask)):
            cv2.imwrite(str(tmp_path / part / f"{name}.png"), image)
    (tmp_path / "camera.json").write_text(
        json.dumps({"fx": 80, "fy": 80, "cx": 31.5, "cy": 23.5, "width": 64, "height": 48})
    )
    words = [f"--{part}={tmp_path / part}" for part in ("rgb", "depth", "mask")]
    words += [f"--intrinsics={tmp_path / 'camera.json'}", f"--out={tmp_path / 'out'}"]
    return tmp_path, ["restore", *words]


def test_a_name_that_no_record_can_hold_is_named(frames, capsys):
    folder, words = frames
    try:
        (folder / "rgb" / os.fsdecode(b"f\xff.png")).touch()
    except OSError:
        pytest.skip("this file system takes names of UTF-8 alone")
    assert main(words) == 2
    assert r"f\udcff.png': its name can't be written down" in capsys.readouterr().err
    assert not (folder / "out").exists()


def content(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_each_frame_has_a_result_and_the_film_shows_all(frames, capsys):
    folder, words = frames
    assert main(words) == 0
    out = folder / "out"
    assert sorted(path.name for path in out.iterdir()) == [*NAMES, "film.mp4", "sequence.json"]
    for number, name in enumerate(NAMES):
        assert np.load(out / name / "depth.npy").max() == pytest.approx(0.9 - 0.1 * number)
        assert json.loads((out / name / "report.json").read_text())["method"] == "nearest"
        assert (out / name / "cloud.ply").stat().st_size > 48 * 64 * 12
    assert len(iio.imread(out / "film.mp4")) == len(NAMES)
    assert "3 of 3 frames: nearest valid depth (not HADR) (0001, 0002, 0010.5)" in (
        capsys.readouterr().out
    )
    assert main(["view", str(out / "0010.5"), "--no-browser"]) == 0
    assert main(words) == 2
    assert "already holds 0001 and 4 more" in capsys.readouterr().err
    assert main([*words, "--overwrite"]) == 0
    made = content(out)
    for name in ("0002/thesis.txt", "0002/depth.png", "sequence.json", "film.mp4"):
        (out / name).write_text("years of work")
        before = content(out)
        assert main([*words, "--overwrite"]) == 2
        own = Path(name).name if name != "sequence.json" else "0001"  # nothing says what was made
        assert f"holds {own}, which no run like this one wrote" in capsys.readouterr().err
        assert content(out) == before
        (out / name).unlink()
        if out / name in made:
            (out / name).write_bytes(made[out / name])
    assert main([*words, "--overwrite"]) == 0


def test_a_frame_that_is_refused_is_named_and_the_others_are_restored(frames, capsys):
    folder, words = frames
    cv2.imwrite(str(folder / "mask" / "0002.png"), np.zeros((48, 64), np.uint8))
    assert main(words) == 1
    assert "1 of 3 frames were refused" in capsys.readouterr().err
    told = json.loads((folder / "out" / "sequence.json").read_text())["frames"]
    assert "the mask is empty" in told["0002"]["refused"]
    assert not (folder / "out" / "0002").exists()
    assert (folder / "out" / "0010.5" / "cloud.ply").exists()
    for name in ("0001", "0010.5"):
        cv2.imwrite(str(folder / "mask" / f"{name}.png"), np.zeros((48, 64), np.uint8))
    assert main([*words, "--out", str(folder / "none")]) == 2
    assert "none of the 3 frames is usable; 0001: the mask is empty" in capsys.readouterr().err
    assert not (folder / "none").exists()


@pytest.mark.parametrize(
    ("wrong", "words"), [("/dev/zero", "is a pipe or a device"), ("nowhere", "does not exist")]
)
def test_a_link_to_no_file_is_one_refused_frame(frames, wrong, words, capsys):
    folder, line = frames
    (folder / "mask" / "0002.png").unlink()
    (folder / "mask" / "0002.png").symlink_to(wrong)
    for part in ("rgb", "depth", "mask"):
        (folder / part / "0012.png").symlink_to(wrong)
    assert main(line) == 1
    told = json.loads((folder / "out" / "sequence.json").read_text())["frames"]
    assert words in told["0002"]["refused"]
    assert words in told["0012"]["refused"]
    assert [name for name in told if "refused" not in told[name]] == ["0001", "0010.5"]
    assert "2 of 4 frames were refused" in capsys.readouterr().err


def test_a_folder_in_place_of_the_film_is_somebody_s(frames, capsys):
    folder, words = frames
    assert main(words) == 0
    film = next((folder / "out").glob("film.*"))
    film.unlink()
    film.mkdir()
    (film / "mine.txt").write_text("kept")
    assert main([*words, "--overwrite"]) == 2
    assert f"holds {film.name}, which no run like this one wrote" in capsys.readouterr().err
    assert (film / "mine.txt").read_text() == "kept"


def test_files_that_do_not_belong_together_are_refused_before_anything_is_made(frames, capsys):
    folder, words = frames
    whole = words.index(f"--mask={folder / 'mask'}")
    single = [*words[:whole], f"--mask={folder / 'mask' / '0001.png'}", *words[whole + 1 :]]
    assert main(single) == 2
    assert "so --mask" in capsys.readouterr().err
    (folder / "rgb" / "0001.jpg").write_bytes(b"")
    assert main(words) == 2
    assert "two files of frame 0001" in capsys.readouterr().err
    (folder / "rgb" / "0001.jpg").unlink()
    lost = folder / "rgb" / "0010.5.png"
    assert lost.is_file()
    lost.rename(folder / "kept.png")
    assert main(words) == 2
    told = capsys.readouterr().err
    assert "rgb has no file of frame 0010.5, as" in told
    assert "0010.5.png is (1 of 3 lack one)" in told
    (folder / "kept.png").rename(lost)
    (folder / "depth" / "0010.5.png").unlink()
    assert main(words) == 2
    assert "depth has no file of frame 0010.5, as" in capsys.readouterr().err
    assert not (folder / "out").exists()


def test_no_frame_is_named_as_a_file_of_the_result(frames, capsys):
    folder, words = frames
    for part in ("rgb", "depth", "mask"):
        (folder / part / "0001.png").rename(folder / part / "sequence.json.png")
    assert main(words) == 2
    assert "sequence.json.png: no frame can have the name of a result's" in capsys.readouterr().err
    assert not (folder / "out").exists()


def test_a_part_of_a_sequence_is_not_replaced_alone_and_gets_no_other_page(frames, capsys):
    folder, words = frames
    (folder / "rgb" / "Thumbs.db").write_bytes(b"a system's")
    assert main(words) == 0
    out = folder / "out"
    before = content(out)
    assert set(json.loads((out / "sequence.json").read_text())["frames"]) == {
        "0001", "0002", "0010.5"
    }  # fmt: skip
    one = [word.replace("/mask", "/mask/0002.png") for word in words if word.startswith("--mask")]
    one += [f"--{name}={folder / name / '0002.png'}" for name in ("rgb", "depth")]
    one += [f"--intrinsics={folder / 'camera.json'}", "--overwrite"]
    for name in ("0001", "new"):
        assert main(["restore", *one, f"--out={out / name}"]) == 2
        assert "would lie in" in capsys.readouterr().err
    for name in ("0002/view.html", "view.html", "0001/other.html"):
        assert main(["view", str(out / "0001"), "--no-browser", "--out", str(out / name)]) == 2
        assert "a result of 'hadr restore'" in capsys.readouterr().err
    assert main(["view", str(out / "0001"), "--out", str(folder / "page.png")]) == 2
    assert "name a file NAME.html" in capsys.readouterr().err
    assert content(out) == before
