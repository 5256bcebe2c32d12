"""Which variant of Mitsuba draws here: tried out in a child process, once in each process.

``llvm_ad_rgb`` compiles its kernels with the LLVM that Dr.Jit finds, ``scalar_rgb`` needs none and
is slower. An LLVM that can't do it ends the whole process, so this process never finds that out.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import platform
import re
import signal
import subprocess
import sys
from contextlib import nullcontext
from functools import cache
from pathlib import Path
from typing import Any

from hadr.frame_io import quiet

LLVM, SCALAR = "llvm_ad_rgb", "scalar_rgb"
#: Name of the environment variable that chooses the variant, and spares ``llvm_ad_rgb`` the trial.
VARIANT_VARIABLE = "HADR_MITSUBA_VARIANT"
#: LLVM 15 can't compile minima and maxima for AVX-512.
OLDEST_LLVM = 17
#: How drawing becomes faster, or possible with ``llvm_ad_rgb``.
REMEDY = f"install LLVM {OLDEST_LLVM} or newer (on Debian: apt install libllvm19)"
#: Seconds for a trial, which takes about five.
PATIENCE = 120.0


def mitsuba(variant: str | None = None) -> Any:
    """Import Mitsuba and choose its variant, :func:`mitsuba_variant` where it is left out."""
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
    """The variant to draw with: :func:`wanted_variant`, or the fastest that works here."""
    return wanted_variant() or (SCALAR if why_not_llvm() else LLVM)


def wanted_variant() -> str | None:
    """The variant that ``HADR_MITSUBA_VARIANT`` names, if any; a ``ValueError`` for a wrong one."""
    wanted = os.environ.get(VARIANT_VARIABLE) or None
    if wanted:
        _check_name(wanted, VARIANT_VARIABLE)
    return wanted


def check_variant(variant: str) -> None:
    """Check that a variant can be used here; a ``ValueError`` names the machine and the reason."""
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

    :mod:`hadr.synthesis.rendering.trial_picture` says it, in a process that may end of it.
    """
    # This package is found behind what the user names, and before other installations of it. An
    # empty name, such as OpenCV leaves behind, would stand for the current folder.
    home = str(Path(__file__).resolve().parents[3])
    folders = {
        name: os.pathsep.join(filter(None, [*os.environ.get(name, "").split(os.pathsep), last]))
        for name, last in (("PYTHONPATH", home), ("LD_LIBRARY_PATH", ""))
    }
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-m", "hadr.synthesis.rendering.trial_picture"],
            capture_output=True,
            text=True,
            errors="replace",
            timeout=PATIENCE,
            check=False,
            env={**os.environ, **folders, VARIANT_VARIABLE: LLVM},
        )
    except subprocess.TimeoutExpired:
        return f"a small picture can't be drawn, it took longer than {PATIENCE:g} s"
    except OSError as error:
        return f"a small picture can't be drawn, {error}"
    if done.returncode or not done.stdout:
        why = _cause_of_death(done.returncode, done.stderr)
        return f"a small picture can't be drawn, its process was ended {why}"
    return done.stdout.strip()


def _cause_of_death(status: int, errors: str) -> str:
    """How a process ended, with the telling line of what it wrote."""
    lines = [line.strip() for line in errors.splitlines() if line.strip()]
    if status >= 0:  # a traceback's last line
        said, ended = lines[-1:], f"with status {status}"
    else:  # before it died a library complained, at length
        said, ended = lines[:1], f"by {signal.Signals(-status).name}"
    return ended + "".join(f" ({line[:160]})" for line in said)


def llvm_problem() -> str:
    """What is wrong with the LLVM that Dr.Jit loads, or nothing; it compiles nothing here."""
    drjit = importlib.import_module("drjit")
    # Three numbers as a tuple, in Dr.Jit 1.0 as text; -1 where there is no LLVM.
    version = re.findall(r"-?\d+", str(drjit.detail.llvm_version()))
    if int(version[0]) < 0:
        return "Dr.Jit finds no LLVM that it can use"
    if int(version[0]) < OLDEST_LLVM:
        return f"LLVM {'.'.join(version)} is too old"
    return ""
