"""The reader and the writer of TransHand-14K's layout, and a frame made by hand in its form."""

import io
import json
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hadr.camera import TRANSHAND_CAMERA, project
from hadr.data.camera_log import camera_log, camera_pose
from hadr.data.frame import Frame, write_frame
from hadr.data.frame_pictures import DisparityScale, encode_depth_array
from hadr.data.transhand import TransHand

W, H = 64, 36
CAMERA = TRANSHAND_CAMERA.resized(W, H)


def make_frame(
    stem="000007", object_id="0004", split="train", seed=0, background=False, more=False
) -> Frame:
    rng = np.random.default_rng(seed)
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xyz", rng.uniform(-1, 1, 3)).as_matrix()
    pose[:3, 3] = rng.normal(size=3)
    keypoints = rng.normal(size=(21, 3)) * 0.05 + [0, 0, 0.7]
    mask = rng.random((H, W)) < 0.2
    depth = rng.uniform(0.3, 4.0, (H, W)).astype(np.float32)
    return Frame(
        stem,
        object_id,
        split,
        rng.integers(0, 256, (H, W, 3), dtype=np.uint8),
        depth,
        (rng.random((H, W)) < 0.2) & ~mask,
        mask,
        keypoints,
        project(keypoints, CAMERA),
        CAMERA,
        pose,
        np.where(mask, depth + 0.5, depth).astype(np.float32) if background else None,
        "0004-stem-0001",
        *(_more(rng) if more else ()),
    )


