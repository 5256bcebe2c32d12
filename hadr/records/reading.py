"""What others may have written, read with care: regular files, JSON, and records by their schema.

A wrong file becomes one `ValueError` that names file, field and value; nothing is converted
silently ("64" is no number, 1.5 no count, true neither).
"""

from __future__ import annotations

import io
import json
import stat
import sys
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import cattrs
from cattrs.gen import make_dict_structure_fn

from hadr.records.provenance import IF_CHANGED

if TYPE_CHECKING:
    import numpy.typing as npt

T = TypeVar("T")
LARGEST_FILE = 1 << 30
"""Bytes of the largest picture or record that is read."""


def read_bytes(path: str | Path) -> bytes:
    """Read a regular file whole.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It is a folder, a device or a pipe, or has more than `LARGEST_FILE` bytes.
    """
    path = Path(path)
    if not stat.S_ISREG(path.stat().st_mode):
        raise ValueError(f"{path} is no regular file")
    check_size(path)
    return path.read_bytes()


def check_size(path: Path) -> None:
    """Raise a ValueError for a file of more than `LARGEST_FILE` bytes."""
    if (size := path.stat().st_size) > LARGEST_FILE:
        raise ValueError(f"{path} has {size} bytes, the most are {LARGEST_FILE}")


def parse_json(text: str | bytes, where: str | Path) -> Any:
    """Parse JSON in which no name stands twice in one object; errors name `where`."""
    try:
        words = text if isinstance(text, str) else text.decode("utf-8-sig")
        return json.loads(words, object_pairs_hook=_once_each)
    except RecursionError as error:
        raise ValueError(f"{where} is JSON that is nested too deeply") from error
    except ValueError as error:  # also of the decoder of UTF-8
        raise ValueError(f"{where} is not valid JSON: {error}") from error


def read_json(path: str | Path) -> Any:
    """Read a JSON file; errors as `read_bytes` and `parse_json`."""
    return parse_json(read_bytes(path), path)


def structured(
    value: Any, kind: type[T], where: str | Path, *, further: bool = False, infinite: bool = False
) -> T:
    """Build a dataclass, or a type made of lists and names, from what JSON holds.

    Fields with metadata `IF_CHANGED` may be left out; `further` leaves other names aside, which
    else are refused; `infinite` lets numbers be so.

    Raises:
        ValueError: A value is missing, of another kind, unknown, or refused by the dataclass; the
            message names the file (`where`), field and value.
    """
    try:
        _check_form(value, kind)
        return _converter(further, infinite).structure(value, kind)
    except (cattrs.BaseValidationError, ValueError, TypeError, AttributeError) as error:
        text, _, name = cattrs.transform_error(error, "$", _said)[0].rpartition(" @ $")
        parts = (str(where), name.removeprefix("."), text)
        raise ValueError(": ".join(part for part in parts if part)) from error


def read_arrays(path: str | Path, schema: Mapping[str, str]) -> dict[str, npt.NDArray[Any]]:
    """Read an .npz that somebody may have written.

    Args:
        path: The file.
        schema: The kind and shape of each array in it, such as ``"f4 steps 3 4"``, ``"U"`` for a
            text; a word stands for a length, the same one wherever it stands.

    Returns:
        The arrays by name.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It is cut off or damaged, lacks an array or has a further one, or one is of
            another kind or shape; the message names file and array.
    """
    import numpy as np

    data = read_bytes(path)
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            arrays = {name: np.asarray(file[name]) for name in file.files}
    except Exception as error:  # zipfile, zlib and NumPy's header raise a dozen kinds
        why = "" if "allow_pickle" in str(error) else f": {error}"  # which is no advice for a user
        raise ValueError(f"{path} is no .npz of arrays, or is cut off or damaged{why}") from error
    if wrong := sorted(arrays.keys() ^ schema.keys()):
        said = "lacks the array" if wrong[0] in schema else "has an unknown array,"
        raise ValueError(f"{path} {said} {wrong[0]!r}")
    lengths: dict[str, int] = {}
    for name, words in schema.items():
        kind, *sizes = words.split()
        found = arrays[name]
        shape = found.shape
        if len(shape) == len(sizes):
            lengths |= {s: n for s, n in zip(sizes, shape, strict=True) if s not in lengths}
        wanted = tuple(int(s) if s.isdigit() else lengths.get(s, -1) for s in sizes)
        if not np.issubdtype(found.dtype, np.dtype(kind).type) or shape != wanted:
            raise ValueError(
                f"{path}: {name} must be {words}, got {found.dtype.str[1:]} {shape or ''}, "
                f"where {lengths}"
            )
    return arrays


