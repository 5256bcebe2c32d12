"""`hadr hand-model` on wheels of a few bytes; neither the package index nor MediaPipe is needed."""

import hashlib
import subprocess
import zipfile
from pathlib import Path

import pytest

from hadr.models.hand import hand_model_command as command
from hadr.models.hand.hand_model_command import Options, is_hand_model, run, write_hand_model

PALM = "mediapipe/modules/palm_detection/palm_detection_full.tflite"
LANDMARKS = "mediapipe/modules/hand_landmark/hand_landmark_full.tflite"


@pytest.fixture(autouse=True)
def small_networks(monkeypatch: pytest.MonkeyPatch) -> None:
    """The networks are two words, and their checksums those of the words."""
    parts = {
        "hand_detector.tflite": (PALM, hashlib.sha256(b"palms").hexdigest()),
        "hand_landmarks_detector.tflite": (LANDMARKS, hashlib.sha256(b"landmarks").hexdigest()),
    }
    monkeypatch.setattr(command, "PARTS", parts)


def wheel(folder: Path, **changed: bytes) -> Path:
    """A wheel with the two networks and something else; `changed` replaces or removes content."""
    path = folder / "mediapipe-0.10.21-py3-none-any.whl"
    content = {"palms": b"palms", "landmarks": b"landmarks"} | changed
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("mediapipe/__init__.py", "raise SystemExit('never run')")
        for name, place in (("palms", PALM), ("landmarks", LANDMARKS)):
            if content[name]:
                archive.writestr(place, content[name])
    return path


def pip(monkeypatch: pytest.MonkeyPatch, status: int = 0, told: str = "", **changed: bytes) -> list:
    """Stand in for pip; gives the calls that were made."""
    calls = []

    def run_instead(words: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        calls.append(words)
        (folder,) = (Path(w.removeprefix("--dest=")) for w in words if w.startswith("--dest="))
        if status == 0:
            wheel(folder, **changed)
        return subprocess.CompletedProcess(words, status, "", told)

    monkeypatch.setattr(subprocess, "run", run_instead)
    return calls


def test_only_the_two_networks_are_taken_uncompressed_and_the_same_each_time(tmp_path) -> None:
    first, second = tmp_path / "a" / "hand.task", tmp_path / "hand.task"
    for out in (first, second):
        write_hand_model(wheel(tmp_path), out)
    with zipfile.ZipFile(first) as model:
        assert {i.filename: i.compress_type for i in model.infolist()} == {
            "hand_detector.tflite": zipfile.ZIP_STORED,
            "hand_landmarks_detector.tflite": zipfile.ZIP_STORED,
        }
        assert model.read("hand_landmarks_detector.tflite") == b"landmarks"
    assert first.read_bytes() == second.read_bytes()
    assert is_hand_model(first)


def test_the_wheel_is_fetched_once_and_nothing_else_is_left(tmp_path, monkeypatch, capsys) -> None:
    calls = pip(monkeypatch)
    out = tmp_path / "hand.task"
    assert run(Options(out=str(out), version="0.10.14")) == 0
    assert is_hand_model(out)
    ((_, *words),) = calls
    assert words[:3] == ["-m", "pip", "download"]
    assert {"--no-deps", "--only-binary=:all:", "mediapipe==0.10.14"} <= set(words)
    assert "Apache-2.0" in capsys.readouterr().out
    assert run(Options(out=str(out))) == 0
    assert len(calls) == 1, "it is there already"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["hand.task"]


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"palms": b"others"}, r"palm_detection_full\.tflite in mediapipe-0\.10\.21.* SHA-256"),
        ({"landmarks": b""}, r"holds no mediapipe/modules/hand_landmark/hand_landmark_full"),
    ],
)
def test_other_networks_are_never_written(tmp_path, monkeypatch, changed, sentence) -> None:
    pip(monkeypatch, **changed)
    with pytest.raises(ValueError, match=f"{sentence}.*nothing was written"):
        run(Options(out=str(tmp_path / "hand.task")))
    assert not list(tmp_path.iterdir())


def test_a_damaged_wheel_is_named(tmp_path) -> None:
    broken = wheel(tmp_path)
    broken.write_bytes(broken.read_bytes()[:-30])
    with pytest.raises(ValueError, match=r"mediapipe-0\.10\.21.*\.whl is damaged"):
        write_hand_model(broken, tmp_path / "hand.task")
    assert not (tmp_path / "hand.task").exists()


@pytest.mark.parametrize(
    ("told", "sentence"),
    [
        ("/usr/bin/python: No module named pip", "has no pip"),
        (
            "WARNING: Retrying (Retry(total=0)) after connection broken by 'NewConnectionError'\n"
            "ERROR: No matching distribution found for mediapipe==0.10.21",
            "can't be reached; is there a network",
        ),
        ("ERROR: No matching distribution found for mediapipe==0.10.21", "has no such wheel"),
        ("ERROR: [Errno 28] No space left on device\n\n", "pip said: .*No space left"),
    ],
)
def test_what_pip_can_t_do_is_one_sentence(tmp_path, monkeypatch, told, sentence) -> None:
    pip(monkeypatch, 1, told)
    with pytest.raises(ValueError, match=f"mediapipe 0.10.21 could not be fetched: .*{sentence}"):
        run(Options(out=str(tmp_path / "hand.task")))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("content", [b"mine", b""])
def test_another_file_is_never_replaced(tmp_path, monkeypatch, content) -> None:
    calls = pip(monkeypatch)
    out = tmp_path / "hand.task"
    out.write_bytes(content)
    with pytest.raises(FileExistsError, match="is not this model; it is not replaced"):
        run(Options(out=str(out)))
    assert out.read_bytes() == content
    assert not calls, "nothing is fetched for it"
    with pytest.raises(ValueError, match="is a folder"):
        run(Options(out=str(tmp_path)))
