"""An RGB-D frame's files: reading what a camera left on disk, writing what came out.

Every reader returns checked arrays in the library's units (metres, bool masks, RGB) or raises
one sentence that names the file, what is wrong with it and what is expected.
"""

from __future__ import annotations

import io
import os
import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from dataclasses import fields
from pathlib import Path
from reprlib import repr as short
from threading import Lock
from typing import Any

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from hadr.camera import (
    LARGEST_IMAGE,
    BoolArray,
    FloatArray,
    Intrinsics,
    back_project,
    checked_matrix,
    checked_number,
    valid_depth,
)
from hadr.data.frame_pictures import JPEG_START, decode_image
from hadr.hand import check_keypoints
from hadr.records.reading import read_json

DEFAULT_DEPTH_SCALE = 0.001
_QUIET = Lock()


def read_color(path: str | Path) -> NDArray[np.uint8]:
    """Read a PNG or JPEG colour image of 8 bits, opaque everywhere.

    Returns:
        RGB, shape (H, W, 3) uint8.

    Raises:
        FileNotFoundError: No such file.
        ValueError: Not a whole image, not 8-bit colour, or transparent somewhere.
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

    _check_file(path, name)
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
def quiet() -> Iterator[None]:
    """Hold back what a compiled library prints; its error reaches the user as one sentence."""
    with _QUIET:  # of two threads the second would put the first one's silence back
        sys.stderr.flush()
        kept = os.dup(2)
        try:
            with open(os.devnull, "wb") as nowhere, redirect_stdout(io.StringIO()):
                os.dup2(nowhere.fileno(), 2)
                yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)


def load_intrinsics(path: str | Path) -> Intrinsics:
    """Read intrinsics from a ``.yaml``, ``.yml`` or ``.json`` file.

    Three forms are understood: ``fx fy cx cy width height``; the same with ``xres yres`` for
    the size, as ClearGrasp publishes them; and ``K`` (3, 3) with ``width height``. Beside them may
    stand a distortion or skew of zero, a pinhole's model, and what `_NOTES` names.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file can't be parsed, a number is missing, stands there twice or in
            conflict with another; the lens distorts, is no pinhole or has a skew; or there is an
            entry of unknown meaning.
    """
    path = Path(path)
    _check_file(path, "intrinsics")
    try:
        if path.suffix.lower() == ".json":
            values = read_json(path)
        else:
            values = yaml.load(path.read_text(encoding="utf-8", errors="replace"), _EachOnce)
    except (ValueError, yaml.YAMLError, RecursionError) as error:
        why = " ".join(str(error).split())[:300]
        raise ValueError(f"intrinsics {path} are neither valid YAML nor JSON: {why}") from error
    if not isinstance(values, Mapping):
        raise ValueError(f"{path} must hold named values (fx, fy, cx, cy, width, height)")
    try:
        return _one_camera(values)
    except (TypeError, ValueError, RecursionError) as error:
        raise ValueError(f"intrinsics {path}: {error}") from error


class _EachOnce(yaml.SafeLoader):  # type: ignore[misc]
    """Refuses what the plain loader takes the last one of."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        names = [str(key.value) for key, _ in node.value]
        if twice := [name for name in names if names.count(name) > 1]:
            raise ValueError(f"the name {twice[0]!r} stands there twice")
        return dict(super().construct_mapping(node, deep))


#: Names that calibrations give to a lens's distortion: OpenCV's, ROS's, librealsense's, COLMAP's.
_DISTORTION = re.compile(r"(.*distortion(?!_model).*|dist(_?coeffs?)?|coeffs|d|k[1-6]|p[12])", re.I)
_SKEW = re.compile(r"skew.*|s|gamma", re.I)
_MODEL = re.compile(r"((camera|lens|distortion|projection)_?)?(model|type)|projection", re.I)
_PINHOLE = re.compile(
    r".*pinhole|perspective|rectilinear|none|plumb_bob|rational_polynomial|.*brown_conrady", re.I
)
"""Models that are a pinhole where nothing distorts."""
_NOTES = re.compile(
    r"((camera|sensor)_?)?(name|id)|serial(_?number)?|comment|notes?|fps|date", re.I
)
_SIZES = {"xres": "width", "yres": "height"}


