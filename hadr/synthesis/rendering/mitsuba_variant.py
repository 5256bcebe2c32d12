"""Which variant of Mitsuba draws here: tried out in a child process, once for an environment.

``llvm_ad_rgb`` compiles its kernels with the LLVM that Dr.Jit finds, ``scalar_rgb`` needs none and
is slower. An LLVM that can't do it ends the whole process, so this process never finds that out.
"""

from __future__ import annotations

import glob
import hashlib
import importlib
import importlib.metadata
import importlib.util
import json
import os
import platform
import re
import sys
from contextlib import nullcontext, suppress
from functools import cache
from pathlib import Path
from typing import Any

from hadr.frame_io import quiet
from hadr.records.provenance import write_json
from hadr.records.result_file import digest
from hadr.synthesis.rendering.child_process import call_in_child

LLVM, SCALAR = "llvm_ad_rgb", "scalar_rgb"
#: Name of the environment variable that chooses the variant, and spares ``llvm_ad_rgb`` the trial.
VARIANT_VARIABLE = "HADR_MITSUBA_VARIANT"
#: LLVM 15 can't compile minima and maxima for AVX-512.
OLDEST_LLVM = 17
#: How drawing becomes faster, or possible with ``llvm_ad_rgb``.
REMEDY = f"install LLVM {OLDEST_LLVM} or newer (on Debian: apt install libllvm19)"
#: What trials said, for each combination of what they depend on.
RECORD = "hadr-mitsuba.json"
#: Seconds for a trial, which takes about five.
PATIENCE = 120.0

#: Words of a failure that says nothing of LLVM.
_PASSING = ("SIGKILL", "SIGTERM", "SIGINT", "bad_alloc", "memory", "No space left")
_PACKAGES = ("mitsuba", "drjit", "pyoidn")
#: Where Dr.Jit and the system's loader look for LLVM.
_LIBRARIES = (
    "/etc/ld.so.cache",
    "/usr/lib*/libLLVM*",
    "/usr/lib/*/libLLVM*",
    "/opt/homebrew/opt/llvm/lib/libLLVM*",
)
_FOLDERS = ("LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH")
_PROCESSOR = ("vendor_id", "model name", "flags", "CPU part", "Features")


def mitsuba(variant: str | None = None) -> Any:
    """Import Mitsuba and choose its variant (:func:`mitsuba_variant` where it is left out).

    Raises:
        ValueError: Mitsuba is not installed, there is no such variant, or it can't be used here.
    """
    check_installed()
    variant = variant or mitsuba_variant()
    check_variant(variant)
    # Without an LLVM, which is not needed here, Dr.Jit complains as it is loaded.
    with quiet() if variant == SCALAR else nullcontext():
        mi = importlib.import_module("mitsuba")
    if mi.variant() != variant:
        mi.set_variant(variant)
    return mi


def check_installed() -> None:
    """Check that what path-traced pictures need is there; a ``ValueError`` says what to install."""
    for name in ("mitsuba", "pyoidn"):
        if importlib.util.find_spec(name) is None:
            raise ValueError(
                f"the photo engine needs {name}, which is not installed: pip install "
                "'hadr[generate]', or choose --engine raycast"
            )


def mitsuba_variant() -> str:
    """The variant to draw with: that of ``HADR_MITSUBA_VARIANT``, or the fastest that works here.

    Raises:
        ValueError: The environment variable names no variant that we use.
    """
    return wanted_variant() or (SCALAR if why_not_llvm() else LLVM)


def wanted_variant() -> str | None:
    """The variant that ``HADR_MITSUBA_VARIANT`` names, None where it names none.

    Raises:
        ValueError: It names none that we use.
    """
    wanted = os.environ.get(VARIANT_VARIABLE) or None
    if wanted:
        _check_name(wanted, VARIANT_VARIABLE)
    return wanted


def check_variant(variant: str) -> None:
    """Check that a variant can be used on this machine.

    Raises:
        ValueError: It can't, or there is no such variant; the message names machine and reason.
    """
    _check_name(variant)
    if variant == SCALAR:
        return
    trusted = os.environ.get(VARIANT_VARIABLE) == LLVM
    why = ("" if trusted else why_not_llvm()) or llvm_problem()
    if why:
        raise ValueError(
            f"the variant {LLVM} can't be used on {platform.node()}: {why}. Choose {SCALAR}, in "
            f"a new folder if frames were made, or {REMEDY}"
        )


