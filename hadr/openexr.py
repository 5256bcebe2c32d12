"""Reading OpenEXR images: the scan-line subset in which depth cameras' data sets come.

OpenCV's wheels are built without OpenEXR, so the few lines of the format that depth needs are
read here: one part, scan lines, half, float or unsigned integer channels, uncompressed or with
run-length, ZIPS or ZIP compression. The format: openexr.com, "OpenEXR File Layout".
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAGIC = 20000630
COMPRESSIONS = ("NONE", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "B44A", "DWAA", "DWAB")
LINES_PER_BLOCK = {"NONE": 1, "RLE": 1, "ZIPS": 1, "ZIP": 16}
CHANNEL_TYPES = (np.dtype("<u4"), np.dtype("<f2"), np.dtype("<f4"))


@dataclass(frozen=True)
class _Header:
    channels: tuple[tuple[str, np.dtype[Any]], ...]
    compression: str
    x_min: int
    y_min: int
    width: int
    height: int
    end: int


def read_exr(path: str | Path) -> dict[str, NDArray[np.float32]]:
    """Read the channels of a scan-line OpenEXR image.

    Args:
        path: The `.exr` file.

    Returns:
        Channel name to values, each (H, W) float32, row 0 at the top.

    Raises:
        ValueError: Not an OpenEXR file, damaged or cut off, or of a kind that is not read here;
            the message says which.
    """
    data = Path(path).read_bytes()
    try:
        header = _read_header(data)
        return _read_pixels(data, header)
    except (IndexError, struct.error, zlib.error, UnicodeDecodeError) as error:
        raise ValueError(f"the OpenEXR data is damaged or cut off ({error})") from error


def _read_header(data: bytes) -> _Header:
    if len(data) < 8 or struct.unpack("<I", data[:4])[0] != MAGIC:
        raise ValueError("the file does not start like an OpenEXR image")
    if struct.unpack("<I", data[4:8])[0] & 0x1A00:
        raise ValueError("only one-part, scan-line OpenEXR images are read (not tiled, not deep)")
    position, attributes = 8, {}
    while data[position] != 0:
        name, position = _text(data, position)
        _, position = _text(data, position)
        (size,) = struct.unpack_from("<i", data, position)
        attributes[name] = data[position + 4 : position + 4 + size]
        position += 4 + size
    absent = {"channels", "compression", "dataWindow"} - attributes.keys()
    if absent:
        raise ValueError(f"the OpenEXR header lacks {', '.join(sorted(absent))}")
    x_min, y_min, x_max, y_max = struct.unpack("<4i", attributes["dataWindow"])
    if x_max < x_min or y_max < y_min or (x_max - x_min) * (y_max - y_min) > 2**28:
        raise ValueError(f"the OpenEXR data window {x_min, y_min, x_max, y_max} is not an image")
    compression = COMPRESSIONS[attributes["compression"][0]]
    if compression not in LINES_PER_BLOCK:
        raise ValueError(
            f"OpenEXR compression {compression} is not read, expected one of "
            f"{', '.join(LINES_PER_BLOCK)}; save the depth as .npy or as ZIP-compressed EXR"
        )
    channels = _channels(attributes["channels"])
    width, height = x_max - x_min + 1, y_max - y_min + 1
    return _Header(channels, compression, x_min, y_min, width, height, position + 1)


def _channels(listed: bytes) -> tuple[tuple[str, np.dtype[Any]], ...]:
    channels, position = [], 0
    while listed[position] != 0:
        name, position = _text(listed, position)
        kind, _, x_step, y_step = struct.unpack_from("<iIii", listed, position)
        position += 16
        if (x_step, y_step) != (1, 1):
            raise ValueError(f"OpenEXR channel {name} is subsampled, expected every pixel")
        channels.append((name, CHANNEL_TYPES[kind]))
    return tuple(channels)


def _read_pixels(data: bytes, header: _Header) -> dict[str, NDArray[np.float32]]:
    lines = LINES_PER_BLOCK[header.compression]
    blocks = -(-header.height // lines)
    row_bytes = header.width * sum(kind.itemsize for _, kind in header.channels)
    planes = {
        name: np.zeros((header.height, header.width), np.float32) for name, _ in header.channels
    }
    for offset in struct.unpack_from(f"<{blocks}Q", data, header.end):
        y, size = struct.unpack_from("<ii", data, offset)
        packed = data[offset + 8 : offset + 8 + size]
        first = y - header.y_min
        if len(packed) != size or not 0 <= first < header.height:
            raise ValueError(f"the OpenEXR data is damaged or cut off (scan line {y})")
        rows = min(lines, header.height - first)
        raw = _unpack(packed, header.compression, rows * row_bytes)
        for row in range(rows):
            start = row * row_bytes
            for name, kind in header.channels:
                values = np.frombuffer(raw, kind, header.width, start)
                planes[name][first + row] = values
                start += header.width * kind.itemsize
    return planes


def _unpack(packed: bytes, compression: str, expected: int) -> bytes:
    """Undo one block's compression; a block that would have grown is stored as it is."""
    if len(packed) == expected or compression == "NONE":
        raw = packed
    else:
        coded = _run_lengths(packed) if compression == "RLE" else zlib.decompress(packed)
        raw = _undo_prediction(coded)
    if len(raw) != expected:
        raise ValueError(
            f"the OpenEXR data is damaged or cut off (block of {len(raw)} bytes, "
            f"expected {expected})"
        )
    return raw


def _undo_prediction(coded: bytes) -> bytes:
    """Undo the byte differences, then interleave the two halves again."""
    steps = np.frombuffer(coded, np.uint8).astype(np.int64)
    steps[1:] -= 128
    values = (np.cumsum(steps) & 0xFF).astype(np.uint8)
    raw = np.empty_like(values)
    half = (values.size + 1) // 2
    raw[0::2], raw[1::2] = values[:half], values[half:]
    return raw.tobytes()


def _run_lengths(packed: bytes) -> bytes:
    unpacked, position = bytearray(), 0
    while position < len(packed):
        (count,) = struct.unpack_from("<b", packed, position)
        if count < 0:
            unpacked += packed[position + 1 : position + 1 - count]
            position += 1 - count
        else:
            unpacked += packed[position + 1 : position + 2] * (count + 1)
            position += 2
    return bytes(unpacked)


def _text(data: bytes, position: int) -> tuple[str, int]:
    end = data.find(b"\0", position)
    if end < 0:
        raise IndexError("a name has no end")
    return data[position:end].decode("ascii"), end + 1