def _one_camera(values: Mapping[str, Any]) -> Intrinsics:
    """The intrinsics that all of the values agree on, of a lens that does not distort."""
    others = {new: values[old] for old, new in _SIZES.items() if old in values}
    if "K" in values:
        others |= checked_matrix(values["K"])
    for name, value in others.items():
        if values.get(name, value) != value:
            raise ValueError(f"{name} is {short(values[name])}, but also {short(value)}")
    known = {"K", *_SIZES, *(field.name for field in fields(Intrinsics))}
    for name, value in values.items():
        if name not in known:
            _check_harmless(str(name), value)
    return Intrinsics.from_dict({**others, **values})


def _check_harmless(name: str, value: Any) -> None:
    """Refuse what makes another camera of the same numbers, or might."""
    said = f"{name} = {short(value)}"
    if _DISTORTION.fullmatch(name) and not _is_zero(value):
        raise ValueError(
            f"the lens distorts ({said}), which is not undone here: give undistorted images "
            "(OpenCV's undistort for the colour, initUndistortRectifyMap and remap with "
            "INTER_NEAREST for depth and mask) and their intrinsics"
        )
    if _MODEL.fullmatch(name) and value is not None and not _PINHOLE.fullmatch(str(value)):
        raise ValueError(f"the camera is no pinhole ({said}): give undistorted images")
    if _SKEW.fullmatch(name) and not _is_zero(value):
        raise ValueError(f"the camera has a skew ({said}), expected none")
    if not any(kind.fullmatch(name) for kind in (_DISTORTION, _MODEL, _SKEW, _NOTES)):
        raise ValueError(
            f"{said} is not understood, expected fx fy cx cy width height, or K width height; "
            "nothing else may change how pixels and rays belong together"
        )


def _is_zero(value: Any) -> bool:
    """Whether nothing but zeros stands there."""
    if isinstance(value, Mapping):
        return _is_zero(value.get("data", list(value.values())))
    if isinstance(value, list):
        return all(map(_is_zero, value))
    return value is None or bool(value == 0)


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
    _check_file(path, "hand")
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
                if values.get("accepted") is False:
                    raise ValueError(
                        "what 'hadr restore' found there was not accepted as a hand: "
                        f"{short(values.get('problems'))}"
                    )
                values = values["keypoints"]
            rows = [[checked_number("a coordinate", x) for x in row] for row in values]
            return check_keypoints(rows)
        lines = path.read_text(encoding="utf-8").splitlines()
        rows = [[float(x) for x in line.replace(",", " ").split()] for line in lines]
        return check_keypoints([row for row in rows if row])
    except (ValueError, TypeError, RecursionError) as error:
        raise ValueError(
            f"hand {path} must hold 21 keypoints x y z in metres as JSON, text or .npy: "
            f"{str(error)[:300]}"
        ) from error


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


def _check_file(path: Path, name: str) -> None:
    if path.is_dir():
        raise ValueError(f"{name} {path} is a folder, expected a file")
    if not path.is_file():
        raise FileNotFoundError(f"{name} file {path} does not exist")


def _read_npy(path: Path, name: str) -> NDArray[Any]:
    _check_file(path, name)
    try:
        # Without setting aside what the header says; neither .npz nor pickle.
        stored = np.lib.format.open_memmap(path, mode="r")
    except Exception as error:  # whatever Python's parser says of a damaged header
        why = str(error).partition("\n")[0] or type(error).__name__
        raise ValueError(f"{name} {path} is not a whole .npy file of numbers: {why}") from error
    if stored.size > LARGEST_IMAGE:
        raise ValueError(f"{name} {path} has {stored.size} numbers, at most {LARGEST_IMAGE}")
    return np.array(stored)


def _read_image(path: str | Path, name: str, *, lossless: bool = False) -> NDArray[Any]:
    path = Path(path)
    _check_file(path, name)
    data = path.read_bytes()
    if lossless and data.startswith(JPEG_START):
        raise ValueError(
            f"{name} {path} is a JPEG, whose compression blurs a mask's border; expected a PNG "
            "(0 or 255) or a .npy"
        )
    try:
        image = decode_image(data, cv2.IMREAD_UNCHANGED)
    except ValueError as error:
        raise ValueError(f"{name} {path} is not a whole image, PNG or JPEG: {error}") from error
    alpha = image[..., 3:] if image.ndim == 3 else image[:0]
    if clear := int((alpha < np.iinfo(image.dtype).max).sum()):
        raise ValueError(
            f"{name} {path} is transparent in {clear} of its {alpha.size} pixels (alpha below its "
            "most), expected an opaque picture"
        )
    return image


def _kind(image: NDArray[Any]) -> str:
    return f"shape {image.shape} {image.dtype}"
