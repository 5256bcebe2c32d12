"""Folders whose logs contradict their pictures are refused at the door; right ones never."""

import json
import shutil

import numpy as np
import pytest

from hadr.data.folder_checks import LOOKED_AT, check_data, frame_digests
from hadr.data.frame import write_frame
from hadr.data.samples import open_gallery, samples_dir
from hadr.data.transhand import SPLITS, TransHand


@pytest.fixture
def folder(tmp_path):
    """Six frames of one object, whose files a test may change."""
    shutil.copytree(samples_dir() / "frames/test/0000", tmp_path / "data/test/0000")
    return tmp_path / "data"


def edit(folder, change):
    for path in folder.rglob("log_json/*.json"):
        log = json.loads(path.read_text())
        change(log)
        path.write_text(json.dumps(log))


def scaled(*names, by):
    def change(log):
        for name in names:
            value = log[name]
            log[name] = (
                {n: (by * np.array(p)).tolist() for n, p in value.items()}
                if isinstance(value, dict)
                else (by * np.array(value)).tolist()
            )

    return change


def test_right_folders_pass(tmp_path):
    for name in ("frames", "gallery"):
        check_data([samples_dir() / name], SPLITS)
    for frame in open_gallery()[:2]:  # as the published data set has it: 1280x720, .npy in metres
        write_frame(tmp_path, frame, normals="none", nested=False)
    check_data([tmp_path], SPLITS)


def resized(by):
    """Factors of a camera's matrix for a picture of another size."""
    return np.array([[by], [by], [1.0]])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (scaled("hand_keypoint", by=1000.0), r"keypoint is \d+ m from the wrist, .* in metres\?"),
        (scaled("hand_keypoint", "camera point", by=10.0), r"1\.\d+ m from the wrist"),
        (scaled("hand_keypoint", "camera point", by=0.1), r"0\.01\d+ m from the wrist"),
        (scaled("camera point", by=1000.0), "(all in front of it|pixels of hand|behind the depth)"),
        (scaled("depth_png scale", by=10.0), r"m before the depth at their pixels"),
        (scaled("depth_png scale", by=0.1), r"m behind the depth at their pixels"),
        (scaled("camera internal", by=resized(2.5)), r"principal point \(\d+.* outside of"),
        (scaled("camera internal", by=resized(0.5)), r"\d+ % of its hand's keypoints"),
        (scaled("camera angle", by=3.14159 / 180), "expected"),
    ],
)
def test_a_wrong_unit_or_camera_is_named(folder, change, says):
    edit(folder, change)
    with pytest.raises(ValueError, match=rf"data/test/0000: frame \d+: .*{says}"):
        check_data([folder], ["test"])


def test_swapped_masks_and_pixels_of_another_size_are_named(folder):
    frame = folder / "test/0000/depth"
    for path in (frame / "hand_kpt").iterdir():
        np.savetxt(path, np.loadtxt(path) * 224 / 1280)
    with pytest.raises(ValueError, match=r"hand_kpt lie \d+ pixels away .* pixels of 1280x720"):
        check_data([folder], ["test"])
    shutil.rmtree(frame / "hand_kpt")
    shutil.copytree(samples_dir() / "frames/test/0000/depth/hand_kpt", frame / "hand_kpt")
    check_data([folder], ["test"])
    (frame / "hand_mask").rename(frame / "aside")
    (frame / "obj_mask").rename(frame / "hand_mask")
    (frame / "aside").rename(frame / "obj_mask")
    with pytest.raises(ValueError, match=r"and 5 others looked at: .* folders of masks swapped\?"):
        check_data([folder], ["test"])


def test_a_few_frames_are_read_however_many_there_are(monkeypatch):
    read = []
    one = TransHand._read
    monkeypatch.setattr(TransHand, "_read", lambda self, files: read.append(0) or one(self, files))
    check_data([samples_dir() / "frames"], ["train", "val"])
    assert len(read) == 2 * LOOKED_AT


def test_frames_that_come_twice_are_refused(folder, tmp_path):
    frames = samples_dir() / "frames"
    with pytest.raises(ValueError, match=r"data holds 6 frames of the folders named before it"):
        check_data([frames, folder], ["test"])
    check_data([frames, folder], ["train"])
    moved = tmp_path / "moved"  # under other names and in another split
    for path in (folder / "test/0000/depth").rglob("*.*"):
        place = moved / "val/0000" / path.parent.name / f"1{path.name}"
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, place)
    with pytest.raises(ValueError, match=r"moved holds 6 frames .* they would count twice"):
        check_data([frames, moved], ["val", "test"])
    shutil.copytree(folder / "test", folder / "val", dirs_exist_ok=True)
    with pytest.raises(ValueError, match=r"data/test holds 6 frames of a split named before it"):
        check_data([folder], ["val", "test"])


def test_a_split_without_a_frame_is_named(folder):
    shutil.rmtree(folder / "test/0000")
    with pytest.raises(ValueError, match="data/test holds no frame"):
        check_data([folder], ["train", "test"])


def test_a_frames_digest_is_of_its_content(folder):
    before = frame_digests(TransHand(folder, "test"))
    assert len(set(before)) == 6
    assert before == frame_digests(TransHand(samples_dir() / "frames", "test", ["0000"]))
    path = next((folder / "test/0000/depth/hand_kpt").iterdir())
    path.write_text(path.read_text().replace("1", "2", 1))
    after = frame_digests(TransHand(folder, "test"))
    assert sum(one != other for one, other in zip(before, after, strict=True)) == 1
