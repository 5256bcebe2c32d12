import json
import re
import subprocess
import sys
from dataclasses import dataclass, field
from typing import Literal

import cv2
import numpy as np
import pytest
import torch
import trimesh
import tyro

from hadr import __version__
from hadr.cli import COMMANDS, command_parser, main
from hadr.frame_io import read_depth, read_hand, read_mask
from hadr.records.output_folder import MARKER
from hadr.records.writing import LOCK, sole_owner

OUTPUTS = [
    "cloud.ply",
    "comparison.png",
    "confidence.npy",
    "confidence.png",
    "depth.npy",
    "depth.png",
    "mask.png",
    "report.json",
]


@pytest.fixture
def frame(tmp_path):
    """The files of a small frame: a hole in a plane at 0.5 m, and the words that restore it."""
    depth = np.full((48, 64), 500, np.uint16)
    depth[10:30, 20:40] = 0
    mask = np.zeros((48, 64), np.uint8)
    mask[10:30, 20:40] = 255
    color = np.random.default_rng(0).integers(0, 255, (48, 64, 3)).astype(np.uint8)
    hand = np.zeros((21, 3)) + np.linspace(0, 0.15, 21)[:, None] + (0, 0, 0.42)
    for name, image in (("rgb", color), ("depth", depth), ("mask", mask)):
        cv2.imwrite(str(tmp_path / f"{name}.png"), image)
    (tmp_path / "hand.json").write_text(json.dumps(hand.tolist()))
    (tmp_path / "camera.yaml").write_text(
        "fx: 80\nfy: 80\ncx: 31.5\ncy: 23.5\nwidth: 64\nheight: 48\n"
    )
    return tmp_path


def words(folder, **changes) -> list[str]:
    given = {
        "rgb": folder / "rgb.png",
        "depth": folder / "depth.png",
        "intrinsics": folder / "camera.yaml",
        "mask": folder / "mask.png",
        "out": folder / "out",
    } | changes
    line = ["restore"]
    for name, value in given.items():
        if value is not None:
            line += [f"--{name.replace('_', '-')}", str(value)]
    return line


def test_all_files_are_written_and_agree(frame, capsys) -> None:
    assert main(words(frame)) == 0
    out = frame / "out"
    assert sorted(p.name for p in out.iterdir()) == OUTPUTS
    depth = np.load(out / "depth.npy")
    assert depth.dtype == np.float32
    np.testing.assert_allclose(depth, 0.5, rtol=1e-6)
    np.testing.assert_allclose(read_depth(out / "depth.png"), depth, atol=5e-4)
    mask = read_mask(frame / "mask.png")
    np.testing.assert_array_equal(np.load(out / "confidence.npy"), np.where(mask, 0, 1))
    np.testing.assert_array_equal(read_mask(out / "confidence.png"), ~mask)
    assert len(trimesh.load(out / "cloud.ply").vertices) == 48 * 64
    assert min(cv2.imread(str(out / "comparison.png")).shape[:2]) > 500
    report = json.loads((out / "report.json").read_text())
    assert report["method"] == "nearest"
    assert report["counts"]["restored"] == 400
    assert report["counts"]["still_missing"] == 0
    assert report["versions"]["hadr"] == __version__
    assert len(report["inputs"]["depth"]["sha256"]) == 64
    assert "0.001 m per unit" in report["outputs"]["depth.png"]["holds"]
    printed = capsys.readouterr().out
    for said in (printed, " ".join(report["notes"])):
        assert "no checkpoint fits" in said
        assert "the result is nearest valid depth, not HADR" in said
    assert report["confidence_means"] == "0, the method cannot say how sure it is"
    np.testing.assert_array_equal(read_mask(out / "mask.png"), mask)
    assert "restored  400 of 400 pixels" in printed


