"""An RGB-D frame's files: reading what a camera left on disk, writing what came out.

Every reader returns checked arrays in the library's units (metres, bool masks, RGB) or raises
one sentence that names the file, what is wrong with it and what is expected.
"""

from __future__ import annotations

import io
import os
import re
import sys
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from reprlib import repr as short
from threading import Lock
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import ExifTags, Image

from hadr.camera import (
    LARGEST_IMAGE,
    BoolArray,
    FloatArray,
    Intrinsics,
    back_project,
    checked_number,
    valid_depth,
)
from hadr.data.frame_pictures import JPEG_START, decode_image
from hadr.hand import check_keypoints
from hadr.records.reading import check_size, read_json

DEFAULT_DEPTH_SCALE = 0.001
_HAND_WORDS = ("keypoints", "unit", "frame", "accepted", "problems", "source", "measured")
"""What a hand's JSON may say; another word may mean what is not looked at, such as a scale."""
_QUIET = Lock()
_JPEG_DAMAGE = re.compile("Corrupt JPEG|Premature end of JPEG|Inconsistent progression|Invalid SOS")
"""How libjpeg's warnings begin where it goes on with what it made up; OpenCV has no other sign."""


def read_color(path: str | Path) -> NDArray[np.uint8]:
    """Read a PNG or JPEG colour image of 8 bits, opaque everywhere.

    Returns:
        RGB, shape (H, W, 3) uint8.

    Raises:
        FileNotFoundError: No such file.
        ValueError: Not a whole image, not 8-bit colour, transparent somewhere, or stored turned
            (EXIF).
    """
    image = _read_image(path, "colour")
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] not in (3, 4):
        raise ValueError(f"colour {path} must be an 8-bit RGB image, got {_kind(image)}")
    return np.asarray(cv2.cvtColor(image[..., :3], cv2.COLOR_BGR2RGB), dtype=np.uint8)


def read_depth(path: str | Path, scale: float | None = None) -> NDArray[np.float32]:
    """Read a depth image.

    Args:
        path: A 16-bit one-channel PNG, a `.npy` array (H, W) or (H, W, 1), or an OpenEXR image:
            its channel Z, or what all its channels agree on.
        scale: Metres per stored unit. None means 0.001 where whole numbers are stored (PNG,
            integer `.npy`) and 1 where floats are (float `.npy`, EXR).

    Returns:
        z-depth in metres, shape (H, W) float32; missing values are 0 or NaN as in the file.

    Raises:
        FileNotFoundError: No such file.
        ValueError: Not a whole depth image, or a scale that is not in [0.000001, 1].
    """
    path = Path(path)
    if scale is not None and not 1e-6 <= scale <= 1:
        raise ValueError(
            f"the depth's scale (--depth-scale) must be 0.000001 to 1 metres per unit, got {scale}"
        )
    stored: NDArray[Any]
    if path.suffix.lower() == ".npy":
        stored = _read_npy(path, "depth")
    elif path.suffix.lower() == ".exr":
        stored = _read_exr(path, "depth")
    else:
        stored = _read_image(path, "depth")
        if stored.dtype != np.uint16 or stored.ndim != 2:
            raise ValueError(
                f"depth {path} must be a 16-bit one-channel PNG, a .npy or an .exr file, "
                f"got {_kind(stored)}"
            )
    if stored.ndim == 3 and stored.shape[2] == 1:
        stored = stored[..., 0]
    if stored.ndim != 2 or stored.dtype.kind not in "fiu" or stored.dtype.itemsize == 1:
        raise ValueError(
            f"depth {path} must be (H, W) numbers of 16 bits or more, got {_kind(stored)}"
        )
    if scale is None:
        scale = 1.0 if stored.dtype.kind == "f" else DEFAULT_DEPTH_SCALE
    with np.errstate(over="ignore"):  # infinite depth is told of as such
        return (stored.astype(np.float64) * scale).astype(np.float32)


def _read_exr(path: Path, name: str) -> NDArray[Any]:
    """The channel Z of an OpenEXR image, or what its channels agree on, shape (H, W)."""
    import OpenEXR

    check_there(path, name)
    try:
        with quiet():
            opened = OpenEXR.File(str(path), separate_channels=True).channels()
        channels: dict[str, NDArray[Any]] = {name: one.pixels for name, one in opened.items()}
    except Exception as error:  # whatever the library says of a damaged file
        raise ValueError(
            f"{name} {path} is not a whole OpenEXR image: its {path.stat().st_size} bytes are "
            "truncated, damaged or of another format"
        ) from error
    names = set(channels) - {"A"}
    if "Z" in names:
        return channels["Z"]
    alike = names == {"R", "G", "B"} and all(
        np.array_equal(channels["R"], channels[other], equal_nan=True) for other in "GB"
    )
    if alike or len(names) == 1:
        return channels[names.pop()]
    raise ValueError(
        f"{name} {path} has the channels {', '.join(channels)}, expected Z, a single one, or the "
        "same depth in R, G and B"
    )


