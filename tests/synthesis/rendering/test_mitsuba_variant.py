"""Which variant of Mitsuba draws, with libraries that work, that abort, that are old or missing."""

import importlib.util
import os
import platform
import re
import subprocess
import sys

import pytest

from hadr.synthesis.rendering import mitsuba_variant as chosen
from hadr.synthesis.rendering.mitsuba_variant import LLVM, SCALAR, VARIANT_VARIABLE

#: Stands in for Mitsuba, and ends the process at a picture too many.
MITSUBA = """
import os
from unittest.mock import MagicMock
import drjit
import numpy as np

anything, drawn, name = MagicMock(), [], None

def variant():
    return name

def set_variant(wanted):
    global name
    name = wanted

def render(scene, integrator, spp, seed):
    assert drjit.thread_count() == 1
    print("what a library prints is no answer")
    drawn.append(seed)
    if len(drawn) > int(os.environ["PICTURES"]):
        os.abort()
    return np.random.default_rng(seed).random((27, 48, 9))

def __getattr__(name):
    return getattr(anything, name)
"""
DRJIT = """
import os
from types import SimpleNamespace

detail = SimpleNamespace(llvm_version=lambda: os.environ["LLVM_VERSION"])
threads = 4

def thread_count():
    return threads

def set_thread_count(count):
    global threads
    threads = count
"""


@pytest.fixture
def unasked(monkeypatch):
    """Nothing is known, and the user chose nothing."""
    monkeypatch.delenv(VARIANT_VARIABLE, raising=False)
    chosen.why_not_llvm.cache_clear()
    yield
    chosen.why_not_llvm.cache_clear()


@pytest.fixture
def stand_in(tmp_path, monkeypatch, unasked):
    """Libraries that a child process finds before the real ones, with LLVM 19."""
    pytest.importorskip("pyoidn", reason="path-traced pictures need hadr[generate]")
    folder = tmp_path / "stand-in"
    folder.mkdir()
    (folder / "mitsuba.py").write_text(MITSUBA)
    (folder / "drjit.py").write_text(DRJIT)
    path = os.pathsep.join(filter(None, (str(folder), os.environ.get("PYTHONPATH"))))
    monkeypatch.setenv("PYTHONPATH", path)
    monkeypatch.setenv("LLVM_VERSION", "(19, 1, 7)")
    monkeypatch.setenv("PICTURES", "1000")
    return monkeypatch


# Libraries -----------------------------------------------------------------------------------


def test_a_library_that_draws_is_used(stand_in):
    assert chosen.why_not_llvm() == ""
    assert chosen.mitsuba_variant() == LLVM


# A picture is its light and the guides of the denoiser, and there are two scenes.
@pytest.mark.parametrize("pictures", [0, 4])
def test_a_library_that_aborts_when_it_is_used_again_is_not_used(stand_in, pictures):
    stand_in.setenv("PICTURES", str(pictures))
    assert "its process was ended by SIGABRT" in chosen.why_not_llvm()
    assert chosen.mitsuba_variant() == SCALAR
    with pytest.raises(ValueError, match=rf"{LLVM} can't be used on {platform.node()}: .*SIGABRT"):
        chosen.check_variant(LLVM)
    chosen.check_variant(SCALAR)


@pytest.mark.parametrize("version", ["(16, 0, 6)", "15.0.6"])  # Dr.Jit 1.0 gives a text
def test_an_old_library_is_not_used_at_all(stand_in, version):
    stand_in.setenv("LLVM_VERSION", version)
    stand_in.setenv("PICTURES", "0")  # the process would end
    digits = version.strip("()").replace(", ", ".")
    assert chosen.why_not_llvm() == f"LLVM {digits} is too old"
    assert chosen.mitsuba_variant() == SCALAR


@pytest.mark.parametrize(
    ("end", "said"),
    [
        ("os._exit(0)", "with status 0"),
        ("raise ImportError('a part is missing')", r"with status 1 \(.*a part is missing\)"),
    ],
)
def test_a_library_that_ends_the_process_early_is_not_used(stand_in, tmp_path, end, said):
    (tmp_path / "stand-in" / "drjit.py").write_text(f"import os\n{end}\n")
    assert re.search(f"can't be drawn, its process was ended {said}", chosen.why_not_llvm())


def test_the_trial_imports_nothing_from_the_current_folder(stand_in, tmp_path):
    (tmp_path / "numpy.py").write_text("import os; os.abort()")
    stand_in.chdir(tmp_path)
    stand_in.setenv("PYTHONPATH", os.pathsep + os.environ["PYTHONPATH"])
    stand_in.setenv("LD_LIBRARY_PATH", os.pathsep)  # OpenCV leaves such a one
    assert chosen.why_not_llvm() == ""


def test_without_a_library_the_scalar_variant_draws(unasked, monkeypatch):
    pytest.importorskip("mitsuba", reason="path-traced pictures need hadr[generate]")
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "/nowhere/libLLVM.so")
    assert chosen.why_not_llvm() == "Dr.Jit finds no LLVM that it can use"
    assert chosen.mitsuba_variant() == SCALAR


def test_no_word_of_a_missing_library_reaches_the_terminal(unasked, monkeypatch):
    pytest.importorskip("mitsuba", reason="path-traced pictures need hadr[generate]")
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "/nowhere/libLLVM.so")
    code = f"from hadr.synthesis.rendering.mitsuba_variant import mitsuba; mitsuba({SCALAR!r})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == ""


# The user's choice ---------------------------------------------------------------------------


def test_the_environment_chooses_without_a_trial(unasked, monkeypatch):
    for variant in (SCALAR, LLVM):
        monkeypatch.setenv(VARIANT_VARIABLE, variant)
        assert chosen.mitsuba_variant() == variant
    monkeypatch.setenv(VARIANT_VARIABLE, "cuda_ad_rgb")
    with pytest.raises(
        ValueError, match=f"{VARIANT_VARIABLE} must be '{LLVM}' or '{SCALAR}', got 'cuda_ad_rgb'"
    ):
        chosen.mitsuba_variant()


def test_a_process_tries_once_and_a_late_answer_is_none(unasked, monkeypatch):
    asked = []

    def run(command, timeout, **options):
        asked.append(command[-1])
        raise subprocess.TimeoutExpired(command, timeout)

    monkeypatch.setattr(chosen.subprocess, "run", run)
    for _ in range(2):
        assert chosen.why_not_llvm() == "a small picture can't be drawn, it took longer than 120 s"
    assert chosen.mitsuba_variant() == SCALAR
    assert asked == ["hadr.synthesis.rendering.trial_picture"]


def test_what_is_too_old_is_refused_to_everybody(unasked, monkeypatch):
    monkeypatch.setenv(VARIANT_VARIABLE, LLVM)
    monkeypatch.setattr(chosen, "llvm_problem", lambda: "LLVM 15.0.6 is too old")
    with pytest.raises(ValueError, match=r"LLVM 15\.0\.6 is too old\. .* install LLVM 17 or newer"):
        chosen.check_variant(LLVM)
    monkeypatch.setattr(chosen, "llvm_problem", lambda: "")
    chosen.check_variant(LLVM)


def test_a_missing_mitsuba_is_named_with_its_extra(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ValueError, match=r"needs mitsuba.*pip install 'hadr\[generate\]'"):
        chosen.mitsuba(SCALAR)