def test_the_hand_is_written_and_reads_back(frame, capsys) -> None:
    arm = ~read_mask(frame / "mask.png")
    cv2.imwrite(str(frame / "arm.png"), arm.astype(np.uint8) * 255)
    assert main(words(frame, hand=frame / "hand.json", hand_mask=frame / "arm.png")) == 0
    out = frame / "out"
    assert sorted(p.name for p in out.iterdir()) == sorted([*OUTPUTS, "hand.json", "hand_mask.png"])
    np.testing.assert_array_equal(read_mask(out / "hand_mask.png"), arm)
    np.testing.assert_array_equal(read_hand(out / "hand.json"), read_hand(frame / "hand.json"))
    told = json.loads((out / "hand.json").read_text())
    assert (told["source"], told["accepted"]) == ("given", True)
    assert told["measured"]["area_m2"] is None, "the given hand's pixels are not looked for"
    report = json.loads((out / "report.json").read_text())
    assert report["hand"]["problems"] == told["problems"] != []
    assert "hand.json" in report["outputs"]
    assert "the given hand does not fit this frame" in capsys.readouterr().out
    assert main([*words(frame), "--overwrite"]) == 0
    assert sorted(p.name for p in out.iterdir()) == OUTPUTS
    told["accepted"] = False
    (frame / "hand.json").write_text(json.dumps(told))
    assert main(words(frame, hand=frame / "hand.json", out=frame / "again")) == 2
    assert "was not accepted as a hand" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"hand": "mediapipe"}, "make it with 'hadr hand-model --out hand_landmarker.task'"),
        ({"hand_model": "gone.task"}, "it goes with --hand mediapipe"),
        (
            {"hand": "mediapipe", "hand_model": "gone.task", "keypoint_network": "net"},
            "both find the hand: name one",
        ),
        ({"hand": "mediapipe", "hand_model": "gone.task"}, "pip install 'hadr[mediapipe]'"),
    ],
)
def test_what_mediapipe_lacks_is_one_sentence(frame, capsys, monkeypatch, changes, sentence):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert main(words(frame, **changes)) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert sentence in line
    assert not (frame / "out").exists()


def test_truth_prints_the_errors_of_both(frame, capsys) -> None:
    np.save(frame / "truth.npy", np.full((48, 64), 0.55, np.float32))
    assert main(words(frame, truth=frame / "truth.npy")) == 0
    report = json.loads((frame / "out" / "report.json").read_text())
    assert "measured" not in report["errors_in_mask"], "nothing was measured in the mask"
    assert report["errors_in_mask"]["restored"]["rmse_m"] == pytest.approx(0.05, rel=1e-5)
    assert report["errors_in_mask"]["restored"]["pixels"] == 400
    assert report["errors_in_mask"]["restored"]["coverage"] == 1
    told = capsys.readouterr().out
    assert "the truth is known in 400 of its 400 pixels" in told
    assert "RMSE (cm) 5.00" in told


def test_a_truth_that_is_the_input_depth_is_named(frame) -> None:
    depth = np.full((48, 64), 0.5, np.float32)
    np.save(frame / "depth.npy", depth)
    assert main(words(frame, depth=frame / "depth.npy", truth=frame / "depth.npy")) == 0
    notes = json.loads((frame / "out" / "report.json").read_text())["notes"]
    assert "the truth is the input depth itself, in all 400 pixels" in notes[-2]
    assert "the truth is what was restored, to 1 mm in 100 % of the pixels" in notes[-1]
    depth[15, 25] = 0.81
    np.save(frame / "truth.npy", depth)
    again = words(frame, depth=frame / "depth.npy", truth=frame / "truth.npy", out=frame / "b")
    assert main(again) == 0
    assert "input depth itself" not in (frame / "b" / "report.json").read_text()


def test_a_truth_that_can_t_be_one_is_refused(frame, capsys) -> None:
    np.save(frame / "truth.npy", np.full((48, 64), 750.0, np.float32))
    assert main(words(frame, truth=frame / "truth.npy")) == 2
    assert "truth has a median of 750, expected metres" in capsys.readouterr().err


def test_a_truth_unknown_in_the_mask_is_said(frame) -> None:
    np.save(frame / "truth.npy", np.where(read_mask(frame / "mask.png"), 0, 0.5))
    assert main(words(frame, truth=frame / "truth.npy")) == 0
    report = json.loads((frame / "out" / "report.json").read_text())
    assert report["errors_in_mask"] == {}
    assert "no errors can be stated: the truth is known in 0 of the mask's" in report["notes"][-1]


