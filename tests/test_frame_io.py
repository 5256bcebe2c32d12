import json
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest
import trimesh
from PIL import ExifTags, Image

from hadr.camera import Intrinsics
from hadr.frame_io import (
    read_color,
    read_depth,
    read_hand,
    read_mask,
    write_depth_png,
    write_point_cloud,
)


def test_colour_keeps_the_order_red_green_blue(tmp_path) -> None:
    bgr = np.zeros((4, 5, 3), np.uint8)
    bgr[..., 2] = 200
    cv2.imwrite(str(tmp_path / "red.png"), bgr)
    color = read_color(tmp_path / "red.png")
    assert color.shape == (4, 5, 3)
    assert color[0, 0].tolist() == [200, 0, 0]


@pytest.mark.parametrize("read", [read_color, read_mask])
def test_alpha_may_not_mean_anything(tmp_path: Path, read) -> None:
    path = tmp_path / "picture.png"
    picture = np.full((4, 5, 4), 255, np.uint8)
    cv2.imwrite(str(path), picture)
    assert read(path).all()
    picture[0, 1:3, 3] = (0, 254)
    cv2.imwrite(str(path), picture)
    with pytest.raises(ValueError, match=r"picture\.png is transparent in 2 of its 20 pixels"):
        read(path)


@pytest.mark.parametrize(("read", "kind"), [(read_mask, np.uint8), (read_depth, np.uint16)])
def test_a_grey_that_is_marked_as_transparent_is_none(tmp_path: Path, read, kind) -> None:
    """OpenCV leaves the mark aside; that of 0, which is missing, says nothing new."""
    path, picture = tmp_path / "picture.png", np.zeros((4, 5), kind)
    picture[1, 1:4] = 200
    whole = cv2.imencode(".png", picture)[1].tobytes()
    start = whole.index(b"IDAT") - 4
    for grey in (0, 200):
        mark = b"tRNS" + grey.to_bytes(2, "big")
        mark = b"\0\0\0\2" + mark + zlib.crc32(mark).to_bytes(4, "big")
        path.write_bytes(whole[:start] + mark + whole[start:])
        if grey == 0:
            assert np.count_nonzero(read(path)) == 3
    with pytest.raises(ValueError, match=r"picture\.png is transparent in 3 of its 20 pixels"):
        read(path)


def test_depth_png_is_millimetres_by_default_and_scales(tmp_path) -> None:
    path = tmp_path / "depth.png"
    cv2.imwrite(str(path), np.array([[0, 500], [1234, 65535]], np.uint16))
    np.testing.assert_allclose(read_depth(path), [[0, 0.5], [1.234, 65.535]], rtol=1e-6)
    np.testing.assert_allclose(read_depth(path, 1e-4), [[0, 0.05], [0.1234, 6.5535]], rtol=1e-6)


def test_depth_png_round_trip(tmp_path) -> None:
    depth = np.array([[0.0, 0.5004, np.nan], [0.5006, 70.0, 65.535]], np.float32)
    write_depth_png(tmp_path / "depth.png", depth)
    expected = [[0, 0.5, 0], [0.501, 0, 65.535]]
    np.testing.assert_allclose(read_depth(tmp_path / "depth.png"), expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("stored", "scale", "expected"),
    [
        (np.array([[0.7]], np.float64), None, 0.7),
        (np.array([[700]], np.uint16), None, 0.7),
        (np.array([[700.0]], np.float32), 0.001, 0.7),
        (np.array([[[0.7]]], np.float32), None, 0.7),
    ],
)
def test_depth_npy_whole_numbers_are_millimetres_floats_are_metres(
    tmp_path, stored, scale, expected
) -> None:
    np.save(tmp_path / "depth.npy", stored)
    depth = read_depth(tmp_path / "depth.npy", scale)
    assert depth.shape == (1, 1)
    assert depth.dtype == np.float32
    assert depth[0, 0] == pytest.approx(expected)


def test_mask_is_everything_not_zero(tmp_path) -> None:
    cv2.imwrite(str(tmp_path / "mask.png"), np.array([[0, 7], [7, 0]], np.uint8))
    assert read_mask(tmp_path / "mask.png").tolist() == [[False, True], [True, False]]
    grey = np.zeros((2, 2, 3), np.uint8)
    grey[0, 0] = 9
    cv2.imwrite(str(tmp_path / "mask3.png"), grey)
    assert read_mask(tmp_path / "mask3.png").tolist() == [[True, False], [False, False]]


@pytest.mark.parametrize("values", [(0, 1, 255), (1, 255), (0, 60, 200)])
def test_a_soft_mask_or_one_of_several_objects_is_refused(tmp_path, values):
    mask = np.resize(np.array(values, np.uint8), (6, 6))
    cv2.imwrite(str(tmp_path / "mask.png"), mask)
    np.save(tmp_path / "mask.npy", mask)
    for name in ("mask.png", "mask.npy"):
        with pytest.raises(ValueError, match=r"must hold 0 and one other value, got \d of them"):
            read_mask(tmp_path / name)


