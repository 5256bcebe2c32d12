"""The pictures of a frame as bytes, and back: colour, depth, masks, surface normals.

A reader must not take a broken file for a picture: OpenCV turns half a JPEG into a picture with a
grey end. Files are therefore checked for completeness before they are decoded.
"""

from __future__ import annotations

import io
import re
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
import numpy.typing as npt

from hadr.camera import LARGEST_IMAGE

Normals = Literal["all", "held", "object", "none"]
"""Of which pixels a frame's surface normals are kept; held: of hand and object."""

Depth = npt.NDArray[np.float32]

PNG_START = b"\x89PNG\r\n\x1a\n"
JPEG_START = b"\xff\xd8"
# Within a JPEG's coded pixels, neither a stuffed 0xFF nor a restart.
_JPEG_MARKER = re.compile(rb"\xff+([^\x00\xff\xd0-\xd7])")
# The markers of segments that say how large the picture is.
_JPEG_FRAMES = [bytes([code]) for code in range(0xC0, 0xD0) if code not in (0xC4, 0xC8, 0xCC)]
_BEST = (cv2.IMWRITE_PNG_COMPRESSION, 9)
# Differences to the left neighbour, or Paeth's. One of them for a whole picture makes depth a
# tenth smaller than a filter chosen row by row.
_FILTERS = (cv2.IMWRITE_PNG_FILTER_SUB, cv2.IMWRITE_PNG_FILTER_PAETH)


def _encode(extension: str, image: npt.NDArray[Any], options: Sequence[int]) -> bytes:
    done, data = cv2.imencode(extension, image, list(options))
    if not done:
        raise ValueError(f"can't encode a picture of shape {image.shape} as {extension}")
    return bytes(data.tobytes())


def _smallest_png(steps: npt.NDArray[np.uint16]) -> bytes:
    """Encode steps as 16-bit PNG with the filter that makes it smallest."""
    options = [(*_BEST, cv2.IMWRITE_PNG_FILTER, one) for one in _FILTERS]
    return min((_encode(".png", steps, chosen) for chosen in options), key=len)


def _jpeg_size(data: bytes) -> tuple[int, int]:
    """Rows and columns of a JPEG that reaches its end; a preview inside has an end of its own."""
    position, size = len(JPEG_START), (0, 0)
    while (marker := _JPEG_MARKER.search(data, position)) is not None:
        if marker[1] == b"\xd9":
            return size
        if marker[1] in _JPEG_FRAMES:
            start = marker.end() + 3
            size = (
                int.from_bytes(data[start : start + 2], "big"),
                int.from_bytes(data[start + 2 : start + 4], "big"),
            )
        # The other markers begin a segment that says how long it is.
        position = marker.end() + int.from_bytes(data[marker.end() : marker.end() + 2], "big")
    raise ValueError(f"the JPEG is cut off after {len(data)} bytes")


def check_whole(data: bytes) -> None:
    """Check that a PNG or JPEG is complete and not too large, before room for it is set aside."""
    if not data:
        raise ValueError("the file is empty")
    if data.startswith(JPEG_START):
        _check_size(*_jpeg_size(data))
        return
    if not data.startswith(PNG_START):
        raise ValueError("the file is neither PNG nor JPEG")
    position, kind = len(PNG_START), b""
    while kind != b"IEND":
        size = int.from_bytes(data[position : position + 4], "big")
        kind = data[position + 4 : position + 8]
        end = position + 12 + size
        if end > len(data):
            raise ValueError(f"the PNG is cut off after {len(data)} bytes")
        if zlib.crc32(data[position + 4 : end - 4]) != int.from_bytes(data[end - 4 : end], "big"):
            raise ValueError(f"the PNG is damaged at byte {position}")
        position = end
    _check_size(int.from_bytes(data[20:24], "big"), int.from_bytes(data[16:20], "big"))


def _check_size(height: int, width: int) -> None:
    if not 1 <= height * width <= LARGEST_IMAGE:
        raise ValueError(f"it has {width}x{height} pixels, expected 1 to {LARGEST_IMAGE}")


def decode_image(data: bytes, flags: int) -> npt.NDArray[Any]:
    """Decode a whole PNG or JPEG as OpenCV's flags say, without OpenCV's own messages."""
    check_whole(data)
    return decode_unchecked(data, flags)


