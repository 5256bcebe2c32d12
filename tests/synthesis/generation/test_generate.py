import errno
import importlib.util
import json
import os
import shutil
from dataclasses import asdict, replace

import cv2
import numpy as np
import pytest

from hadr import __version__
from hadr.camera import transform_points
from hadr.cli import main
from hadr.data.frame import frame_log_path
from hadr.data.transhand import TransHand
from hadr.hand import forward_kinematics, keypoints_from_skeleton
from hadr.synthesis.generation.folder import whole_frames
from hadr.synthesis.generation.frames import render_frame
from hadr.synthesis.generation.generate import generate
from hadr.synthesis.generation.settings import GenerationSettings
from hadr.synthesis.holding.hold import make_hold
from hadr.synthesis.recordings.motion import record_hold
from hadr.synthesis.recordings.recording import read_recording, write_recording

SIZE = GenerationSettings(width=64, height=36, quality="fast")
TWO = replace(SIZE, objects=("0000", "0004"))


def contents(root):
    return {p.relative_to(root).as_posix(): p.read_bytes() for p in root.rglob("*") if p.is_file()}


@pytest.fixture(scope="module")
def six(tmp_path_factory):
    root = tmp_path_factory.mktemp("six")
    generate(root, 6, TWO)
    return root


def test_the_same_seed_gives_the_same_bytes_whatever_the_number_and_the_workers(six, tmp_path):
    generate(tmp_path, 8, TWO, workers=2)
    first, longer = contents(six), contents(tmp_path)
    assert len(first) == 6 * 8 + 1  # eight files a frame, and the settings
    for name, data in first.items():
        assert longer[name] == data, name


def test_a_run_goes_on_where_it_ended(six, tmp_path):
    generate(tmp_path, 3, TWO)
    recipe = TWO.recipe(1)
    frame_log_path(tmp_path, recipe.split, recipe.object_id, recipe.stem).unlink()
    report = generate(tmp_path, 6, TWO)
    assert (report.written, report.kept) == (4, 2)
    assert contents(tmp_path) == contents(six)
    assert "4 frames written, 2 kept" in str(report)


def test_a_full_disk_is_told_and_what_is_written_is_whole(six, tmp_path, monkeypatch):
    replace_file, moved = os.replace, []

    def full(source, place):
        moved.append(place)
        if len(moved) == 8 + 4:
            raise OSError(errno.ENOSPC, "No space left on device")
        replace_file(source, place)

    with monkeypatch.context() as patch:
        patch.setattr("hadr.data.frame.os.replace", full)
        with pytest.raises(OSError, match="No space left on device") as caught:
            generate(tmp_path, 6, TWO)
    whole = len(list(tmp_path.rglob("log_json/*.json")))
    (note,) = caught.value.__notes__
    assert note == f"{whole} frames were written to {tmp_path}, all of them whole"
    assert whole >= 1
    report = generate(tmp_path, 6, TWO)
    assert report.kept >= 1
    assert contents(tmp_path) == contents(six)


def test_a_frame_that_lost_a_file_is_made_again(six, tmp_path):
    shutil.copytree(six, tmp_path, dirs_exist_ok=True)
    next(tmp_path.glob("*/0004/depth/rgb/000003.*")).unlink()
    report = generate(tmp_path, 6, TWO)
    assert (report.written, report.kept) == (1, 5)
    assert contents(tmp_path) == contents(six)


PNG = {"sensor": True, "depth_format": "png", "jpeg_quality": 90, "normals": "none"}
DISPARITY = {"sensor": True, "raw_format": "disparity", "normals": "object"}


