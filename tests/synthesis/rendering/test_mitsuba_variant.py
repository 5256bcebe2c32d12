"""Which variant of Mitsuba draws, with libraries that work, that abort, that are old or missing."""

import importlib.util
import json
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
def answers(tmp_path, monkeypatch):
    """The file of answers; nothing is known, and the user chose nothing."""
    place = tmp_path / "answers.json"
    monkeypatch.delenv(VARIANT_VARIABLE, raising=False)
    monkeypatch.setattr(chosen, "_places", lambda: [place])
    chosen.why_not_llvm.cache_clear()
    yield place
    chosen.why_not_llvm.cache_clear()


@pytest.fixture
def stand_in(tmp_path, monkeypatch, answers):
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


@pytest.fixture
def trials(monkeypatch, answers):
    """Children that are not started: their answers, the last one first, and how many were asked."""
    replies, asked = [], []

    def call(function, **options):
        asked.append(function.__name__)
        reply = replies.pop()
        if isinstance(reply, Exception):
            raise reply
        return reply

    monkeypatch.setattr(chosen, "call_in_child", call)
    return replies, asked


def again():
    """Another process asks."""
    chosen.why_not_llvm.cache_clear()
    return chosen.why_not_llvm()


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


def test_without_a_library_the_scalar_variant_draws(answers, monkeypatch):
    pytest.importorskip("mitsuba", reason="path-traced pictures need hadr[generate]")
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "/nowhere/libLLVM.so")
    assert chosen.why_not_llvm() == "Dr.Jit finds no LLVM that it can use"
    assert chosen.mitsuba_variant() == SCALAR


def test_no_word_of_a_missing_library_reaches_the_terminal(answers, monkeypatch):
    pytest.importorskip("mitsuba", reason="path-traced pictures need hadr[generate]")
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", "/nowhere/libLLVM.so")
    code = f"from hadr.synthesis.rendering.mitsuba_variant import mitsuba; mitsuba({SCALAR!r})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == ""


def test_the_library_of_this_machine_is_used_if_it_is_new_enough_and_draws(answers):
    pytest.importorskip("mitsuba", reason="path-traced pictures need hadr[generate]")
    code = "import drjit; print(drjit.detail.llvm_version())"
    line = [sys.executable, "-c", code]
    told = subprocess.run(line, capture_output=True, text=True, check=True).stdout
    major = int(re.search(r"-?\d+", told)[0])
    why = chosen.why_not_llvm()
    if major < 0:
        assert why == "Dr.Jit finds no LLVM that it can use"
    elif major < 17:
        assert re.fullmatch(rf"LLVM {major}\.\d+\.\d+ is too old", why)
    else:
        assert why == "" or why.startswith("a small picture can't be drawn, ")
    assert chosen.mitsuba_variant() == (SCALAR if why else LLVM)


# The user's choice ---------------------------------------------------------------------------


def test_the_environment_chooses_without_a_trial(trials, monkeypatch):
    for variant in (SCALAR, LLVM):
        monkeypatch.setenv(VARIANT_VARIABLE, variant)
        assert chosen.mitsuba_variant() == variant
    monkeypatch.setenv(VARIANT_VARIABLE, "cuda_ad_rgb")
    with pytest.raises(
        ValueError, match=f"{VARIANT_VARIABLE} must be '{LLVM}' or '{SCALAR}', got 'cuda_ad_rgb'"
    ):
        chosen.mitsuba_variant()


def test_what_is_too_old_is_refused_to_everybody(trials, monkeypatch):
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


# The file of answers -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("replies", "why"),
    [(["", ""], ""), ([ChildProcessError("it died")], "a small picture can't be drawn, it died")],
)
def test_an_answer_is_kept_for_other_processes(trials, replies, why):
    trials[0].extend(replies)
    assert again() == why
    assert again() == why
    assert trials[1] == ["llvm_problem", "draw_trial"][: len(replies)]


@pytest.mark.parametrize(
    "error", [TimeoutError("late"), ChildProcessError("its process was ended by SIGKILL")]
)
def test_a_want_of_time_or_memory_is_no_answer_for_others(trials, error):
    trials[0].extend(["", "", error])
    assert chosen.why_not_llvm() == f"a small picture can't be drawn, {error}"
    assert chosen.mitsuba_variant() == SCALAR  # in this process there's one trial
    assert again() == ""


def test_another_library_is_tried_anew(trials, answers, monkeypatch, tmp_path):
    library = tmp_path / "libLLVM.so"
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    trials[0].extend(["the fourth", "the third", "the second", "the first"])
    assert again() == "the first"
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(library))
    assert again() == "the second"
    library.write_text("new")
    assert again() == "the third"
    os.utime(library, (0, 0))
    assert again() == "the fourth"
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH")
    assert again() == "the first"


def test_another_version_or_processor_is_tried_anew(trials, monkeypatch):
    trials[0].extend(["the third", "the second", "the first"])
    assert again() == "the first"
    monkeypatch.setattr(chosen.importlib.metadata, "version", lambda name: "99")
    assert again() == "the second"
    monkeypatch.setattr(chosen, "_processor", lambda: ["another"])
    assert again() == "the third"


@pytest.mark.parametrize("content", [b"", b"{", b"[1]", b"\xff\xfe", b'{"KEY": {"why_not": 3}}'])
def test_a_broken_file_is_replaced(trials, answers, content):
    key = chosen.digest(chosen._facts()).encode()
    answers.write_bytes(content.replace(b"KEY", key))
    trials[0].append("no")
    assert again() == "no"
    assert again() == "no"
    assert [row["why_not"] for row in json.loads(answers.read_text()).values()] == ["no"]


def test_what_cant_be_written_is_written_elsewhere_or_nowhere(trials, monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    closed, cache = tmp_path / "file" / "answers.json", tmp_path / "cache" / "answers.json"
    trials[0].extend(["for itself", "kept"])
    monkeypatch.setattr(chosen, "_places", lambda: [closed, cache])
    assert again() == "kept"
    assert again() == "kept"
    assert cache.is_file()
    monkeypatch.setattr(chosen, "_places", lambda: [closed])
    assert again() == "for itself"
    assert chosen.why_not_llvm() == "for itself"


def test_the_file_lies_beside_the_environment_or_in_the_users_cache(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(sys, "prefix", "/the/environment")
    places = [str(place) for place in chosen._places()]
    assert places == ["/the/environment/hadr-mitsuba.json", f"{tmp_path}/hadr/hadr-mitsuba.json"]


def test_a_known_answer_loads_no_library(trials, answers):
    trials[0].append("no")
    again()
    code = (
        "import sys\nfrom pathlib import Path\n"
        "from hadr.synthesis.rendering import mitsuba_variant as m\n"
        f"m._places = lambda: [Path({str(answers)!r})]\nprint(m.why_not_llvm())\n"
        "print({'mitsuba', 'drjit', 'torch'} & set(sys.modules))"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.split("\n")[:2] == ["no", "set()"]