def test_hand_in_all_its_forms(tmp_path) -> None:
    hand = np.arange(63).reshape(21, 3) / 100
    (tmp_path / "a.json").write_text(json.dumps(hand.tolist()))
    (tmp_path / "b.json").write_text(json.dumps({"keypoints": hand.tolist()}))
    (tmp_path / "c.txt").write_text("\n".join(f"{x} {y} {z}" for x, y, z in hand))
    (tmp_path / "d.csv").write_text("\n".join(f"{x}, {y}, {z}" for x, y, z in hand) + "\n\n")
    np.save(tmp_path / "e.npy", hand)
    for name in ("a.json", "b.json", "c.txt", "d.csv", "e.npy"):
        np.testing.assert_allclose(read_hand(tmp_path / name), hand)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.json", '{"joints": []}'),
        ("b.json", "[[1, 2, 3], [1, 2]]"),
        ("c.txt", "wrist 1 2 3"),
        ("d.json", "not json"),
        ("e.json", "[" * 100_000),
        ("f.json", f"[[0, 0, {10**400}]]"),
        ("g.json", "[[0, 0, true]]"),
    ],
)
def test_hand_that_is_no_hand(tmp_path, name: str, content: str) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(ValueError, match=f"{name} must hold 21 keypoints x y z in metres"):
        read_hand(tmp_path / name)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"x,y,z\n" + b"0,0,0.5\n" * 21, "line 1 holds 'x,y,z', expected three numbers"),
        (b"\x89PNG\r\n\x1a\n", "line 1 holds '.PNG', expected three numbers"),
        (b"0 0 0.5\n" * 20 + b"\n0 0 0.5m\n", "line 22 holds '0 0 0.5m', expected three"),
    ],
)
def test_a_hand_s_line_that_is_no_keypoint_is_said(tmp_path, content: bytes, said: str) -> None:
    (tmp_path / "hand.csv").write_bytes(content)
    with pytest.raises(ValueError, match=rf"or \.npy: {said}"):
        read_hand(tmp_path / "hand.csv")


