"""Where a number comes from, and JSON files that can hold it.

Every measured table carries the versions, the machine and the commit it was measured with.
"""

import contextlib
import datetime
import importlib.metadata
import json
import os
import platform
import subprocess
from collections.abc import Mapping
from dataclasses import asdict, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

from hadr.records.writing import write_whole

IF_CHANGED: Mapping[str, bool] = {"recorded if changed": True}
"""Metadata of a dataclass field that joined after configurations were recorded (`record_of`)."""
PROVENANCE_PACKAGES = (
    *("hadr", "numpy", "scipy", "torch", "transformers", "trimesh", "embreex"),
    *("opencv-python-headless", "mitsuba", "pyoidn", "mujoco", "mink"),
)


def machine_text() -> str:
    """The machine in a few words: system, processor family, CPU cores, Python."""
    system = f"{platform.system()} {platform.machine()}"
    return f"{system}, {usable_cores()} CPU cores, Python {platform.python_version()}"


def usable_cores() -> int:
    """The CPU cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def provenance() -> dict[str, Any]:
    """Where a number comes from: versions, machine, time, and the library's commit if it is known.

    The commit is that of the process's first call: what measures for long calls when it begins.
    Without git, or installed apart from its checkout, the library's ``commit`` and
    ``uncommitted_changes`` are None: unknown.
    """
    versions = {}
    for package in PROVENANCE_PACKAGES:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            versions[package] = importlib.metadata.version(package)
    return {
        "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "cpu_cores": usable_cores(),
        "machine": machine_text(),
        "versions": versions,
        **_commit(),
    }


@cache  # what this process has loaded does not change
def _commit() -> dict[str, Any]:
    """The library's own commit and whether code beside it differs; None where it is in none."""
    root = Path(__file__).resolve().parents[2]
    top = _git(root, "rev-parse", "--show-toplevel")
    tracked = _git(root, "ls-files", "--error-unmatch", "hadr/records/provenance.py")
    if top is None or tracked is None or Path(top).resolve() != root:
        return {"commit": None, "uncommitted_changes": None}
    status = _git(root, "status", "--porcelain", "--", "*.py", "hadr")
    return {
        "commit": _git(root, "rev-parse", "HEAD"),
        "uncommitted_changes": None if status is None else bool(status),
    }


def _git(folder: Path, *words: str) -> str | None:
    """What git says in a folder; None where it is not installed or fails."""
    environment = {name: v for name, v in os.environ.items() if not name.startswith("GIT_")}
    try:
        answer = subprocess.run(
            ["git", "-C", str(folder), *words],
            env=environment,
            capture_output=True,
            text=True,
            timeout=10,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return answer.stdout.strip() if answer.returncode == 0 else None


def record_of(config: Any) -> dict[str, Any]:
    """Bring a dataclass to built-in types, in a form that stays the same as fields join.

    Fields with metadata `IF_CHANGED` that have their default are left out: so older records, and
    their digests, stay valid.
    """
    values: dict[str, Any] = asdict(config)
    for one in fields(config):
        own = getattr(config, one.name)
        if one.metadata == IF_CHANGED and own == one.default:
            del values[one.name]
        elif is_dataclass(own):
            values[one.name] = record_of(own)
    return values


def plain(value: Any, where: str = "results") -> Any:
    """Turn numpy and torch values, paths and dataclasses into what JSON can hold.

    Args:
        value: Any nesting of mappings, sequences, numbers, arrays, strings and None.
        where: The value's name in an error message.

    Returns:
        The same with built-in types; NaN and infinite numbers become None.

    Raises:
        TypeError: A value has no form in JSON; the message says where it stands.
    """
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        return value if value - value == 0 else None
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value), where)
    if isinstance(value, Mapping):
        return {str(key): plain(item, f"{where}.{key}") for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item, f"{where}[{index}]") for index, item in enumerate(value)]
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "tolist"):
        return plain(value.tolist(), where)
    raise TypeError(
        f"{where} is a {type(value).__name__}, which JSON cannot hold; expected numbers, "
        "strings, lists, mappings, arrays or dataclasses"
    )


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write JSON atomically: a reader sees the old file or the whole new one."""
    text = json.dumps(plain(content), indent=2, ensure_ascii=False, allow_nan=False)
    write_whole(path, text + "\n")


def write_results(
    out_dir: str | Path, name: str, results: Mapping[str, Any], **parameters: str | int
) -> dict[str, Any]:
    """Keep what a chapter, such as ``03_ray_voxels``, measured, as ``results.json``.

    Numbers, strings, lists and arrays may be nested; parameters are the run's. An empty `out_dir`
    writes nothing, for readers who only look. Gives what was, or would have been, written.
    """
    content: dict[str, Any] = {
        "chapter": name,
        "parameters": parameters,
        "results": plain(results),
        "provenance": provenance(),
    }
    if str(out_dir):
        write_json(Path(out_dir) / "results.json", content)
    return content