def _more(rng):
    """Raw depth with holes, normals with unknown ones, the object's pose."""
    raw = rng.uniform(0.0, 4.0, (H, W)).astype(np.float32)
    raw[rng.random((H, W)) < 0.3] = 0
    normals = rng.normal(size=(H, W, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    normals[rng.random((H, W)) < 0.3] = 0
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
    pose[:3, 3] = rng.normal(size=3)
    return raw, normals.astype(np.float32), pose


def refused(root, said, **how):
    """The first frame can't be read, in these words."""
    with pytest.raises(ValueError, match=said):
        TransHand(root, "train", **how)[0]


@settings(max_examples=20)
@given(
    st.integers(0, 2**32 - 1),
    st.booleans(),
    st.sampled_from(["npy", "png"]),
    st.sampled_from([None, 95]),
    st.sampled_from(["obj_mask", "object_mask"]),
)
def test_every_frame_comes_back_to_the_stored_precision(seed, nested, form, quality, object_folder):
    frame = make_frame(seed=seed, background=True, more=True)
    form = {"nested": nested, "object_folder": object_folder, "depth_format": form}
    with tempfile.TemporaryDirectory() as folder:
        write_frame(folder, frame, **form, jpeg_quality=quality)
        assert (Path(folder) / "train" / "0004" / "depth").is_dir() == nested
        frames = TransHand(folder, "train")
        assert len(frames) == 1
        read = frames[0]
        left = [p.name for p in Path(folder).iterdir()]
        assert not list(Path(folder).rglob("*.part*"))
    assert left == ["train"]  # nothing unfinished
    if quality is None:
        np.testing.assert_array_equal(read.color, frame.color)
    exact = form["depth_format"] == "npy"
    np.testing.assert_allclose(read.depth, frame.depth, atol=0 if exact else 5.1e-5)
    np.testing.assert_array_equal(read.hand_mask, frame.hand_mask)
    np.testing.assert_array_equal(read.object_mask, frame.object_mask)
    np.testing.assert_allclose(read.keypoints_uv, frame.keypoints_uv, atol=1e-4)
    assert (read.stem, read.object_id, read.split) == ("000007", "0004", "train")
    assert read.hold_id == "0004-stem-0001"
    np.testing.assert_allclose(read.raw_depth, frame.raw_depth, atol=0.501e-3)
    np.testing.assert_array_equal(read.raw_depth == 0, frame.raw_depth < 0.5e-3)
    np.testing.assert_allclose(read.background_depth, frame.background_depth, atol=5.1e-5)
    np.testing.assert_array_equal(
        read.background_depth[~frame.object_mask], read.depth[~frame.object_mask]
    )
    unknown = ~frame.normals.any(-1)
    assert not read.normals[unknown].any()
    cosine = (read.normals * frame.normals).sum(-1)[~unknown]
    assert np.rad2deg(np.arccos(cosine.clip(-1, 1))).max() < 0.5
    np.testing.assert_allclose(np.linalg.norm(read.normals[~unknown], axis=-1), 1, atol=1e-6)
    np.testing.assert_allclose(read.world_from_object, frame.world_from_object, atol=1e-9)
    np.testing.assert_allclose(read.world_from_camera, frame.world_from_camera, atol=2e-9)
    np.testing.assert_allclose(read.keypoints, frame.keypoints, atol=2e-7)
    for name in ("depth", "background_depth", "raw_depth", "normals"):
        assert getattr(read, name).dtype == np.float32
    assert read.camera == frame.camera


@pytest.mark.parametrize("step", [1 / 16, 1 / 32])
def test_a_stereo_cameras_depth_is_stored_as_disparity_without_loss(tmp_path, step):
    """Every whole step from 0.25 m to 4 m: z = f b / d, rounded to millimetres."""
    scale = DisparityScale(425 * 0.05, step, 0.001)
    first, last = int(21.25 / 4.0 / step) + 1, int(21.25 / 0.25 / step)
    steps = np.resize(np.arange(first, last + 1), H * W)
    depth = np.round(21.25 / (steps * step), 3).astype(np.float32).reshape(H, W)
    depth[:3] = 0
    write_frame(tmp_path, replace(make_frame(), raw_depth=depth), raw_scale=scale)
    base = tmp_path / "train/0004/depth"
    assert not (base / "raw_depth").exists()
    np.testing.assert_array_equal(TransHand(tmp_path, "train")[0].raw_depth, depth)
    with pytest.raises(ValueError, match=r"depth is up to 0\.00\d+ m away from what Disparity"):
        write_frame(tmp_path, replace(make_frame(), raw_depth=depth + 2e-4), raw_scale=scale)
    path = base / "log_json/000007.json"
    log = json.loads(path.read_text())
    assert log["raw_disparity scale"] == {"focal_baseline": 21.25, "step": step, "unit": 0.001}
    log["raw_disparity scale"] = {"focal_baseline": 21.25, "step": 0, "unit": 0.001}
    path.write_text(json.dumps(log))
    refused(tmp_path, r"frame 000007: .*disparity scale must be positive")
    del log["raw_disparity scale"]
    path.write_text(json.dumps(log))
    refused(tmp_path, r"_disparity scale': must be named values, got None")


def test_disparities_round_to_whole_steps_and_farther_away_to_double_ones():
    scale = DisparityScale(20.0, 0.125, 0.001)
    depth = np.array([[0.0, 0.5, 0.501, 1.98, 2.04, 2.5]], np.float32)
    # 20 / 0.125 = 160 steps at 1 m: 320, 319.4, 80.8, 78.4 and 64 steps.
    np.testing.assert_allclose(
        scale.nearest(depth), [[0, 0.5, 0.502, 1.975, 2.051, 2.5]], atol=1e-6
    )
    np.testing.assert_allclose(
        scale.nearest(depth, double_beyond=1.0), [[0, 0.5, 0.502, 2.0, 2.051, 2.5]], atol=1e-6
    )


@pytest.mark.parametrize(
    ("part", "value", "message"),
    [
        ("depth", np.full((H, W), 500, np.uint16), "depth must be float metres, got uint16"),
        ("color", np.zeros((H, W, 3), np.float32), "color must be uint8 RGB, got float32"),
        ("object_mask", np.full((H, W), 255, np.uint8), "object_mask must be bool, got uint8"),
        ("keypoints", np.full((21, 3), np.nan), "keypoints must be finite"),
        ("depth", np.zeros((H, 3), np.float32), "depth has shape"),
    ],
)
def test_what_could_not_be_read_again_is_not_written(tmp_path, part, value, message):
    with pytest.raises(ValueError, match=message):
        write_frame(tmp_path / "new", replace(make_frame(), **{part: value}))
    assert not (tmp_path / "new").exists()


def test_what_is_not_held_may_be_stored_coarsely(tmp_path):
    frame = make_frame()
    write_frame(tmp_path, frame, rest_step=0.001, depth_format="png")
    read = TransHand(tmp_path, "train")[0].depth
    held = frame.hand_mask | frame.object_mask
    assert np.abs(read - frame.depth)[held].max() <= 5.1e-5
    assert 4e-4 < np.abs(read - frame.depth)[~held].max() <= 5.1e-4
    np.testing.assert_allclose(read[~held] * 1000, np.rint(read[~held] * 1000), atol=1e-3)


@pytest.mark.parametrize("kept", ["all", "held", "object", "none"])
def test_where_normals_are_kept(tmp_path, kept):
    frame = make_frame(more=True)
    write_frame(tmp_path, frame, normals=kept)
    read = TransHand(tmp_path, "train")[0]
    if kept == "none":
        assert read.normals is None
        assert not (tmp_path / "train/0004/depth/normals").exists()
        return
    held = frame.hand_mask | frame.object_mask
    where = {"all": np.ones_like(held), "held": held, "object": frame.object_mask}[kept]
    np.testing.assert_array_equal(read.normals.any(-1), frame.normals.any(-1) & where)


def test_background_depth_is_stored_behind_the_glass_alone(tmp_path):
    frame = make_frame(background=True)
    write_frame(tmp_path, frame)
    stored = cv2.imread(
        str(tmp_path / "train/0004/depth/background_depth_png/000007.png"), cv2.IMREAD_UNCHANGED
    )
    np.testing.assert_array_equal(stored > 0, frame.object_mask)
    steps = np.round(frame.background_depth[frame.object_mask] / 0.0001)
    np.testing.assert_allclose(stored[frame.object_mask], steps, atol=1)


def authors_frame(root, stems=("0001",), channels=3):
    """A frame in the authors' form, its numbers worked out by hand.

    Blender's camera stands at (0, 0, 2) and is not turned: it looks down the world's -z, y up.
    The world point (0.1, 0.2, 1.5) then is 0.5 m ahead, 0.1 right and 0.2 up.
    """
    base = root / "test" / "0000" / "depth"
    for name in ("rgb", "depth_np", "hand_mask", "obj_mask", "log_json", "hand_kpt"):
        (base / name).mkdir(parents=True, exist_ok=True)
    blue = np.zeros((720, 1280, 3), np.uint8)
    blue[..., 0] = 200  # OpenCV writes BGR
    for stem in stems:
        cv2.imwrite(str(base / "rgb" / f"{stem}.png"), blue)
        depth = np.full((720, 1280, channels), 9.0)
        depth[..., 0] = 0.75
        depth[0, 0, 0], depth[0, 1, 0] = np.inf, np.nan
        np.save(base / "depth_np" / f"{stem}.npy", depth)
        for name in ("hand_mask", "obj_mask"):
            mask = np.zeros((720, 1280), np.uint8)
            mask[: 10 if name == "hand_mask" else 0] = 255
            cv2.imwrite(str(base / name / f"{stem}.png"), mask)
        points = {f"bone_{i}": [0.1, 0.2, 1.5 - 0.01 * i] for i in range(25)}
        log = {
            "camera point": [0, 0, 2.0],
            "camera angle": [0.0, 0.0, 0.0],
            "hand_keypoint": points,
            "camera internal": [[1137.7778, 0, 640], [0, 1137.7778, 360], [0, 0, 1]],
        }
        (base / "log_json" / f"{stem}.json").write_text(json.dumps(log))
        lines = "".join(f"{100 + i} {50.5 + i}\n" for i in range(21))
        (base / "hand_kpt" / f"{stem}.txt").write_text(lines)
    return base


def test_a_frame_in_the_authors_form(tmp_path):
    authors_frame(tmp_path)
    frame = TransHand(tmp_path, "test")[0]
    assert frame.keypoints.shape == (21, 3)
    np.testing.assert_allclose(frame.keypoints[0], [0.1, -0.2, 0.5], atol=1e-12)
    np.testing.assert_allclose(frame.keypoints[20], [0.1, -0.2, 0.7], atol=1e-12)
    np.testing.assert_allclose(frame.color[5, 5], [0, 0, 200])
    assert frame.depth.dtype == np.float32
    np.testing.assert_allclose(frame.depth[0, :3], [0, 0, 0.75])
    assert frame.hand_mask.sum() == 12800
    assert frame.camera.cx == 640
    np.testing.assert_allclose(frame.keypoints_uv[3], [103, 53.5])
    assert frame.background_depth is None
    assert frame.world_from_object is None
    assert frame.hold_id is None


@settings(max_examples=50)
@given(
    st.tuples(*[st.floats(-5, 5)] * 3),
    st.tuples(st.floats(-179, 179), st.floats(-89, 89), st.floats(-179, 179)),
)
def test_euler_angles_are_rz_ry_rx_and_round_trip(point, angle):
    x, y, z = np.deg2rad(angle)
    rx = np.array([[1, 0, 0], [0, np.cos(x), -np.sin(x)], [0, np.sin(x), np.cos(x)]])
    ry = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
    rz = np.array([[np.cos(z), -np.sin(z), 0], [np.sin(z), np.cos(z), 0], [0, 0, 1]])
    pose = camera_pose(point, angle)
    np.testing.assert_allclose(pose[:3, :3], rz @ ry @ rx @ np.diag([1, -1, -1]), atol=1e-9)
    np.testing.assert_allclose(camera_pose(*camera_log(pose)), pose, atol=1e-9)


def test_frames_are_listed_by_object_and_sliced(tmp_path):
    for stem, object_id in (("b", "0001"), ("a", "0001"), ("c", "0000")):
        write_frame(tmp_path, make_frame(stem, object_id))
    frames = TransHand(tmp_path, "train")
    assert [f.stem for f in frames.files] == ["c", "a", "b"]
    assert frames.object_ids == ["0000", "0001", "0001"]
    assert [f.stem for f in frames[1:]] == ["a", "b"]
    assert [f.stem for f in TransHand(tmp_path, "train", ["0001"]).files] == ["a", "b"]
    assert frames.hold_ids == ["0004-stem-0001"] * 3
    assert frames[-1].stem == "b"
    with pytest.raises(IndexError):
        frames[3]


def test_the_frame_that_lacks_a_file_is_named(tmp_path):
    for stem in ("000001", "000002"):
        write_frame(tmp_path, make_frame(stem))
    (tmp_path / "train/0004/depth/hand_mask/000002.png").unlink()
    refused(tmp_path, r"train/0004: frame 000002 lacks depth/hand_mask")
    refused(tmp_path, r"different numbers of files: .*'hand_mask': 1", pair_by="order")


@pytest.mark.parametrize("folder", ["background_depth_png", "raw_depth", "normals"])
def test_a_frame_that_lacks_what_the_others_have_is_named(tmp_path, folder):
    for stem in ("000001", "000002"):
        write_frame(tmp_path, make_frame(stem, background=True, more=True))
    (tmp_path / "train/0004/depth" / folder / "000001.png").unlink()
    refused(tmp_path, f"train/0004: frame 000001 lacks depth/{folder}")
    shutil.rmtree(tmp_path / "train/0004/depth" / folder)
    assert len(TransHand(tmp_path, "train")) == 2


def test_a_second_file_of_a_frame_is_named(tmp_path):
    write_frame(tmp_path, make_frame())
    rgb = tmp_path / "train/0004/depth/rgb"
    shutil.copy(rgb / "000007.png", rgb / "000007.jpg")
    refused(tmp_path, r"frame 000007 has two files, 000007\.png and 000007\.jpg")
    for file in list(rgb.parent.glob("*/000007.*")):
        if file.parent != rgb:
            shutil.copy(file, file.with_stem("000008"))
    refused(tmp_path, r"rgb has two pictures for one frame, '000007'", pair_by="order")


def test_a_split_that_is_named_twice_would_count_twice(tmp_path):
    write_frame(tmp_path, make_frame())
    with pytest.raises(ValueError, match="split 'train' is named twice"):
        TransHand(tmp_path, ["train", "train"])


BROKEN = {
    "cut off": lambda data: data[: len(data) * 2 // 3],
    "empty": lambda data: b"",
    "not a picture": lambda data: b"not a picture at all",
}


@pytest.mark.parametrize("damage", BROKEN)
@pytest.mark.parametrize(
    "folder",
    ["rgb", "depth_png", "obj_mask", "hand_mask", "raw_depth", "normals", "background_depth_png"],
)
def test_a_broken_picture_is_named(tmp_path, folder, damage):
    frame = make_frame(background=True, more=True)
    write_frame(tmp_path, frame, depth_format="png", jpeg_quality=90)
    path = next((tmp_path / "train/0004/depth" / folder).iterdir())
    path.write_bytes(BROKEN[damage](path.read_bytes()))
    frames = TransHand(tmp_path, "train")  # files are opened when a frame is asked for
    reason = "cut off after|file is empty|neither PNG nor JPEG"
    with pytest.raises(ValueError, match=rf"frame 000007: .*{folder}/{path.name}: .*({reason})"):
        frames[0]


def test_a_grey_picture_is_no_colour_picture(tmp_path):
    write_frame(tmp_path, make_frame())
    path = next((tmp_path / "train/0004/depth/rgb").iterdir())
    path.write_bytes(cv2.imencode(path.suffix, np.full((H, W), 7, np.uint8))[1].tobytes())
    refused(tmp_path, rf"{path.name}: a colour picture has three channels")


def test_other_broken_files_are_named(tmp_path):
    write_frame(tmp_path, make_frame(more=True))
    base = tmp_path / "train/0004/depth"
    frames = TransHand(tmp_path, "train")

    def check(name, data, message):
        before = (base / name).read_bytes()
        (base / name).write_bytes(data)
        with pytest.raises(ValueError, match=rf"frame 000007: .*{name}.*{message}"):
            frames[0]
        (base / name).write_bytes(before)

    npy = (base / "depth_np/000007.npy").read_bytes()
    check("depth_np/000007.npy", npy[:2000], "cut off or damaged")
    check("depth_np/000007.npy", b"", "cut off or damaged")
    check("hand_kpt/000007.txt", b"1 2\n" * 20, "holds 20 keypoints, expected 21")
    check("hand_kpt/000007.txt", b"1 nan\n" * 21, "not a finite number")
    check("hand_kpt/000007.txt", b"one two\n" * 21, "must hold 'u v'")
    check("log_json/000007.json", b'{"camera point": [0, 0', "not valid JSON")
    check("log_json/000007.json", b"\xff\xfe", "not valid JSON")
    one = cv2.imencode(".png", np.ones((H, W), np.uint8))[1].tobytes()
    check("hand_mask/000007.png", one, "must hold 0 and 255, the largest value is 1")
    deep = cv2.imencode(".png", np.ones((H, W), np.uint16))[1].tobytes()
    check("obj_mask/000007.png", deep, r"8-bit picture, got \(36, 64\) uint16")
    check("raw_depth/000007.png", one, r"16-bit PNG, got \(36, 64\) uint8")
    check("normals/000007.png", one, r"8-bit RGB picture, got \(36, 64\) uint8")
    small = cv2.imencode(".png", np.ones((9, 16), np.uint16))[1].tobytes()
    (base / "raw_depth/000007.png").write_bytes(small)
    with pytest.raises(ValueError, match=r"frame 000007: raw_depth has shape \(9, 16\)"):
        frames[0]
    (base / "raw_depth/000007.png").unlink()
    with pytest.raises(ValueError, match=r"frame 000007: .*raw_depth/000007.png"):
        frames[0]


def test_a_frame_that_cant_be_written_leaves_nothing(tmp_path, monkeypatch):
    write = Path.write_bytes

    def full(path, data):
        if path.name == "4":
            raise OSError(28, "No space left on device")
        return write(path, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OSError, match="No space left"):
        write_frame(tmp_path, make_frame())
    assert not list(tmp_path.rglob("*"))


def test_pairing_by_order_takes_other_stems(tmp_path):
    base = authors_frame(tmp_path, ("0001", "0002"))
    for path in sorted((base / "depth_np").iterdir()):
        path.rename(path.with_name(f"depth_{path.name}"))
    with pytest.raises(ValueError, match=r"pair_by='order'"):
        TransHand(tmp_path, "test")
    frames = TransHand(tmp_path, "test", pair_by="order")
    assert [f.depth.name for f in frames.files] == ["depth_0001.npy", "depth_0002.npy"]
    assert frames[1].stem == "0002"


def test_what_is_missing_is_named(tmp_path):
    write_frame(tmp_path, make_frame())
    with pytest.raises(FileNotFoundError, match="has no folder 'val'"):
        TransHand(tmp_path, "val")
    with pytest.raises(ValueError, match="split must be one of train, val, test, got 'training'"):
        TransHand(tmp_path, "training")
    with pytest.raises(FileNotFoundError, match=r"no object '0009' .* found 0004"):
        TransHand(tmp_path, "train", ["0009"])
    shutil.rmtree(tmp_path / "train/0004/depth/obj_mask")
    with pytest.raises(FileNotFoundError, match="lacks the folder obj_mask or object_mask"):
        TransHand(tmp_path, "train")


def test_a_pixel_of_hand_and_object_is_refused(tmp_path):
    frame = make_frame()
    both = frame.hand_mask.copy()
    v, u = np.argwhere(frame.object_mask)[0]
    both[v, u] = True
    write_frame(tmp_path, replace(frame, hand_mask=both))
    refused(tmp_path, r"train/0004: frame 000007: .*hand_mask.*obj_mask.* overlap in 1 pixels")


def test_wrong_shapes_are_named(tmp_path):
    write_frame(tmp_path, make_frame())
    base = tmp_path / "train/0004/depth"
    np.save(base / "depth_np/000007.npy", np.ones((H, W + 1)))
    refused(tmp_path, r"train/0004: frame 000007: depth_np has shape \(36, 65\).* \(36, 64\)")
    np.save(base / "depth_np/000007.npy", np.ones((H, W), np.uint16))
    refused(tmp_path, r"float metres, got \(36, 64\) uint16")


def edit_log(tmp_path, **changes):
    path = tmp_path / "train/0004/depth/log_json/000007.json"
    log = json.loads(path.read_text())
    for key, value in changes.items():
        key = key.replace("camera_", "camera ")
        if value is None:
            log.pop(key)
        else:
            log[key] = value
    path.write_text(json.dumps(log))


def test_a_log_that_lacks_a_key_is_named(tmp_path):
    write_frame(tmp_path, make_frame())
    edit_log(tmp_path, camera_point=None)
    refused(tmp_path, r"frame 000007: .*000007.json lacks the key 'camera point'; it has camera")


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("camera angle", [0, 0], r"'camera angle' must hold 3 finite numbers, got \[0, 0\]"),
        ("hand_keypoint", {"wrist": [0, 0, 0]}, ".*must name at least 21 points, got 1"),
        ("camera point", "x", "'camera point': must be a list, got 'x'"),
        ("camera point", [1, 2, 10**400], r"'camera point': .*must be a number, got 1000"),
        ("hold_id", 7, "'hold_id': must be text, got 7"),
        ("depth_png scale", True, "'depth_png scale': must be a number, got True"),
        ("depth_png scale", 1e300, "'depth_png scale' must be at most 0.01 m"),
        ("world_from_object", [[0.0] * 4] * 4, "'world_from_object' must be a rigid"),
        ("world_from_object", [[1, 2], [3, 4]], "'world_from_object' must be a rigid 4x4"),
        ("camera internal", [[10**400] * 3] * 3, "'camera internal' must be a 3x3 matrix"),
    ],
)
def test_a_value_of_a_log_that_cannot_be_is_named(tmp_path, key, value, said):
    write_frame(tmp_path, make_frame(), depth_format="png")
    edit_log(tmp_path, **{key: value})
    refused(tmp_path, rf"frame 000007: .*000007\.json: {said}")


def test_intrinsics_by_name_by_matrix_or_left_out(tmp_path):
    write_frame(tmp_path, make_frame())
    edit_log(tmp_path, camera_internal=None)
    assert TransHand(tmp_path, "train")[0].camera == CAMERA
    edit_log(tmp_path, camera_internal={"fx": 50, "fy": 51, "cx": 30, "cy": 18})
    assert TransHand(tmp_path, "train")[0].camera.fy == 51
    edit_log(tmp_path, camera_internal="f=50")
    refused(tmp_path, "'camera internal' must be a 3x3 matrix")
    assert TransHand(tmp_path, "train", camera=CAMERA)[0].camera == CAMERA


def test_a_png_without_a_scale_asks_for_it(tmp_path):
    frame = make_frame()
    write_frame(tmp_path, frame, depth_format="png", depth_scale=0.0002)
    path = tmp_path / "train/0004/depth/log_json/000007.json"
    log = json.loads(path.read_text())
    assert log.pop("depth_png scale") == 0.0002
    path.write_text(json.dumps(log))
    refused(tmp_path, r"pass depth_scale= \(metres per step\)")
    read = TransHand(tmp_path, "train", depth_scale=0.0002)[0]
    np.testing.assert_allclose(read.depth, frame.depth, atol=1.1e-4)


def test_the_scale_of_depth_is_not_taken_for_that_of_raw_depth(tmp_path):
    write_frame(tmp_path, replace(make_frame(), raw_depth=np.ones((H, W), np.float32)))
    edit_log(tmp_path, **{"raw_depth scale": None})
    refused(tmp_path, "the log does not name 'raw_depth scale'$", depth_scale=0.0001)


def test_a_camera_of_another_size_than_the_picture_is_refused(tmp_path):
    write_frame(tmp_path, make_frame())
    larger = CAMERA.resized(2 * W, 2 * H)
    refused(tmp_path, f"is {W}x{H}, but its camera {2 * W}x{2 * H}", camera=larger)
    edit_log(tmp_path, camera_internal=larger.to_dict())
    refused(tmp_path, f"is {W}x{H}, but its camera {2 * W}x{2 * H}")


def test_a_frame_replaces_one_of_its_name_with_all_its_files(tmp_path):
    write_frame(tmp_path, make_frame())
    other = make_frame(seed=1)
    write_frame(tmp_path, other)
    np.testing.assert_array_equal(TransHand(tmp_path, "train")[0].depth, other.depth)
    # of another form: nothing of the old one is left that could be taken for the new one's
    write_frame(tmp_path, other, depth_format="png", jpeg_quality=95, object_folder="object_mask")
    assert len([p for p in tmp_path.rglob("*") if p.is_file()]) == 6
    assert not list(tmp_path.rglob("*.npy"))


def test_what_cannot_be_written_is_refused(tmp_path):
    for name in ("world_from_camera", "world_from_object"):
        for pose in (np.diag([2.0, 2, 2, 1]), np.full((4, 4), np.nan), np.eye(3)):
            with pytest.raises(ValueError, match=f"{name} must be a rigid 4x4 matrix, got"):
                write_frame(tmp_path, replace(make_frame(), **{name: pose}))
    frame = make_frame()
    far = replace(frame, depth=np.full((H, W), 7.0, np.float32))
    with pytest.raises(ValueError, match=r"depth reaches 7.000 m, but 16 bits .* end at 6.554"):
        write_frame(tmp_path, far, depth_format="png")
    with pytest.raises(ValueError, match=r"depth has shape \(36, 32\), the camera \(36, 64\)"):
        write_frame(tmp_path, replace(frame, depth=frame.depth[:, :32]))


def test_a_depth_array_lies_row_by_row_in_its_file() -> None:
    depth = np.asfortranarray(np.arange(6, dtype=np.float32).reshape(2, 3))
    stored = np.load(io.BytesIO(encode_depth_array(depth)))
    assert stored.flags.c_contiguous
    np.testing.assert_array_equal(stored, depth)