def test_nothing_restored_is_exit_status_1_with_the_reasons(frame, capsys) -> None:
    import torch

    from hadr.models.hadr import HADR
    from hadr.training.checkpoints import save_checkpoint
    from hadr.training.presets import preset

    torch.manual_seed(0)
    path = frame / "near.safetensors"
    size = {"width": 64, "height": 48, "learned_range": {"depth_m": [0.1, 0.2]}}
    save_checkpoint(path, HADR(preset("tiny").model), size)
    assert main(words(frame, hand=frame / "hand.json", checkpoint=path)) == 1
    told = capsys.readouterr()
    assert told.err.startswith("hadr restore: error: nothing could be restored: all 400 pixels")
    assert "method    HADR\n" in told.out
    report = json.loads((frame / "out" / "report.json").read_text())
    assert any(
        "100.0 % stay missing: their depth would lie outside of what" in n for n in report["notes"]
    )
    assert (report["method"], report["versions"]["torch"]) == ("hadr", torch.__version__)
    assert report["inputs"]["checkpoint"]["sha256"]


BAD = {
    "a wrong scale": ({"depth_scale": 1}, "a median of 500, expected metres between"),
    "a missing file": ({"rgb": "gone.png"}, "gone.png does not exist"),
    "a truncated PNG": (
        {"depth": "bad.png"},
        "is not a whole image, PNG or JPEG: the PNG is cut off after 90 bytes",
    ),
    "a truncated EXR": ({"depth": "bad.exr"}, "is not a whole OpenEXR image"),
    "a checkpoint that is not there": (
        {"checkpoint": "gone.safetensors", "hand": "hand.json"},
        "there is no checkpoint at ",
    ),
    "HADR without a hand": (
        {"method": "hadr"},
        "no checkpoint fits: the sample checkpoint needs 21 hand keypoints",
    ),
    "truth of another size": (
        {"truth": "bad.npy"},
        "truth is (4, 4) but depth is (48, 64), expected the same",
    ),
}


@pytest.mark.parametrize(("changes", "sentence"), BAD.values(), ids=BAD)
def test_bad_input_is_one_sentence_and_leaves_nothing(frame, capfd, monkeypatch, changes, sentence):
    monkeypatch.chdir(frame)
    (frame / "bad.png").write_bytes((frame / "depth.png").read_bytes()[:90])
    (frame / "bad.exr").write_bytes(b"\x76\x2f\x31\x01\x02\x00\x00\x00channels\0chl")
    np.save("bad.npy", np.ones((4, 4)))
    before = sorted(p.name for p in frame.iterdir())
    assert main(words(frame, **changes)) == 2
    captured = capfd.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("hadr restore: error: ")
    assert captured.err.count("\n") == 1
    assert sentence in captured.err
    assert sorted(p.name for p in frame.iterdir()) == before, "something was left behind"


def test_an_earlier_result_is_only_replaced_when_asked(frame, capsys) -> None:
    assert main(words(frame)) == 0
    cloud = frame / "out" / "cloud.ply"
    earlier = cloud.read_bytes()
    assert main(words(frame)) == 2
    assert "already holds cloud.ply and 7 more; choose a new name" in capsys.readouterr().err
    again = [*words(frame, depth=frame / "out" / "depth.png"), "--overwrite"]
    assert main(again) == 2
    assert "out is not replaced: " in capsys.readouterr().err  # it would replace its own input
    for name, content in (
        ("cloud.ply", b"edited"),
        ("report.json", b'{"command": "hadr restore"}'),
    ):
        kept = (frame / "out" / name).read_bytes()
        (frame / "out" / name).write_bytes(content)
        assert main([*words(frame), "--overwrite"]) == 2
        assert "or which was changed since" in capsys.readouterr().err
        assert (frame / "out" / name).read_bytes() == content
        (frame / "out" / name).write_bytes(kept)
    depth = cv2.imread(str(frame / "depth.png"), cv2.IMREAD_UNCHANGED)
    cv2.imwrite(str(frame / "depth.png"), depth + np.uint16(3) * (depth > 0))
    assert main([*words(frame), "--overwrite", "--quiet"]) == 0
    assert capsys.readouterr().out == ""
    assert json.loads((frame / "out" / "report.json").read_text())["method"] == "nearest"
    assert cloud.read_bytes() != earlier
    (frame / "out" / "report.json").rename(frame / "kept.json")
    assert main([*words(frame), "--overwrite"]) == 2
    assert "holds cloud.ply, which no run like this one wrote" in capsys.readouterr().err
    (frame / "kept.json").rename(frame / "out" / "report.json")
    (frame / "out" / "hand.json").write_text("mine")  # of a hand that this run was not given
    assert main([*words(frame), "--overwrite"]) == 2
    assert "holds hand.json, which no run like this one wrote" in capsys.readouterr().err
    assert (frame / "out" / "hand.json").read_text() == "mine"
    (frame / "out" / "hand.json").unlink()
    (frame / "out" / "mine.txt").write_text("keep")
    assert main([*words(frame), "--overwrite"]) == 2
    assert "holds mine.txt, which no run like this one wrote" in capsys.readouterr().err
    assert (frame / "out" / "mine.txt").read_text() == "keep"