def test_image_errors_name_the_file_and_the_reason(tmp_path) -> None:
    with pytest.raises(FileNotFoundError, match=r"colour file .*gone.png does not exist"):
        read_color(tmp_path / "gone.png")
    with pytest.raises(ValueError, match=r"is a folder, expected a file"):
        read_color(tmp_path)
    good = cv2.imencode(".png", np.random.default_rng(0).integers(0, 255, (40, 50, 3)))[1].tobytes()
    path = tmp_path / "a.png"
    for length in (len(good) - 1, len(good) - 12, len(good) // 2, 30):
        path.write_bytes(good[:length])
        with pytest.raises(ValueError, match=rf"a.png is not .* cut off after {length} bytes"):
            read_color(path)
    damaged = bytearray(good)
    damaged[len(good) // 2] ^= 0xFF
    path.write_bytes(bytes(damaged))
    with pytest.raises(ValueError, match=r"the PNG is damaged at byte"):
        read_color(path)
    path.write_bytes(b"")
    with pytest.raises(ValueError, match=r"not a whole image.* the file is empty"):
        read_color(path)
    jpeg = cv2.imencode(".jpg", np.zeros((40, 50, 3), np.uint8))[1].tobytes()
    path.write_bytes(jpeg[: len(jpeg) // 2])  # OpenCV would make a picture with a grey end of it
    with pytest.raises(ValueError, match=r"the JPEG is cut off after"):
        read_color(path)


@pytest.mark.parametrize("progressive", [0, 1])
def test_a_jpeg_damaged_in_its_middle(tmp_path: Path, progressive: int, capfd) -> None:
    picture = np.random.default_rng(0).integers(0, 255, (60, 80, 3)).astype(np.uint8)
    options = [cv2.IMWRITE_JPEG_PROGRESSIVE, progressive]
    data = bytearray(cv2.imencode(".jpg", picture, options)[1].tobytes())
    (tmp_path / "a.jpg").write_bytes(data)
    read_color(tmp_path / "a.jpg")
    at = 2 * len(data) // 3
    data[at : at + 64] = bytes(64)
    (tmp_path / "a.jpg").write_bytes(data)
    with pytest.raises(ValueError, match=r"a\.jpg is a damaged JPEG, .*\(Corrupt JPEG data: "):
        read_color(tmp_path / "a.jpg")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("kind", ["jpg", "png"])
def test_a_picture_that_is_stored_turned_is_refused(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"phone.{kind}"
    for orientation in (1, 6):
        about = Image.Exif()
        about[ExifTags.Base.Orientation] = orientation
        Image.new("RGB", (8, 4)).save(path, exif=about)
        if orientation == 1:
            assert read_color(path).shape == (4, 8, 3)
    with pytest.raises(ValueError, match=r"stored turned or mirrored \(its EXIF orientation is 6"):
        read_color(path)


def test_wrong_kinds_of_images_are_named(tmp_path) -> None:
    cv2.imwrite(str(tmp_path / "grey.png"), np.ones((4, 5), np.uint8))
    with pytest.raises(ValueError, match=r"8-bit RGB image, got shape \(4, 5\) uint8"):
        read_color(tmp_path / "grey.png")
    with pytest.raises(ValueError, match=r"16-bit one-channel PNG.*got shape \(4, 5\) uint8"):
        read_depth(tmp_path / "grey.png")
    np.save(tmp_path / "line.npy", np.ones(5))
    with pytest.raises(ValueError, match=r"\(H, W\) numbers of 16.*, got shape \(5,\) float64"):
        read_depth(tmp_path / "line.npy")
    for shape, kind in (((4, 5, 3), float), ((4, 5, 0), float), ((4, 5), np.uint8), ((4, 5), bool)):
        np.save(tmp_path / "other.npy", np.ones(shape, kind))
        with pytest.raises(ValueError, match=r"must be \(H, W\) numbers of 16 bits or more, got"):
            read_depth(tmp_path / "other.npy")
    (tmp_path / "cut.npy").write_bytes((tmp_path / "line.npy").read_bytes()[:-8])
    (tmp_path / "two.npy").write_bytes(2 * (tmp_path / "line.npy").read_bytes())
    for name, why in (("cut", ""), ("two", r".*behind its first array are 168 further bytes")):
        with pytest.raises(ValueError, match=rf"not a whole .npy file{why}"):
            read_depth(tmp_path / f"{name}.npy")
    with pytest.raises(ValueError, match=r"must be 0.000001 to 1 metres per unit, got 0"):
        read_depth(tmp_path / "line.npy", 0)


def test_point_cloud_lies_where_the_camera_saw_it(tmp_path) -> None:
    camera = Intrinsics(fx=100, fy=100, cx=1, cy=0, width=3, height=1)
    depth = np.array([[2.0, 0.0, 1.0]], np.float32)
    color = np.array([[[1, 2, 3], [4, 5, 6], [7, 8, 9]]], np.uint8)
    assert write_point_cloud(tmp_path / "cloud.ply", depth, color, camera) == 2
    assert b"format binary_little_endian" in (tmp_path / "cloud.ply").read_bytes()[:60]
    cloud = trimesh.load(tmp_path / "cloud.ply")
    np.testing.assert_allclose(cloud.vertices, [[-0.02, 0, 2], [0.01, 0, 1]], atol=1e-7)
    np.testing.assert_array_equal(cloud.colors[:, :3], [[1, 2, 3], [7, 8, 9]])


@pytest.mark.parametrize("compression", ["ZIP_COMPRESSION", "PIZ_COMPRESSION", "NO_COMPRESSION"])
@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_an_exr_depth_image_keeps_its_values(tmp_path, compression, dtype):
    depth = np.linspace(0.3, 2.0, 60, dtype=dtype).reshape(6, 10)
    header = {"compression": getattr(OpenEXR, compression), "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"RGB": np.repeat(depth[..., None], 3, axis=2)}).write(
        str(tmp_path / "depth.exr")
    )
    np.testing.assert_array_equal(read_depth(tmp_path / "depth.exr"), depth.astype(np.float32))


def test_of_several_exr_channels_z_is_the_depth(tmp_path):
    depth = np.full((4, 5), 0.7, np.float32)
    channels = {"A": np.ones((4, 5), np.float32), "Z": depth.copy()}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, channels).write(str(tmp_path / "depth.exr"))
    np.testing.assert_array_equal(read_depth(tmp_path / "depth.exr"), depth)


@pytest.mark.parametrize("channels", ["A", "RGB", "XY"])
def test_an_exr_that_does_not_say_which_channel_is_the_depth(tmp_path, channels):
    planes = {name: np.full((4, 5), n + 1, np.float32) for n, name in enumerate(channels)}
    OpenEXR.File({"type": OpenEXR.scanlineimage}, planes).write(str(tmp_path / "depth.exr"))
    with pytest.raises(ValueError, match=r"depth.exr has the channels .*, expected Z"):
        read_depth(tmp_path / "depth.exr")


def test_a_jpeg_or_a_picture_is_no_mask(tmp_path):
    cv2.imwrite(str(tmp_path / "mask.jpg"), np.full((8, 8), 255, np.uint8))
    (tmp_path / "mask.jpg").rename(tmp_path / "mask.png")
    with pytest.raises(ValueError, match=r"mask.png is a JPEG, whose compression blurs"):
        read_mask(tmp_path / "mask.png")
    cv2.imwrite(str(tmp_path / "red.png"), np.full((8, 8, 3), (0, 0, 255), np.uint8))
    cv2.imwrite(str(tmp_path / "deep.png"), np.full((8, 8), 800, np.uint16))
    for name in ("red.png", "deep.png"):
        with pytest.raises(ValueError, match="must be an 8-bit image without colours"):
            read_mask(tmp_path / name)


@pytest.mark.parametrize(
    "header",
    [
        "{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000, 1000000000)}",
        "(" * 3000,
        "{'descr': '|O', 'fortran_order': False, 'shape': (4, 5)}",
        None,
    ],
)
def test_an_npy_file_that_is_none(tmp_path, header):
    path = tmp_path / "depth.npy"
    if header is None:
        path.write_bytes(b"PK\x03\x04" + bytes(60))
    else:
        text = header.encode() + b"\n"
        path.write_bytes(b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text)
    with pytest.raises(ValueError, match=r"depth.npy is not a whole .npy file of numbers: ."):
        read_depth(path)


@pytest.mark.parametrize(("width", "height"), [(100_000, 100_000), (2**31 - 1, 1), (0, 4)])
def test_a_picture_too_large_is_refused_by_its_header(tmp_path, width, height):
    png = bytearray(cv2.imencode(".png", np.zeros((4, 5, 3), np.uint8))[1].tobytes())
    png[16:24] = struct.pack(">II", width, height)
    png[29:33] = zlib.crc32(png[12:29]).to_bytes(4, "big")
    (tmp_path / "a.png").write_bytes(png)
    with pytest.raises(ValueError, match=f"a.png .* has {width}x{height} pixels, expected 1 to"):
        read_color(tmp_path / "a.png")
    jpeg = bytearray(cv2.imencode(".jpg", np.zeros((4, 5, 3), np.uint8))[1].tobytes())
    start = jpeg.index(b"\xff\xc0") + 5
    jpeg[start : start + 4] = b"\xff" * 4
    (tmp_path / "a.jpg").write_bytes(jpeg)
    with pytest.raises(ValueError, match=r"a.jpg .* has 65535x65535 pixels, expected 1 to"):
        read_color(tmp_path / "a.jpg")


@pytest.mark.parametrize("value", [np.nan, 0.75, 1j, np.zeros(1, [("a", "<f4")])])
def test_a_mask_of_other_numbers_is_refused(tmp_path, value):
    np.save(tmp_path / "mask.npy", np.broadcast_to(value, (4, 4)))
    with pytest.raises(ValueError, match="must hold bool, whole numbers, or 0 and 1, got"):
        read_mask(tmp_path / "mask.npy")


@pytest.mark.parametrize(
    ("field", "message"),
    [
        ({"unit": "mm"}, "unit must be 'm', got 'mm'"),
        ({"frame": "world"}, "frame must be 'camera', got 'world'"),
        ({"accepted": "false"}, "accepted must be true or false, got 'false'"),
        ({"scale": 0.001}, "unknown entry 'scale', expected keypoints, unit, frame, accepted"),
    ],
)
def test_a_hand_that_says_it_is_another_is_refused(tmp_path, field, message):
    path = tmp_path / "hand.json"
    path.write_text(json.dumps({"keypoints": [[0.01 * n, 0, 0.5] for n in range(21)], **field}))
    with pytest.raises(ValueError, match=message):
        read_hand(path)


def test_a_hand_of_words_is_refused_with_its_file(tmp_path):
    np.save(tmp_path / "hand.npy", np.full((21, 3), "x"))
    with pytest.raises(ValueError, match=r"hand\.npy must hold 21 keypoints"):
        read_hand(tmp_path / "hand.npy")


def test_a_truncated_exr_is_one_sentence(tmp_path, capfd):
    depth = np.random.default_rng(0).random((64, 64), dtype=np.float32)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"Z": depth}).write(str(tmp_path / "whole.exr"))
    whole = (tmp_path / "whole.exr").read_bytes()
    capfd.readouterr()
    (tmp_path / "half.exr").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match=r"is not a whole OpenEXR image: its [0-9]+ bytes"):
        read_depth(tmp_path / "half.exr")
    assert capfd.readouterr() == ("", "")


def test_a_file_that_would_fill_the_memory_is_not_read(tmp_path, monkeypatch):
    monkeypatch.setattr("hadr.records.reading.LARGEST_FILE", 9)
    (tmp_path / "rgb.png").write_bytes(bytes(10))
    with pytest.raises(ValueError, match=r"rgb\.png has 10 bytes, the most are 9"):
        read_color(tmp_path / "rgb.png")