def decode_unchecked(data: bytes, flags: int) -> npt.NDArray[Any]:
    """As `decode_image`, in any format that OpenCV knows; a cut-off file may come out grey."""
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        raise ValueError(f"its {len(data)} bytes cannot be decoded: {error.err}") from error
    finally:
        cv2.utils.logging.setLogLevel(level)
    if image is None:
        raise ValueError(f"its {len(data)} bytes cannot be decoded")
    return np.asarray(image)


def encode_color(color: npt.NDArray[np.uint8], jpeg_quality: int | None) -> bytes:
    """Encode sRGB (H, W, 3) as JPEG, or as PNG where no quality is given."""
    bgr = np.ascontiguousarray(color[..., ::-1])
    if jpeg_quality is None:
        return _encode(".png", bgr, _BEST)
    options = (cv2.IMWRITE_JPEG_QUALITY, jpeg_quality, cv2.IMWRITE_JPEG_OPTIMIZE, 1)
    return _encode(".jpg", bgr, (*options, cv2.IMWRITE_JPEG_PROGRESSIVE, 1))


def decode_color(data: bytes) -> npt.NDArray[np.uint8]:
    """Decode a PNG or JPEG to sRGB, shape (H, W, 3) uint8; a ``ValueError`` where it is grey."""
    bgr = decode_image(data, cv2.IMREAD_ANYCOLOR)
    if bgr.ndim == 2:
        raise ValueError(f"a colour picture has three channels, got {bgr.shape}: it is grey")
    return np.ascontiguousarray(bgr[..., ::-1])


def encode_depth(depth: Depth, scale: float) -> bytes:
    """Encode z-depth, metres, (H, W), 0 = missing, as 16-bit PNG of steps of `scale` metres."""
    if not np.isfinite(depth).all() or depth.min(initial=0.0) < 0:
        raise ValueError("depth must be finite and not negative; 0 marks a missing value")
    farthest = float(np.max(depth, initial=0.0))
    if farthest > 65535 * scale:
        raise ValueError(
            f"depth reaches {farthest:.3f} m, but 16 bits at {scale} m a step end at "
            f"{65535 * scale:.3f} m"
        )
    steps = np.round(np.asarray(depth, dtype=float) / scale).astype(np.uint16)
    return _smallest_png(steps)


def decode_depth(data: bytes, scale: float) -> Depth:
    """Decode a 16-bit PNG to metres, (H, W) float32; ``scale`` are metres of one step."""
    steps = decode_image(data, cv2.IMREAD_UNCHANGED)
    if steps.dtype != np.uint16:
        raise ValueError(f"depth must be a 16-bit PNG, got {steps.shape} {steps.dtype}")
    return ((steps[..., 0] if steps.ndim == 3 else steps) * scale).astype(np.float32)


@dataclass(frozen=True)
class DisparityScale:
    """How a stereo camera's depth follows from its disparity: ``z = focal_baseline / disparity``.

    Args:
        focal_baseline: Focal length times baseline, pixels times metres.
        step: Pixels of disparity of one step of the picture.
        unit: The depth is rounded to multiples of this, metres.

    Raises:
        ValueError: A value is not positive.
    """

    focal_baseline: float
    step: float
    unit: float

    def __post_init__(self) -> None:
        if not min(self.focal_baseline, self.step, self.unit) > 0:
            raise ValueError(f"the values of a disparity scale must be positive, got {self}")

    def depth(self, steps: npt.NDArray[Any]) -> Depth:
        """Depth in metres of whole steps; 0 stays 0."""
        z = self.focal_baseline / (np.maximum(steps, 1) * self.step)
        return np.where(steps > 0, np.rint(z / self.unit) * self.unit, 0.0).astype(np.float32)

    def steps(self, depth: Depth) -> npt.NDArray[np.float64]:
        """The nearest whole steps of depth in metres; 0 stays 0."""
        seen = depth > 0
        disparity = self.focal_baseline / np.where(seen, depth, 1.0) / self.step
        return np.where(seen, np.rint(disparity).clip(1, 65535), 0.0)

    def nearest(self, depth: Depth, *, double_beyond: float = np.inf) -> Depth:
        """Round depth (metres) to what whole steps give; far away to double steps."""
        steps = self.steps(depth)
        steps = np.where(depth > double_beyond, 2 * np.rint(steps / 2), steps)
        return self.depth(steps)