def test_a_truth_of_another_frame_is_named(frame, capsys) -> None:
    depth = cv2.imread(str(frame / "depth.png"), cv2.IMREAD_UNCHANGED)
    for name, off, said in (("near", 30, False), ("far", 120, True)):
        cv2.imwrite(str(frame / f"{name}.png"), depth + np.uint16(off) * (depth > 0))
        line = [*words(frame, out=frame / name), "--truth", str(frame / f"{name}.png")]
        assert main(line) == 0
        assert ("outside of the mask by 12 cm" in capsys.readouterr().out) == said


def test_a_crash_while_writing_leaves_nothing(frame, capsys, monkeypatch) -> None:
    def full_disk(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("hadr.press.own_frames.restore_command.write_point_cloud", full_disk)
    before = sorted(p.name for p in frame.iterdir())
    assert main(words(frame)) == 1
    assert capsys.readouterr().err == (
        "hadr restore: error: the disk is full (No space left on device); no file is half-written: "
        "make room, run it again\n"
    )
    assert sorted(p.name for p in frame.iterdir()) == before


@pytest.mark.parametrize(
    "line",
    [
        "train --preset tiny --out",
        "generate --frames 1 --out",
        "handover --conditions perfect --objects 0004 --holds 902 --jobs 1 --out",
        "reproduce --only known/raw --out",
        "book --html-only --build",
    ],
)
def test_a_folder_that_another_run_has_is_refused(tmp_path, capfd, line) -> None:
    pytest.importorskip("fcntl", reason="folders are locked on POSIX systems alone")
    with sole_owner(tmp_path / "out", "hadr test") as folder:
        assert main([*line.split(), str(folder)]) == 2
        assert {p.name for p in folder.iterdir()} <= {LOCK, MARKER}
    error = capfd.readouterr().err
    assert error.startswith(f"hadr {line.split()[0]}: error: {folder} is taken by hadr test, ")
    assert error.count("\n") == 1


def test_what_nobody_expected_is_a_bug_and_says_so(frame, capsys, monkeypatch) -> None:
    monkeypatch.setattr("hadr.press.own_frames.restore_command.write_point_cloud", None)
    assert main(words(frame)) == 1
    told = capsys.readouterr().err
    assert "TypeError: 'NoneType' object is not callable\nhadr restore: this is a bug in" in told
    assert "please report it with the command and the text above" in told


GPU = "CUDA out of memory. Tried to allocate 2.00 GiB. GPU 0 has a total capacity of 1.00 GiB."


@pytest.mark.parametrize(
    ("line", "error", "told"),
    [
        ("train --out", torch.OutOfMemoryError(GPU),
         "memory ran out (CUDA out of memory. Tried to allocate 2.00 GiB); a smaller --batch-size"),
        ("generate --out", MemoryError("Unable to allocate 9 TiB"),
         "memory ran out (Unable to allocate 9 TiB); a smaller --workers needs less\n"),
    ],
)  # fmt: skip
def test_where_memory_ran_out_it_is_said_what_needs_less(
    line, error, told, tmp_path, capsys, monkeypatch
) -> None:
    def run(_: object) -> int:
        raise error

    name, option = line.split()
    monkeypatch.setattr(f"{COMMANDS[name][0]}.run", run)
    assert main([name, option, str(tmp_path / "out")]) == 1
    said = capsys.readouterr().err
    assert said.startswith(f"hadr {name}: error: {told}")
    assert said.count("\n") == 1


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("import pots", "hadr brew: error: this installation lacks the module 'pots'\n"),
        ("from json import pots", "hadr brew: error: cannot import name 'pots' from 'json'"),
        ("import hadr.pots", "hadr brew: this is a bug in hadr: "),
        ("from hadr.camera import pots", "hadr brew: this is a bug in hadr: "),
    ],
)
def test_what_is_not_installed_is_one_sentence_and_what_hadr_lacks_is_a_bug(
    line, told, tmp_path, capsys, monkeypatch
) -> None:
    (tmp_path / "brewing.py").write_text(line)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setitem(COMMANDS, "brew", ("brewing", "make tea"))
    bug = "bug" in told
    assert main(["brew"]) == (1 if bug else 2)
    error = capsys.readouterr().err
    assert error.startswith("Traceback" if bug else told)
    assert told in error


