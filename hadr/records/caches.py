"""Results that are computed once and kept: no caller can spoil them, and a changed file is noticed.

`functools.lru_cache` hands the same object to every caller. Who scales a kept array in place would
change it for everybody until the session ends; so all arrays in a kept result are read-only, as are
its dataclasses' dictionaries, and `array.copy()` gives one's own. What was read from a file is kept
for as long as the file's time and size stay the same.
"""

from __future__ import annotations

import copyreg
import hashlib
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import _lru_cache_wrapper, lru_cache, wraps
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
from threadpoolctl import threadpool_limits

Result = TypeVar("Result")


def _as_dictionary(view: Any) -> Any:
    """How a view is copied, in this process or to another: as a dictionary of one's own."""
    return dict, (dict(view),)


copyreg.pickle(MappingProxyType, _as_dictionary)


def read_only(value: Result) -> Result:
    """Forbid writing to an array, or to all arrays in a tuple, list, dictionary or dataclass.

    In the place of a dataclass's dictionaries stand views of them, and anything else in what is
    kept stays as it is; gives the same object.
    """
    parts: Any = ()
    if isinstance(value, np.ndarray):
        value.flags.writeable = False
    elif isinstance(value, tuple | list):
        parts = value
    elif isinstance(value, dict | MappingProxyType):
        parts = value.values()
    elif is_dataclass(value) and not isinstance(value, type):
        parts = [getattr(value, field.name) for field in fields(value)]
        for field, part in zip(fields(value), parts, strict=True):
            if isinstance(part, dict):
                object.__setattr__(value, field.name, MappingProxyType(part))
    for part in parts:
        read_only(part)
    return value


def kept(maxsize: int) -> Callable[[Callable[..., Result]], _lru_cache_wrapper[Result]]:
    """Decorate a function as `functools.lru_cache` does; its results become `read_only`.

    It runs on one thread of OpenBLAS, which rounds otherwise when it shares a product out: whoever
    asks first does not decide the last digit.

    Args:
        maxsize: How many results are kept, those asked for last.
    """

    def decorate(function: Callable[..., Result]) -> _lru_cache_wrapper[Result]:
        @lru_cache(maxsize=maxsize)
        @wraps(function)
        def computed(*args: Any, **kwargs: Any) -> Result:
            with threadpool_limits(1, user_api="blas"):
                return read_only(function(*args, **kwargs))

        return computed

    return decorate


def kept_by_file(
    maxsize: int,
) -> Callable[[Callable[..., Result]], Callable[..., Result]]:
    """Decorate a function of paths alone as `kept` does, of so many results.

    It is called anew where the time or size of a file differs, or a file has come or gone.
    """

    def decorate(function: Callable[..., Result]) -> Callable[..., Result]:
        @kept(maxsize)
        def then(paths: tuple[Path, ...], states: tuple[object, ...]) -> Result:
            return function(*paths)

        @wraps(function)
        def now(*paths: Path) -> Result:
            return then(paths, tuple(map(_state, paths)))

        return now

    return decorate


def _state(path: Path) -> tuple[int, int] | None:
    """Time and size of a file; None where there is none."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size


@kept_by_file(64)
def file_sha256(path: Path) -> str:
    """SHA-256 of a file: 64 hexadecimal digits."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