def _said(error: BaseException, kind: type | None) -> str:
    if isinstance(error, cattrs.ForbiddenExtraKeysError):
        return f"has the unknown field {min(error.extra_fields)}"
    if isinstance(error, TypeError | AttributeError):
        return "is of another form than expected"
    return str(error)


def _once_each(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        twice = next(name for name, _ in pairs if sum(name == other for other, _ in pairs) > 1)
        raise ValueError(f"the name {twice!r} stands there twice")
    return found


@cache
def _converter(further: bool, infinite: bool) -> cattrs.Converter:
    converter = cattrs.Converter()
    most = float("inf") if infinite else sys.float_info.max

    def number(value: Any, _: type) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= most:
            raise ValueError(f"must be a number, got {value!r:.60}")
        return float(value)

    def count(value: Any, _: type) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or abs(value) >= 1 << 63:
            raise ValueError(f"must be a whole number, got {value!r:.60}")
        return value

    def switch(value: Any, _: type) -> bool:
        if not isinstance(value, bool):
            raise ValueError(f"must be true or false, got {value!r:.60}")
        return value

    def words(value: Any, _: type) -> str:
        if not isinstance(value, str):
            raise ValueError(f"must be text, got {value!r:.60}")
        return value

    def choice(kind: Any) -> Any:
        def one_of(value: Any, _: type) -> Any:
            if not isinstance(value, str | int) or value not in get_args(kind):
                known = ", ".join(map(repr, get_args(kind)))
                raise ValueError(f"must be one of {known}, got {value!r:.60}")
            return value

        return one_of

    def parts(kind: Any) -> Any:
        build = make_dict_structure_fn(kind, converter, _cattrs_forbid_extra_keys=not further)
        hints = get_type_hints(kind)
        needed = [part.name for part in fields(kind) if part.metadata != IF_CHANGED]

        def structure(value: Any, _: type) -> Any:
            _check_form(value, dict)
            if missing := [name for name in needed if name not in value]:
                raise ValueError(f"lacks {', '.join(missing)}")
            for name in hints.keys() & value.keys():
                try:
                    _check_form(value[name], hints[name])
                except ValueError as error:
                    raise ValueError(f"{name}: {error}") from error
            return build(value, kind)

        return structure

    for kind, hook in ((float, number), (int, count), (bool, switch), (str, words)):
        converter.register_structure_hook(kind, hook)
    converter.register_structure_hook_factory(_is_choice, choice)
    converter.register_structure_hook_factory(is_dataclass, parts)
    return converter


def _is_choice(kind: Any) -> bool:
    return get_origin(kind) is Literal


def _check_form(value: Any, hint: Any) -> None:
    """Refuse what is no list, or no object, where one belongs."""
    choices = get_args(hint) if NoneType in get_args(hint) else (hint,)
    if value is None and NoneType in choices:
        return
    forms = {get_origin(one) or one for one in choices}
    if forms & {list, tuple} and not isinstance(value, list | tuple):
        raise ValueError(f"must be a list, got {value!r:.60}")
    if dict in forms and not isinstance(value, Mapping):
        raise ValueError(f"must be named values, got {value!r:.60}")
