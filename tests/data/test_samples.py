from collections import Counter

import numpy as np
import pytest

from hadr.camera import back_project, project, transform_points
from hadr.data.samples import (
    open_gallery,
    open_known_unknown,
    open_samples,
    samples_dir,
    verify_manifest,
    write_manifest,
)
from hadr.synthesis.generation.settings import PRESETS
from hadr.synthesis.glass.distance import signed_distance
from hadr.synthesis.glass.objects import glass_object
from hadr.synthesis.recordings.recording import find_recordings


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


def test_what_is_not_there_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv("HADR_SAMPLES", str(tmp_path))
    with pytest.raises(FileNotFoundError, match="make it with 'hadr generate --preset gallery"):
        open_gallery()
    with pytest.raises(FileNotFoundError, match="has no folder 'train'"):
        open_known_unknown()


EIGHT = {"0000", "0001", "0004", "0005", "0006", "0007", "0008", "0009"}


@pytest.fixture(scope="module")
def splits():
    if not (samples_dir() / "frames/generation.json").is_file():
        pytest.skip("no generation.json: make the frames with `hadr generate --preset samples`")
    return {name: open_samples(name) for name in ("train", "val", "test")}


def test_the_bundled_files_are_unchanged(splits):
    report = verify_manifest()
    assert report.ok, (report.changed, report.missing)
    assert not report.unlisted
    assert report.checked > 480 * 9


def test_everything_fits_into_a_clone():
    root = samples_dir()
    files = {p.relative_to(root): p.stat().st_size for p in root.rglob("*") if p.is_file()}
    weights = {p: size for p, size in files.items() if p.parts[0] == "checkpoints"}
    assert sum(files.values()) - sum(weights.values()) < 40e6
    assert 0 < sum(weights.values()) < 45e6


def test_sixty_frames_of_each_object_split_seven_two_one_by_pose(splits):
    for name, number in (("train", 42), ("val", 12), ("test", 6)):
        counts = Counter(splits[name].object_ids)
        assert set(counts) == EIGHT
        assert set(counts.values()) == {number}
    holds = {name: set(frames.hold_ids) for name, frames in splits.items()}
    assert sum(map(len, holds.values())) == 240
    assert not holds["train"] & holds["test"]
    assert not holds["train"] & holds["val"]
    assert not holds["val"] & holds["test"]


def test_each_frame_shows_a_bundled_recording(splits):
    recorded = {p.stem for p in find_recordings(samples_dir() / "recordings")}
    for frames in splits.values():
        assert set(frames.hold_ids) <= recorded


def test_the_known_and_the_unknown_objects(splits):
    parts = open_known_unknown()
    counts = {"train": 6 * 42, "val": 6 * 12, "known": 6 * 6, "unknown": 2 * 60}
    assert {name: len(frames) for name, frames in parts.items()} == counts
    assert set(parts["unknown"].object_ids) == {"0004", "0007"}
    holds = {name: set(frames.hold_ids) for name, frames in parts.items()}
    assert sum(map(len, holds.values())) == len(set().union(*holds.values())) == 240


@pytest.mark.parametrize("every", [5, pytest.param(1, marks=pytest.mark.long)])
def test_each_bundled_frame_is_whole(splits, every):
    """Pictures, masks, keypoints, depth and pose of a frame agree with one another."""
    missing, hand_error = [], []
    for frame in (f for frames in splits.values() for f in frames[::every]):
        name = f"frame {frame.stem}"
        recipe = PRESETS["samples"].settings.recipe(int(frame.stem))
        assert (frame.object_id, frame.split) == (recipe.object_id, recipe.split), name
        assert frame.color.shape == (180, 320, 3), name
        assert frame.color.std() > 12, name
        assert frame.depth[frame.hand_mask | frame.object_mask].min() > 0.1, name
        assert 0.003 < frame.object_mask.mean() < 0.25, name
        assert frame.hand_mask.mean() > 0.004, name
        assert not (frame.object_mask & frame.hand_mask).any(), name
        behind = frame.background_depth[frame.object_mask]
        assert (behind[behind > 0] >= frame.depth[frame.object_mask][behind > 0] - 1e-4).all()
        np.testing.assert_allclose(
            frame.keypoints_uv, project(frame.keypoints, frame.camera), atol=1e-3
        )
        known = frame.normals.any(-1)
        np.testing.assert_array_equal(known, frame.object_mask, err_msg=name)
        points = back_project(np.where(frame.object_mask, frame.depth, np.nan), frame.camera)
        # Toward the viewer, to the precision of eight bits.
        assert (frame.normals * points / frame.depth[..., None])[known].sum(-1).max() < 0.02, name
        camera_from_object = frame.camera_from_world @ frame.world_from_object
        glass = transform_points(np.linalg.inv(camera_from_object), points[known][::7])
        distance = signed_distance(glass_object(frame.object_id), glass)
        assert np.abs(distance).max() < 1.5e-3, name
        missing.append((frame.raw_depth[frame.object_mask] == 0).mean())
        seen = frame.hand_mask & (frame.raw_depth > 0)
        hand_error.append(np.median(np.abs(frame.raw_depth - frame.depth)[seen]))
    # A depth camera sees the hand to some millimetres and misses much of the glass.
    assert np.nanmedian(hand_error) < 0.004
    assert 0.2 < np.mean(missing) < 0.9


def test_the_gallery(splits):
    frames = open_gallery()
    assert len(frames) >= 12
    assert {f.color.shape for f in frames} == {(720, 1280, 3)}
    assert set(frames.object_ids) == EIGHT
    assert not set(frames.hold_ids) & {None}
    assert all(f.raw_depth is not None for f in frames)
