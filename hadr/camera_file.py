"""Camera files: the intrinsics that calibrations and drivers leave on disk, in their own forms.

Read are, as YAML or JSON, the six numbers by name; a matrix K with the size; what ROS prints of a
`camera_info` topic and what its `camera_calibration` writes; and OpenCV's FileStorage. Whatever
stands beside the numbers is either known to mean nothing for a pinhole, or refused.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from reprlib import repr as short
from typing import Any

import numpy as np
import yaml

from hadr.camera import Intrinsics, checked_matrix
from hadr.frame_io import check_there
from hadr.records.reading import read_json

#: Names that calibrations give to a lens's distortion: OpenCV's, ROS's, librealsense's, COLMAP's.
_DISTORTION = re.compile(
    r"(.*distortion(?!_model).*|dist(_?coeffs?)?|coeffs|d|k[1-6]|p[12]|fisheye(_model)?)", re.I
)
_FORM = ("rows", "cols", "dt", "type_id")
_SKEW = re.compile(r"skew.*|s|gamma", re.I)
_MODEL = re.compile(r"((camera|lens|distortion|projection)_?)?(model|type)|projection", re.I)
_PINHOLE = re.compile(
    r".*pinhole|perspective|rectilinear|(distortion\.)?none|plumb_bob|rational_polynomial"
    r"|.*brown_conrady|",
    re.I,
)
"""Models that are a pinhole where nothing distorts; "" is a driver's that knows none."""
_NOTES = re.compile(
    r"((camera|sensor)_?)?(name|id)|serial(_?number)?|comment|notes?|fps|date|header"
    r"|calibration_(time|date)|n(r_of_)?frames|(board|square|marker)_(size|width|height)|flags"
    r"|(fix_)?aspect_?ratio|(avg|per_view)_reprojection_errors?|extrinsic_parameters"
    r"|(image|grid)_points",
    re.I,
)
_NAMES = {
    **{name: "width" for name in ("xres", "image_width")},
    **{name: "height" for name in ("yres", "image_height")},
    **{"ppx": "cx", "ppy": "cy"},
    **{name: "K" for name in ("k", "camera_matrix")},
    **{name: "P" for name in ("p", "projection_matrix")},
    **{name: "R" for name in ("r", "rectification_matrix")},
}
"""What ClearGrasp, librealsense, ROS and OpenCV call things."""


def load_intrinsics(path: str | Path) -> Intrinsics:
    """Read intrinsics from a ``.yaml``, ``.yml`` or ``.json`` file.

    These forms are understood: ``fx fy cx cy width height``; the same with ``xres yres`` for
    the size, as ClearGrasp publishes them; librealsense's ``ppx ppy`` for the centre; ``K`` (3, 3)
    with ``width height``; ROS's ``camera_info``, as ``rostopic echo`` and ``ros2 topic echo``
    print it, and the file of its ``camera_calibration``; OpenCV's FileStorage with ``camera_matrix
    image_width image_height``. Beside them may stand a distortion or skew of zero, a pinhole's
    model, a rectification that changes nothing, the whole image as region, and what `_NOTES` names.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file can't be parsed, a number is missing, stands there twice or in
            conflict with another; the lens distorts, is no pinhole or has a skew; or there is an
            entry of unknown meaning.
    """
    path = Path(path)
    check_there(path, "intrinsics")
    try:
        if path.suffix.lower() == ".json":
            values = read_json(path)
        else:
            values = _read_yaml(path.read_text(encoding="utf-8", errors="replace"))
    except (ValueError, yaml.YAMLError, RecursionError) as error:
        why = " ".join(str(error).split())[:300]
        raise ValueError(f"intrinsics {path} are neither valid YAML nor JSON: {why}") from error
    if not isinstance(values, Mapping):
        raise ValueError(f"{path} must hold named values (fx, fy, cx, cy, width, height)")
    try:
        return _one_camera(values)
    except (TypeError, ValueError, RecursionError) as error:
        raise ValueError(f"intrinsics {path}: {error}") from error