def encode_disparity(depth: Depth, scale: DisparityScale) -> bytes:
    """Encode depth as the 16-bit PNG, a third smaller, of the disparities that give it."""
    steps = scale.steps(depth).astype(np.uint16)
    off = float(np.abs(scale.depth(steps) - depth).max(initial=0.0))
    if not off < 1e-6:
        raise ValueError(f"the depth is up to {off:.6f} m away from what {scale} can give")
    return _smallest_png(steps)


def decode_disparity(data: bytes, scale: DisparityScale) -> Depth:
    """Decode the 16-bit PNG of a disparity to depth in metres, (H, W) float32, 0 missing."""
    steps = decode_image(data, cv2.IMREAD_UNCHANGED)
    if steps.dtype != np.uint16 or steps.ndim != 2:
        raise ValueError(f"a disparity must be a 16-bit PNG, got {steps.shape} {steps.dtype}")
    return scale.depth(steps)


def encode_depth_array(depth: Depth) -> bytes:
    """Encode depth as a NumPy file, float32 metres."""
    stream = io.BytesIO()
    np.save(stream, depth.astype(np.float32, order="C"))
    return stream.getvalue()


def decode_depth_array(data: bytes) -> Depth:
    """Decode a NumPy file of (H, W) or (H, W, C) float metres; of several channels the first.

    What is not finite or not positive becomes 0.
    """
    try:
        depth = np.load(io.BytesIO(data), allow_pickle=False)
    except (ValueError, OSError, EOFError) as error:
        raise ValueError(f"the NumPy file is cut off or damaged ({error})") from error
    depth = depth[..., 0] if depth.ndim == 3 else depth
    if depth.ndim != 2 or not np.issubdtype(depth.dtype, np.floating):
        raise ValueError(
            f"depth must be (H, W) or (H, W, C) float metres, got {depth.shape} {depth.dtype}"
        )
    return np.where(np.isfinite(depth) & (depth > 0), depth, 0.0).astype(np.float32)


def encode_mask(mask: npt.NDArray[np.bool_]) -> bytes:
    """Encode a mask as 8-bit PNG, 0 or 255."""
    return _encode(".png", mask.astype(np.uint8) * 255, _BEST)


def decode_mask(data: bytes) -> npt.NDArray[np.bool_]:
    """Decode an 8-bit mask of 0 and 255, shape (H, W) bool."""
    mask = decode_image(data, cv2.IMREAD_UNCHANGED)
    if mask.dtype != np.uint8:
        raise ValueError(f"a mask must be an 8-bit picture, got {mask.shape} {mask.dtype}")
    mask = mask[..., 0] if mask.ndim == 3 else mask
    if 0 < mask.max(initial=0) <= 127:
        raise ValueError(f"a mask must hold 0 and 255, the largest value is {mask.max()}")
    return np.asarray(mask > 127)


def encode_normals(normals: npt.NDArray[np.float32]) -> bytes:
    """Encode unit normals (H, W, 3) as 8-bit RGB ``round(127 n) + 128``; unknown ones, 0, as 0."""
    steps = (np.round(normals * 127.0) + 128).clip(1, 255).astype(np.uint8)
    steps[~normals.any(axis=-1)] = 0
    return _encode(".png", np.ascontiguousarray(steps[..., ::-1]), _BEST)


def decode_normals(data: bytes) -> npt.NDArray[np.float32]:
    """Decode normals, shape (H, W, 3) float32, of length 1, or 0 where unknown."""
    steps = decode_image(data, cv2.IMREAD_UNCHANGED)
    if steps.ndim != 3 or steps.shape[2] != 3 or steps.dtype != np.uint8:
        raise ValueError(f"normals must be an 8-bit RGB picture, got {steps.shape} {steps.dtype}")
    normals = (steps[..., ::-1].astype(np.float32) - 128) / 127
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    known = steps.any(axis=-1, keepdims=True)
    return np.where(known, normals / np.maximum(length, 1e-6), 0.0).astype(np.float32)