@contextmanager
def quiet() -> Iterator[list[str]]:
    """Hold back what a compiled library prints; its lines stand in the list when it has ended."""
    told: list[str] = []
    # Of two threads the second would put the first one's silence back.
    with _QUIET, tempfile.TemporaryFile() as said:
        if sys.stderr is None:  # closed by the caller
            yield told
            return
        sys.stderr.flush()
        kept = os.dup(2)
        try:
            with redirect_stdout(io.StringIO()):
                os.dup2(said.fileno(), 2)
                yield told
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            said.seek(0)
            told += said.read().decode(errors="replace").splitlines()


def read_mask(path: str | Path, name: str = "mask") -> BoolArray:
    """Read a mask: pixels that are not zero in an 8-bit PNG or a `.npy` array of two values.

    Args:
        path: The file; no JPEG, whose compression puts small values around the mask, and no picture
            in colours.
        name: What to call it in errors.

    Returns:
        Shape (H, W) bool.

    Raises:
        FileNotFoundError: No such file.
        ValueError: Not a whole image, a JPEG, in colours, not of 8 bits, transparent, not
            numbers, or of more values than 0 and another.
    """
    if Path(path).suffix.lower() == ".npy":
        stored: NDArray[Any] = _read_npy(Path(path), name)
        kind = stored.dtype.kind
        if kind not in "biuf" or (kind == "f" and not np.isin(stored, (0, 1)).all()):
            raise ValueError(
                f"{name} {path} must hold bool, whole numbers, or 0 and 1, got {stored.dtype}"
            )
    else:
        stored = _read_image(path, name, lossless=True)
        if stored.ndim == 3 and (stored[..., :3] == stored[..., :1]).all():
            stored = stored[..., 0]
        if stored.ndim != 2 or stored.dtype != np.uint8:
            raise ValueError(
                f"{name} {path} must be an 8-bit image without colours, got {_kind(stored)}"
            )
    if stored.ndim != 2:
        raise ValueError(f"{name} {path} must be (H, W), got {stored.shape} {stored.dtype}")
    values = np.unique(stored)
    if values.size > 2 or (values.size == 2 and values[0] != 0):
        raise ValueError(
            f"{name} {path} must hold 0 and one other value, got {values.size} of them "
            f"({short(values.tolist())}): a soft border, or several objects"
        )
    return np.asarray(stored != 0)


def read_hand(path: str | Path) -> NDArray[np.float64]:
    """Read 21 hand keypoints in the camera frame, metres, shape (21, 3).

    Args:
        path: JSON (a list of 21 `[x, y, z]`, or an object with that list as `keypoints`), text
            (21 lines `x y z`, spaces or commas) or `.npy`; order wrist, then thumb, index, middle,
            ring, little finger.

    Raises:
        FileNotFoundError: No such file.
        ValueError: Not 21 times 3 finite numbers.
    """
    path = Path(path)
    check_there(path, "hand")
    try:
        if path.suffix.lower() == ".npy":
            stored = _read_npy(path, "hand")
            if stored.dtype.kind not in "fiu":
                raise ValueError(f"got {_kind(stored)}")
            return check_keypoints(stored)
        if path.suffix.lower() == ".json":
            values = read_json(path)
            if isinstance(values, dict):
                if "keypoints" not in values:
                    raise ValueError(f"no entry 'keypoints' among {sorted(values)}")
                if unknown := sorted(values.keys() - _HAND_WORDS):
                    raise ValueError(
                        f"unknown entry {short(unknown[0])}, expected {', '.join(_HAND_WORDS)}"
                    )
                for name, meant in (("unit", "m"), ("frame", "camera")):
                    if values.get(name, meant) != meant:
                        raise ValueError(f"{name} must be {meant!r}, got {short(values[name])}")
                if not isinstance(accepted := values.get("accepted", True), bool):
                    raise ValueError(f"accepted must be true or false, got {short(accepted)}")
                if not accepted:
                    raise ValueError(
                        "what 'hadr restore' found there was not accepted as a hand: "
                        f"{short(values.get('problems'))}"
                    )
                values = values["keypoints"]
            rows = [[checked_number("a coordinate", x) for x in row] for row in values]
            return check_keypoints(rows)
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
        rows = [_numbers(number, line) for number, line in enumerate(lines, 1)]
        return check_keypoints([row for row in rows if row])
    except (ValueError, TypeError, RecursionError) as error:
        raise ValueError(
            f"hand {path} must hold 21 keypoints x y z in metres as JSON, text or .npy: "
            f"{str(error)[:300]}"
        ) from error


def _numbers(number: int, line: str) -> list[float]:
    """What stands in a line of text, which may be empty."""
    try:
        return [float(x) for x in line.replace(",", " ").split()]
    except ValueError as error:
        raise ValueError(f"line {number} holds {short(line)}, expected three numbers") from error


def write_depth_png(path: Path, depth: FloatArray, scale: float = DEFAULT_DEPTH_SCALE) -> None:
    """Write depth (H, W), metres, as 16-bit PNG: `round(depth / scale)`, 0 if missing or far."""
    units = np.where(valid_depth(depth), np.rint(np.nan_to_num(depth) / scale), 0)
    units = np.where(units <= np.iinfo(np.uint16).max, units, 0)
    write_image(path, units.astype(np.uint16))