class _Loader(yaml.SafeLoader):  # type: ignore[misc]
    """Numbers as in YAML 1.2, and no name twice, of which the plain loader takes the last."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        names = [str(key.value) for key, _ in node.value]
        if twice := [name for name in names if names.count(name) > 1]:
            raise ValueError(f"the name {twice[0]!r} stands there twice")
        return dict(super().construct_mapping(node, deep))


_FLOAT, _INT = "tag:yaml.org,2002:float", "tag:yaml.org,2002:int"
_Loader.yaml_implicit_resolvers = {
    first: [kind for kind in kinds if kind[0] not in (_FLOAT, _INT)]
    for first, kinds in yaml.SafeLoader.yaml_implicit_resolvers.items()
}  # YAML 1.1 reads 6:38 as 398, 0640 as 416, and 1e-5 as a word
_Loader.add_implicit_resolver(_INT, re.compile(r"-?(0|[1-9][0-9]*)$"), [*"-0123456789"])
_Loader.add_implicit_resolver(
    _FLOAT,
    re.compile(r"[-+]?((\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|\.(inf|Inf|INF))$|\.nan$"),
    [*"-+.0123456789"],
)
_Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", _Loader.construct_yaml_map)


def _plain_number(loader: _Loader, node: yaml.Node) -> Any:
    """A number with an explicit tag, as without one."""
    plain = loader.resolve(yaml.ScalarNode, node.value, (True, False))
    if plain not in (_FLOAT, _INT):
        raise ValueError(f"{node.value!r} is no number")
    build = loader.construct_yaml_int if plain == _INT else loader.construct_yaml_float
    return build(node)


_Loader.add_constructor(_INT, _plain_number)
_Loader.add_constructor(_FLOAT, _plain_number)


def _read_yaml(text: str) -> Any:
    """The file's only document, or what several messages of a topic have in common."""
    text = re.sub(r"\A%YAML:1\.0\s*$", "", text, count=1, flags=re.MULTILINE)  # OpenCV's first line
    found = [one for one in yaml.load_all(text, _Loader) if one is not None]
    for one in found:
        if isinstance(one, dict):
            one.pop("header", None)
    if any(one != found[0] for one in found):
        raise ValueError(f"{len(found)} cameras stand there, which differ")
    return found[0] if found else None


def _one_camera(values: Mapping[str, Any]) -> Intrinsics:
    """The intrinsics that all of the values agree on, of a lens that does not distort."""
    given: dict[str, Any] = {}

    def agreed(name: str, value: Any) -> None:
        if given.setdefault(name, value) != value:
            raise ValueError(f"{name} is {short(given[name])}, but also {short(value)}")

    for name, value in values.items():
        agreed(_NAMES.get(name, name), value)
    if "K" in given:
        for name, value in checked_matrix(_matrix("K", given.pop("K"), 3)).items():
            agreed(name, value)
    turn = given.pop("R", None)
    if not _is_zero(turn) and not np.array_equal(_matrix("R", turn, 3), np.eye(3)):
        raise ValueError(f"R = {short(turn)} turns the camera, expected no rectification")
    projection = given.pop("P", None)
    if not _is_zero(projection):  # as a driver leaves it that knows none
        rows = [row[:3] for row in _matrix("P", projection, 4)]
        for name, value in checked_matrix(rows).items():
            agreed(name, value)
    _check_whole_image(given)
    known = {field.name for field in fields(Intrinsics)}
    for name, value in given.items():
        if name not in known:
            _check_harmless(str(name), value)
    return Intrinsics.from_dict(given)


def _matrix(name: str, value: Any, columns: int) -> Any:
    """Three rows of a matrix: nested, row after row in one list, or with rows, cols and data."""
    if isinstance(value, Mapping):
        if (value.get("rows"), value.get("cols")) != (3, columns):
            raise ValueError(
                f"{name} must have 3 rows and {columns} cols, got {short(dict(value))}"
            )
        value = value.get("data")
    if np.shape(value) == (3 * columns,):
        value = [value[at : at + columns] for at in range(0, 3 * columns, columns)]
    if np.shape(value) != (3, columns):
        raise ValueError(f"{name} must have shape (3, {columns}), got {np.shape(value)}")
    return value


def _check_whole_image(given: dict[str, Any]) -> None:
    """Take out what says that the image is all of the sensor; refuse a part, or a binned one."""
    for name in ("binning_x", "binning_y"):
        if (count := given.pop(name, 0)) not in (0, 1):
            raise ValueError(f"{name} = {short(count)}: the numbers are of another size")
    roi = given.pop("roi", None) or {}
    if not isinstance(roi, Mapping):
        raise ValueError(f"roi must hold named values, got {short(roi)}")
    whole = {"width": (0, given.get("width")), "height": (0, given.get("height"))}
    places = ("x_offset", "y_offset", *whole)
    if strange := [name for name in roi if name not in (*places, "do_rectify")]:
        raise ValueError(
            f"roi: {short(strange[0])} is not understood, expected {', '.join(places)}"
        )
    for name in places:
        if roi.get(name, 0) not in whole.get(name, (0,)):
            raise ValueError(
                f"roi: {name} = {short(roi[name])}: the image is a part of another one"
            )


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
        return all(_is_zero(v) for name, v in value.items() if name not in _FORM)
    if isinstance(value, list):
        return all(map(_is_zero, value))
    return value is None or bool(value == 0)