@pytest.mark.parametrize("line", ["restore --out=", "train --out ", "book --build  "])
def test_an_empty_name_is_no_place(line, capsys, monkeypatch, tmp_path) -> None:
    monkeypatch.chdir(tmp_path)
    command, *given = line.split(" ", 2)
    required = words(tmp_path)[1:-2] if command == "restore" else []
    with pytest.raises(SystemExit) as left:
        main([command, *required, *given])
    assert left.value.code == 2
    assert "expected a name or value, got an empty one" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("columns", [80, 120])
@pytest.mark.parametrize("name", COMMANDS)
def test_help_is_a_manual(name, columns, capsys, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    with pytest.raises(SystemExit) as left:
        main([name, "--help"])
    assert left.value.code == 0
    shown = capsys.readouterr().out
    assert shown.startswith(f"usage: hadr {name}")
    assert re.search(rf"^examples\n(  \S.*\n)?  +hadr {name} ", shown, re.MULTILINE)
    assert "\nexit status\n  0 done" in shown
    assert not re.search(r"``|default: (unset|None|False)?\)|\b(STR|PATH)\b|^\w+ options", shown)
    assert max(map(len, shown.splitlines())) <= columns


def test_the_list_of_commands_names_all(capsys) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    shown = capsys.readouterr().out
    assert all(f"  {name} " in shown for name in COMMANDS)


def test_help_imports_nothing_heavy() -> None:
    heavy = "torch matplotlib pandas trimesh transformers nbformat mujoco"
    code = (
        "import sys\nfrom hadr.cli import COMMANDS, command_parser\n"
        f"for name in COMMANDS:\n  command_parser(name)\n"
        f"  print(name, {set(heavy.split())} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [f"{name} set()" for name in COMMANDS]


def test_no_child_of_a_command_imports_from_the_current_folder(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("PYTHONSAFEPATH", "")
    monkeypatch.setattr(sys, "argv", ["hadr", "--version"])
    with pytest.raises(SystemExit):
        main()
    (tmp_path / "planted.py").write_text("")
    done = subprocess.run(
        [sys.executable, "-c", "import planted"], cwd=tmp_path, capture_output=True, text=True
    )
    assert "ModuleNotFoundError: No module named 'planted'" in done.stderr


def test_wrong_calls(capsys) -> None:
    with pytest.raises(SystemExit) as left:
        main(["restor"])
    assert left.value.code == 2
    error = capsys.readouterr().err
    assert "there is no command 'restor'; did you mean 'restore'?" in error
    with pytest.raises(SystemExit) as left:
        main(["restore", "--rgb", "a.png"])
    assert left.value.code == 2
    error = capsys.readouterr().err
    assert error == (
        "hadr restore: error: the following arguments are required: --depth, --intrinsics, --out "
        "(see hadr restore --help)\n"
    )
    with pytest.raises(SystemExit) as left:
        main(["--version"])
    assert left.value.code == 0
    assert capsys.readouterr().out == f"hadr {__version__}\n"
    assert main([]) == 2
    assert "usage: hadr COMMAND" in capsys.readouterr().out


@dataclass(frozen=True)
class Leaves:
    """What is brewed."""

    kind: Literal["green", "black"] = "green"
    """The tea."""


@dataclass(frozen=True)
class Options:
    """Make tea.

    Two lines of prose that are
    filled to the width.
    """

    pot: tyro.conf.Positional[str]
    """Which pot."""
    minutes: float | None = None
    """How long, minutes; 90 % of it."""
    sweet: bool = False
    """With sugar."""
    leaves: tyro.conf.OmitArgPrefixes[Leaves] = field(default_factory=Leaves)


EPILOG = """
examples
  hadr brew blue --minutes 3"""


def run(options: Options) -> int:
    print(options)
    return 7


def test_a_command_of_options(capsys, monkeypatch) -> None:
    monkeypatch.setitem(COMMANDS, "brew", (__name__, "make tea"))
    assert main(["brew", "blue", "--minutes", "3", "--sweet", "--kind", "black"]) == 7
    assert capsys.readouterr().out == f"{Options('blue', 3.0, True, Leaves('black'))}\n"
    assert main(["brew", "blue"]) == 7
    assert capsys.readouterr().out == f"{Options('blue')}\n"

    with pytest.raises(SystemExit) as left:
        main(["brew", "--help"])
    assert left.value.code == 0
    shown = capsys.readouterr().out
    assert shown.startswith(
        "usage: hadr brew POT [options]\n\nMake tea.\n\nTwo lines of prose that are filled"
    )
    assert "\nwhat is brewed:\n  --kind" in shown
    assert "--minutes FLOAT" in shown
    assert "How long, minutes; 90 % of it.\n" in shown
    assert "--kind {green,black}" in shown
    assert shown.endswith("hadr brew blue --minutes 3\n")
    assert max(len(line) for line in shown.splitlines()) <= 80

    for words, said in (
        (["blue", "--minutes", "a"], "argument --minutes: invalid float value: 'a'"),
        (["blue", "--minutes", "None"], "argument --minutes: invalid float value: 'None'"),
        (
            ["blue", "--kind", "blck"],
            "argument --kind: invalid choice: 'blck' (choose from green, black); "
            "did you mean 'black'?",
        ),
        (["--minuts", "3"], "there is no option '--minuts'; did you mean '--minutes'?"),
        (["--xyzzy=3"], "there is no option '--xyzzy'"),
        (["blue", "red"], "unrecognized arguments: red"),
        ([], "the following arguments are required: POT"),
    ):
        with pytest.raises(SystemExit) as left:
            main(["brew", *words])
        assert left.value.code == 2
        error = capsys.readouterr().err.replace("'green', 'black'", "green, black")  # Python 3.11
        assert error == f"hadr brew: error: {said} (see hadr brew --help)\n"

    parser = command_parser("brew")
    assert parser.epilog == EPILOG.strip()
    told = {action.dest: action.help for action in parser._actions}
    assert told["minutes"] == "How long, minutes; 90 %% of it."
    assert told["kind"] == "The tea. (default: green)"


def test_errors_in_a_real_process_have_no_traceback(frame) -> None:
    line = words(frame, depth=frame / "gone.png")
    done = subprocess.run([sys.executable, "-m", "hadr.cli", *line], capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr == f"hadr restore: error: depth file {frame / 'gone.png'} does not exist\n"
    assert not (frame / "out").exists()


def test_a_real_frame_of_glass(realdata, tmp_path, capsys) -> None:
    """The command on a real D435 frame at 1280x720."""
    folder, scene = realdata / "cleargrasp_d435", "000000080"
    line = words(
        folder,
        rgb=folder / f"{scene}-transparent-rgb-img.jpg",
        depth=folder / f"{scene}-transparent-depth-img.exr",
        intrinsics=folder / "camera_intrinsics.yaml",
        mask=folder / f"{scene}-mask.png",
        truth=folder / f"{scene}-opaque-depth-img.exr",
        out=tmp_path / "out",
    )
    assert main(line) == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    row = report["errors_in_mask"]["measured"]
    assert row["pixels"] == 55288
    assert row["rmse_m"] == pytest.approx(0.060429, abs=5.1e-7)  # that of its raw depth
    assert "the result is nearest valid depth, not HADR" in capsys.readouterr().out

    before = read_depth(folder / f"{scene}-transparent-depth-img.exr")
    after = np.load(tmp_path / "out" / "depth.npy")
    mask = read_mask(folder / f"{scene}-mask.png")
    assert after.shape == (720, 1280)
    np.testing.assert_array_equal(after[~mask], before[~mask])
    assert (after[mask] > 0).all()
    cloud = trimesh.load(tmp_path / "out" / "cloud.ply")
    assert len(cloud.vertices) == (after > 0).sum()
    low, high = cloud.bounds
    assert low[2] > 0.25
    assert high[2] < 1.2
    u = 921 * cloud.vertices[:, 0] / cloud.vertices[:, 2] + 642
    assert u.min() == pytest.approx(0, abs=3)
    assert u.max() == pytest.approx(1279, abs=3)