def write_image(path: Path, image: NDArray[Any]) -> None:
    """Write a one-channel or RGB image, the format chosen by the suffix."""
    pixels = cv2.cvtColor(image, cv2.COLOR_RGB2BGR) if image.ndim == 3 else image
    done, encoded = cv2.imencode(path.suffix, pixels)
    if not done:
        raise ValueError(f"{path.name}: an image of {_kind(image)} cannot be encoded")
    path.write_bytes(encoded.tobytes())


def write_point_cloud(
    path: Path, depth: FloatArray, color: NDArray[np.uint8], camera: Intrinsics
) -> int:
    """Write the pixels with depth as a coloured point cloud, binary PLY, and count them."""
    import trimesh

    points = back_project(depth, camera)
    valid = valid_depth(depth)
    cloud = trimesh.PointCloud(points[valid].astype(np.float32), colors=color[valid])
    path.write_bytes(cloud.export(file_type="ply"))
    return int(valid.sum())


def read_point_colors(path: Path) -> NDArray[np.uint8]:
    """Read the colours of what `write_point_cloud` wrote, shape (N, 3).

    Raises:
        FileNotFoundError: No such file.
        ValueError: Not a whole PLY file with colours.
    """
    import trimesh

    check_there(path, "cloud")
    try:
        colors = np.asarray(trimesh.load(path).colors, dtype=np.uint8)
    except Exception as error:  # whatever the library says of a damaged file
        raise ValueError(f"cloud {path} is not a whole PLY file: {error!r}") from error
    return colors.reshape(-1, 4)[:, :3] if colors.size else np.zeros((0, 3), np.uint8)


def check_there(path: Path, name: str) -> None:
    """Raise ValueError for a folder or too large a file, FileNotFoundError where there is none.

    `name` is what it holds.
    """
    if path.is_dir():
        raise ValueError(f"{name} {path} is a folder, expected a file")
    if not path.is_file():
        what = "is a pipe or a device" if path.exists() else "does not exist"
        raise FileNotFoundError(f"{name} file {path} {what}")
    check_size(path)


def _read_npy(path: Path, name: str) -> NDArray[Any]:
    check_there(path, name)
    try:
        # Without setting aside what the header says; neither .npz nor pickle.
        stored = np.lib.format.open_memmap(path, mode="r")
        if further := path.stat().st_size - stored.offset - stored.nbytes:
            raise ValueError(f"behind its first array are {further} further bytes")
    except Exception as error:  # whatever Python's parser says of a damaged header
        why = str(error).partition("\n")[0] or type(error).__name__
        raise ValueError(f"{name} {path} is not a whole .npy file of numbers: {why}") from error
    if stored.size > LARGEST_IMAGE:
        raise ValueError(f"{name} {path} has {stored.size} numbers, at most {LARGEST_IMAGE}")
    return np.array(stored)


def _read_image(path: str | Path, name: str, *, lossless: bool = False) -> NDArray[Any]:
    path = Path(path)
    check_there(path, name)
    data = path.read_bytes()
    if lossless and data.startswith(JPEG_START):
        raise ValueError(
            f"{name} {path} is a JPEG, whose compression blurs a mask's border; expected a PNG "
            "(0 or 255) or a .npy"
        )
    try:
        with quiet() as told:
            image = decode_image(data, cv2.IMREAD_UNCHANGED)
    except ValueError as error:
        raise ValueError(f"{name} {path} is not a whole image, PNG or JPEG: {error}") from error
    if damage := [line for line in told if _JPEG_DAMAGE.match(line)]:
        raise ValueError(
            f"{name} {path} is a damaged JPEG, whose decoder made a part of it up ({damage[0]}); "
            "if it looks right, save it anew"
        )
    turn, grey = _marks(data)
    if turn != 1:
        raise ValueError(
            f"{name} {path} is stored turned or mirrored (its EXIF orientation is {turn}, expected "
            "1 or none): save it upright, as depth, mask and intrinsics must be, too"
        )
    flat = image.ndim == 2
    clear = image == grey if flat else image[..., 3:] < np.iinfo(image.dtype).max
    if (not flat or grey) and clear.any():
        raise ValueError(
            f"{name} {path} is transparent in {int(clear.sum())} of its {clear.size} pixels, "
            "expected an opaque picture"
        )
    return image


def _marks(data: bytes) -> tuple[int, Any]:
    """How a picture is to be turned to be shown (EXIF; 1: not), and what grey is transparent."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # damage in what stands beside the picture
        try:
            with Image.open(io.BytesIO(data)) as picture:
                turn = int(picture.getexif().get(ExifTags.Base.Orientation, 1))
                return turn, picture.info.get("transparency")
        except Exception:  # what Pillow says of a damaged EXIF is of many kinds; it then turns none
            return 1, None


def _kind(image: NDArray[Any]) -> str:
    return f"shape {image.shape} {image.dtype}"