def _check_name(variant: str, name: str = "variant") -> None:
    if variant not in (LLVM, SCALAR):
        raise ValueError(f"{name} must be {LLVM!r} or {SCALAR!r}, got {variant!r}")


@cache
def why_not_llvm() -> str:
    """Why ``llvm_ad_rgb`` can't draw on this machine; empty where it can.

    The answer comes from a file beside the environment, or in the user's cache where that can't be
    written, or from :func:`hadr.synthesis.rendering.trial_picture.draw_trial` in a child process.
    """
    facts = _facts()
    key = digest(facts)
    for place in _places():
        known = _answers(place).get(key)
        if isinstance(known, dict) and isinstance(known.get("why_not"), str):
            return str(known["why_not"])
    try:
        why = call_in_child(llvm_problem, timeout=PATIENCE)
        if not why:
            from hadr.synthesis.rendering.trial_picture import (
                draw_trial,  # which draws with what stands here
            )

            environment = {VARIANT_VARIABLE: LLVM}
            why = call_in_child(draw_trial, timeout=PATIENCE, environment=environment)
    except Exception as error:
        why = f"a small picture can't be drawn, {error}"
        if isinstance(error, TimeoutError | MemoryError) or any(word in why for word in _PASSING):
            return why  # a want of time, memory or room is no answer for other processes
    for place in _places():
        with suppress(OSError):
            write_json(place, _answers(place) | {key: {"why_not": why, "facts": facts}})
            break
    return why


def llvm_problem() -> str:
    """What is wrong with the LLVM that Dr.Jit finds; empty where it is there and new enough.

    It is loaded into this process, and nothing is compiled with it.
    """
    drjit = importlib.import_module("drjit")
    # Three numbers as a tuple, in Dr.Jit 1.0 as text; -1 where there is no LLVM.
    version = re.findall(r"-?\d+", str(drjit.detail.llvm_version()))
    if int(version[0]) < 0:
        return "Dr.Jit finds no LLVM that it can use"
    if int(version[0]) < OLDEST_LLVM:
        return f"LLVM {'.'.join(version)} is too old"
    return ""


def _places() -> list[Path]:
    """Where the answers may be kept: beside the environment, or in the user's cache."""
    cache_home = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
    places = [Path(sys.prefix) / RECORD, cache_home / "hadr" / RECORD]
    return [place for place in places if place.is_absolute()]


def _answers(place: Path) -> dict[str, Any]:
    """What a file of answers holds; nothing where it is missing or broken."""
    try:
        answers = json.loads(place.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return answers if isinstance(answers, dict) else {}


def _facts() -> dict[str, Any]:
    """All that the trial's outcome depends on, told without loading a library."""
    versions = {}
    for package in _PACKAGES:
        with suppress(importlib.metadata.PackageNotFoundError):
            versions[package] = importlib.metadata.version(package)
    sources = ("mitsuba_variant", "mitsuba_scene", "photo", "trial_picture")
    content = b"".join(Path(__file__).with_name(f"{name}.py").read_bytes() for name in sources)
    named = os.environ.get("DRJIT_LIBLLVM_PATH", "")
    folders = [f for name in _FOLDERS for f in os.environ.get(name, "").split(os.pathsep) if f]
    patterns = [glob.escape(named), *(f"{glob.escape(f)}/libLLVM*" for f in folders), *_LIBRARIES]
    libraries = {}
    for path in sorted({path for pattern in patterns for path in glob.glob(pattern)}):
        if os.path.isfile(path):
            state = os.stat(path)
            libraries[path] = [state.st_size, state.st_mtime_ns]
    return {
        "trial": hashlib.sha256(content).hexdigest(),
        "versions": versions,
        "named": named,
        "libraries": libraries,
        "processor": _processor(),
    }


def _processor() -> list[str]:
    """The processor's name and what it can do."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return [platform.machine(), platform.processor()]
    return sorted({line for line in lines if line.startswith(_PROCESSOR)})
