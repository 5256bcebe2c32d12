import numpy as np
import pytest

from hadr.camera import project
from hadr.data.samples import open_samples, samples_dir, verify_manifest, write_manifest
from hadr.synthesis.generate import frame_recipe


def test_manifest_finds_a_changed_a_missing_and_a_new_file(tmp_path):
    for name in ("a.bin", "b/c.bin", "d.bin"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(name.encode())
    write_manifest(tmp_path)
    report = verify_manifest(tmp_path)
    assert report.ok
    assert report.checked == 3
    data = bytearray((tmp_path / "b/c.bin").read_bytes())
    data[0] ^= 1
    (tmp_path / "b/c.bin").write_bytes(data)
    (tmp_path / "d.bin").unlink()
    (tmp_path / "new.bin").write_bytes(b"")
    report = verify_manifest(tmp_path)
    assert not report.ok
    assert report.changed == ("b/c.bin",)
    assert report.missing == ("d.bin",)
    assert report.unlisted == ("new.bin",)
    assert report.checked == 1


def test_no_manifest_is_an_error(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"no manifest\.json in"):
        verify_manifest(tmp_path)


def test_the_environment_names_another_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("HADR_SAMPLES", str(tmp_path))
    assert samples_dir() == tmp_path
    monkeypatch.setenv("HADR_SAMPLES", str(tmp_path / "none"))
    with pytest.raises(
        FileNotFoundError, match=r"HADR_SAMPLES names .*none', which is not a folder"
    ):
        samples_dir()


@pytest.fixture(scope="module")
def splits():
    return {name: open_samples(name) for name in ("train", "val", "test")}


def test_the_bundled_frames_are_unchanged():
    report = verify_manifest()
    assert report.ok, (report.changed, report.missing)
    assert report.checked >= 64 * 7


def test_at_least_64_frames_of_eight_objects_and_no_pose_in_two_splits(splits):
    assert sum(map(len, splits.values())) >= 64
    for frames in splits.values():
        assert set(frames.object_ids) == {
            "0000",
            "0001",
            "0004",
            "0005",
            "0006",
            "0007",
            "0008",
            "0009",
        }
    holds = {name: set(frames.hold_ids) for name, frames in splits.items()}
    assert None not in holds["train"]
    assert not holds["train"] & holds["test"]
    assert not holds["train"] & holds["val"]
    assert not holds["val"] & holds["test"]


def test_each_bundled_frame_is_whole(splits):
    for frames in splits.values():
        for frame in frames:
            assert frame.color.shape == (252, 448, 3)
            assert frame.color.std() > 15
            assert frame.depth.min() > 0.2
            assert 0.004 < frame.object_mask.mean() < 0.25
            assert frame.hand_mask.mean() > 0.004
            assert not (frame.object_mask & frame.hand_mask).any()
            assert frame.background_depth is not None
            assert (frame.background_depth >= frame.depth - 1e-4).all()
            np.testing.assert_allclose(
                frame.keypoints_uv, project(frame.keypoints, frame.camera), atol=1e-3
            )
            recipe = frame_recipe(int(frame.stem))
            assert frame.object_id == recipe.object_id
            assert frame.split == recipe.split