@pytest.mark.parametrize("more", [{}, PNG, DISPARITY])
def test_a_whole_frame_has_the_files_that_its_settings_promise(tmp_path, more):
    settings = GenerationSettings(width=48, height=27, quality="fast", **more)
    generate(tmp_path, 1, settings)
    recipe = settings.recipe(0)
    base = tmp_path / recipe.split / recipe.object_id / "depth"
    assert whole_frames(tmp_path, [recipe, settings.recipe(1)], settings) == {0}
    files = sorted(p for p in base.rglob("*") if p.is_file())
    assert len(files) == 8 + bool(more) - (more.get("normals") == "none")
    for path in files:
        path.rename(path.with_suffix(".away"))
        assert whole_frames(tmp_path, [recipe], settings) == set(), path.name
        path.with_suffix(".away").rename(path)
        content = path.read_bytes()
        path.write_bytes(content[: len(content) // 2])
        with pytest.raises(ValueError, match=f"{path} was damaged after it was written"):
            whole_frames(tmp_path, [recipe], settings)
        path.write_bytes(content)
    assert whole_frames(tmp_path, [recipe], settings) == {0}


def test_a_novel_object_can_be_made(tmp_path):
    settings = replace(SIZE, objects=("0012",))
    generate(tmp_path, 1, settings)
    split = settings.recipe(0).split
    frame = TransHand(tmp_path, split)[0]
    assert frame.object_id == "0012"
    assert frame.object_mask.any()
    log = next(tmp_path.glob("*/0012/depth/log_json/000000.json"))
    assert json.loads(log.read_text())["object"] == "coupe"


def test_photographs_are_checked_before_the_folder_is_taken(tmp_path):
    photographs = tmp_path / "photographs"
    photographs.mkdir()
    settings = replace(SIZE, backgrounds=str(photographs))
    picture = np.random.default_rng(0).integers(0, 256, (60, 80, 3), dtype=np.uint8)
    cv2.imwrite(str(photographs / "good.jpg"), picture)
    whole = (photographs / "good.jpg").read_bytes()
    (photographs / "half.jpg").write_bytes(whole[: len(whole) // 2])
    (photographs / "words.png").write_bytes(b"no picture")
    with pytest.raises(ValueError, match=r"2 of the photographs can't be used.*half.*words\.png"):
        generate(tmp_path / "set", 1, settings)
    assert not (tmp_path / "set").exists()
    for name in ("half.jpg", "words.png"):
        (photographs / name).unlink()
    assert generate(tmp_path / "set", 1, settings).written == 1


def test_the_command_names_what_is_wrong(tmp_path, capsys):
    start = ["generate", "--preset", "tiny", "--out", str(tmp_path / "set")]
    for line, message in (
        ("--workers 0", "workers must be from 1 to 61, got 0"),
        ("--frames 0", "the number of frames must be from 1 to 1000000, got 0"),
        ("--frames 1000000000", "the number of frames must be from 1 to 1000000"),
        ("--backgrounds /nowhere", "no folder of photographs at /nowhere"),
        ("--recordings /nowhere", "no folder of recordings at /nowhere"),
    ):
        assert main([*start, *line.split()]) == 2
        assert message in capsys.readouterr().err
    assert not (tmp_path / "set").exists()


def test_options_stand_over_the_preset(tmp_path, capsys):
    assert (
        main(
            f"generate --preset tiny --out {tmp_path} -n 1 --seed 4 --width 64 --height 36"
            " --normals none --objects 0005".split()
        )
        == 0
    )
    record = json.loads((tmp_path / "generation.json").read_text())
    assert (record["seed"], record["width"], record["jpeg_quality"]) == (4, 64, 92)
    frame = TransHand(tmp_path, "train")[0]
    assert frame.normals is None
    assert frame.object_id == "0005"
    assert "1/1" in capsys.readouterr().err  # the bar


def test_one_folder_is_named_once(tmp_path, capsys):
    assert main(["generate", "--preset", "tiny"]) == 2
    assert main(["generate", str(tmp_path), "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err.count("name one folder for the frames with --out DIR") == 2


def test_without_mitsuba_the_photo_engine_says_what_to_install(tmp_path, monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *a: None if name == "mitsuba" else find(name, *a)
    )
    with pytest.raises(ValueError, match=r"pip install 'hadr\[generate\]', or choose --engine ray"):
        generate(tmp_path, 1, replace(SIZE, engine="photo"))
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Two short recordings of one object, whose files' names seem to say that it is another."""
    folder = tmp_path_factory.mktemp("recordings")
    for number in (0, 1):
        hold = make_hold("0005", number, 3)
        recording = record_hold(hold, seed=3, seconds=0.3)
        write_recording(recording, folder / f"0001-take-{number}.csv")
    return folder


def test_recorded_holds_are_shown_at_a_moment_of_theirs(recordings, tmp_path):
    settings = replace(SIZE, objects=("0005",), recordings=str(recordings))
    generate(tmp_path, 4, settings)
    frames = TransHand(tmp_path, "train")
    held = [read_recording(path) for path in sorted(recordings.glob("*.csv"))]
    assert [f.hold_id for f in frames] == [held[k].hold_id for k in (0, 0, 1, 1)]
    for frame, recording in zip(frames, (held[k] for k in (0, 0, 1, 1)), strict=True):
        # Distances between keypoints and object do not depend on where the world is.
        local = transform_points(
            np.linalg.inv(frame.camera_from_world @ frame.world_from_object), frame.keypoints
        )
        moments = []
        for row in range(len(recording.time)):
            joints = forward_kinematics(recording.angles[row], recording.shape).joints
            own = transform_points(np.linalg.inv(recording.wrist_from_object[row]), joints)
            moments.append(np.abs(keypoints_from_skeleton(own) - local).max())
        assert min(moments) < 1e-6
    with pytest.raises(ValueError, match=r"frame 4 needs recording number 2 .* holds 2 of them"):
        generate(tmp_path, 6, settings)
    with pytest.raises(ValueError, match=r"no folder of recordings at .*none"):
        generate(tmp_path / "b", 1, replace(SIZE, recordings=str(tmp_path / "none")))


def test_a_path_traced_frame_does_not_depend_on_those_made_before(tmp_path, monkeypatch):
    for name in ("mitsuba", "pyoidn"):
        pytest.importorskip(name, reason=f"{name} is not installed: pip install 'hadr[generate]'")
    settings = GenerationSettings(
        width=48, height=27, engine="photo", samples=2, sensor=True, objects=("0000",)
    )
    generate(tmp_path / "both", 2, settings)
    generate(tmp_path / "one", 1, settings)
    second = render_frame(settings.recipe(1), settings)
    frames = TransHand(tmp_path / "both", "train")
    np.testing.assert_array_equal(frames[0].color, TransHand(tmp_path / "one", "train")[0].color)
    np.testing.assert_array_equal(frames[1].color, second.color)
    np.testing.assert_allclose(frames[1].raw_depth, second.raw_depth, atol=1e-6)
    record = json.loads((tmp_path / "one/generation.json").read_text())
    assert record["variant"] in ("llvm_ad_rgb", "scalar_rgb")
    # The run goes on with the same variant, though another one may have become usable since.
    other = "scalar_rgb" if record["variant"] == "llvm_ad_rgb" else "llvm_ad_rgb"
    monkeypatch.setattr("hadr.synthesis.generation.generate.mitsuba_variant", lambda: other)
    monkeypatch.setattr(
        "hadr.synthesis.rendering.mitsuba_variant.why_not_llvm", lambda: "it is gone"
    )
    assert generate(tmp_path / "one", 1, settings).kept == 1
    assert json.loads((tmp_path / "one/generation.json").read_text()) == record


@pytest.mark.parametrize("variable", ["llvm_ad_rgb", "cuda_ad_rgb"])
def test_a_variable_that_contradicts_the_folder_is_refused(tmp_path, monkeypatch, variable):
    settings = GenerationSettings(engine="photo", width=48, height=27)
    record = {"hadr": __version__, **asdict(settings), "variant": "scalar_rgb"}
    (tmp_path / "generation.json").write_text(json.dumps(record))
    log = tmp_path / "train/0000/depth/log_json/000000.json"
    log.parent.mkdir(parents=True)
    log.touch()
    (log.parents[1] / "depth_npy").mkdir()
    (log.parents[1] / "depth_npy/000001.npy").touch()  # of a frame that was not finished
    before = sorted(tmp_path.rglob("*"))
    monkeypatch.setenv("HADR_MITSUBA_VARIANT", variable)
    pytest.importorskip("mitsuba", reason="path-traced pictures need hadr[generate]")
    with pytest.raises(ValueError, match=f"HADR_MITSUBA_VARIANT .*'{variable}'") as raised:
        generate(tmp_path, 1, settings)
    assert "scalar_rgb" in str(raised.value)
    assert sorted(tmp_path.rglob("*")) == before


def test_the_command_says_why_it_is_slow_and_what_helps(tmp_path, monkeypatch, capsys):
    pytest.importorskip("mitsuba", reason="path-traced pictures need hadr[generate]")
    monkeypatch.delenv("HADR_MITSUBA_VARIANT", raising=False)
    for module in ("generation.generate", "rendering.mitsuba_variant"):
        name = f"hadr.synthesis.{module}.why_not_llvm"
        monkeypatch.setattr(name, lambda: "LLVM 15.0.6 is too old")
    monkeypatch.setattr("hadr.synthesis.generation.generate._make_frames", lambda recipes, **_: 1)
    words = ["generate", str(tmp_path), "--frames", "1", "--workers", "1", "--engine"]
    sentence = (
        "drawing with Mitsuba's slower variant scalar_rgb: LLVM 15.0.6 is too old; to become "
        "faster, install LLVM 17 or newer (on Debian: apt install libllvm19)\n"
    )
    for more, told in (
        (["photo"], True),
        (["photo", "--variant", "scalar_rgb"], False),  # as was asked for
        (["raycast"], False),
    ):
        assert main([*words, *more]) == 0
        assert (sentence in capsys.readouterr().out) == told


def test_a_variant_that_cant_be_used_is_refused_before_anything_is_made(tmp_path, monkeypatch):
    monkeypatch.setattr(
        "hadr.synthesis.rendering.mitsuba_variant.why_not_llvm", lambda: "it is broken"
    )
    monkeypatch.delenv("HADR_MITSUBA_VARIANT", raising=False)
    pytest.importorskip("mitsuba", reason="path-traced pictures need hadr[generate]")
    settings = GenerationSettings(width=48, height=27, engine="photo", variant="llvm_ad_rgb")
    with pytest.raises(ValueError, match=r"llvm_ad_rgb can't be used on .*: it is broken"):
        generate(tmp_path / "set", 1, settings)
    assert not (tmp_path / "set").exists()
