import struct
import zlib

import numpy as np
import pytest

from hadr.openexr import read_exr

KINDS = {"uint": (0, "<u4"), "half": (1, "<f2"), "float": (2, "<f4")}


def predicted(raw: bytes) -> bytes:
    """The format's reordering: even bytes, then odd ones, each minus the one before, plus 128."""
    data = np.frombuffer(raw, np.uint8)
    split = np.concatenate([data[0::2], data[1::2]]).astype(int)
    split[1:] = (split[1:] - split[:-1] + 128) & 0xFF
    return split.astype(np.uint8).tobytes()


def run_lengths(data: bytes) -> bytes:
    """Pairs of equal bytes as runs of two, the rest as one-byte literals."""
    coded, i = b"", 0
    while i < len(data):
        if i + 1 < len(data) and data[i] == data[i + 1]:
            coded, i = coded + struct.pack("<bB", 1, data[i]), i + 2
        else:
            coded, i = coded + struct.pack("<bB", -1, data[i]), i + 1
    return coded


def make_exr(
    channels: dict[str, tuple[str, np.ndarray]], compression: int, y_min: int = 0
) -> bytes:
    """Write an OpenEXR file by the letter of the format."""
    height, width = next(iter(channels.values()))[1].shape
    names = sorted(channels)
    listed = b"".join(
        n.encode() + b"\0" + struct.pack("<iIii", KINDS[channels[n][0]][0], 0, 1, 1) for n in names
    )
    window = struct.pack("<4i", 0, y_min, width - 1, y_min + height - 1)
    attributes = [
        ("channels", "chlist", listed + b"\0"),
        ("compression", "compression", bytes([compression])),
        ("dataWindow", "box2i", window),
        ("displayWindow", "box2i", window),
        ("lineOrder", "lineOrder", b"\0"),
    ]
    head = struct.pack("<II", 20000630, 2)
    for name, kind, value in attributes:
        head += name.encode() + b"\0" + kind.encode() + b"\0"
        head += struct.pack("<i", len(value)) + value
    head += b"\0"
    lines = 16 if compression == 3 else 1
    blocks = []
    for top in range(0, height, lines):
        raw = b"".join(
            channels[n][1][row].astype(KINDS[channels[n][0]][1]).tobytes()
            for row in range(top, min(top + lines, height))
            for n in names
        )
        packed = raw
        if compression in (2, 3):
            packed = zlib.compress(predicted(raw))
        elif compression == 1:
            packed = run_lengths(predicted(raw))
        if len(packed) >= len(raw):
            packed = raw
        blocks.append(struct.pack("<ii", y_min + top, len(packed)) + packed)
    offsets, position = b"", len(head) + 8 * len(blocks)
    for block in blocks:
        offsets += struct.pack("<Q", position)
        position += len(block)
    return head + offsets + b"".join(blocks)


@pytest.mark.parametrize("compression", [0, 1, 2, 3])
@pytest.mark.parametrize("kind", ["half", "float"])
@pytest.mark.parametrize("size", [(37, 50), (16, 8), (1, 1)])
def test_round_trip(tmp_path, compression: int, kind: str, size: tuple[int, int]) -> None:
    rng = np.random.default_rng(0)
    depth = np.round(rng.random(size) * 64) / 64  # half floats hold these exactly
    depth[0, 0] = np.nan
    other = np.ones_like(depth)
    path = tmp_path / "depth.exr"
    path.write_bytes(make_exr({"Z": (kind, depth), "A": ("float", other)}, compression, y_min=5))
    channels = read_exr(path)
    assert sorted(channels) == ["A", "Z"]
    assert channels["Z"].dtype == np.float32
    np.testing.assert_array_equal(channels["Z"], depth.astype(np.float32))
    np.testing.assert_array_equal(channels["A"], other)


def test_whole_numbers(tmp_path) -> None:
    ids = np.arange(600, dtype=np.uint32).reshape(20, 30)
    path = tmp_path / "ids.exr"
    path.write_bytes(make_exr({"id": ("uint", ids)}, 3))
    np.testing.assert_array_equal(read_exr(path)["id"], ids)


def test_damaged_files_are_named(tmp_path) -> None:
    rng = np.random.default_rng(0)
    whole = make_exr({"Z": ("float", rng.random((40, 40)))}, 3)
    path = tmp_path / "depth.exr"
    for length in (len(whole) - 1, len(whole) // 2, 200, 60):
        path.write_bytes(whole[:length])
        with pytest.raises(ValueError, match="damaged or cut off"):
            read_exr(path)
    path.write_bytes(b"\x89PNG and more bytes")
    with pytest.raises(ValueError, match="does not start like an OpenEXR image"):
        read_exr(path)
    path.write_bytes(make_exr({"Z": ("float", np.ones((4, 4)))}, 4))
    with pytest.raises(ValueError, match="compression PIZ is not read, expected one of NONE, RLE"):
        read_exr(path)
    tiled = bytearray(whole)
    tiled[5] |= 0x02
    path.write_bytes(bytes(tiled))
    with pytest.raises(ValueError, match="not tiled"):
        read_exr(path)


def test_published_normals_are_unit_vectors(realdata) -> None:
    """Three half-float channels decoded right have length 1, wrong bytes would not."""
    channels = read_exr(realdata / "cleargrasp_d435" / "000000130-normals.exr")
    length = np.sqrt(sum(channels[c] ** 2 for c in "RGB"))
    assert length.shape == (720, 1280)
    assert np.median(length) == pytest.approx(1, abs=1e-3)
