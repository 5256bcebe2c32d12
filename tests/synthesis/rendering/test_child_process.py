"""Functions called in a process of their own, and how its end is told."""

import importlib.util
import operator
import os
import sys
import time

import pytest

from hadr.synthesis.rendering.child_process import call_in_child

PATIENCE = 120.0


def test_it_runs_elsewhere_and_its_result_comes_back(capfd):
    assert call_in_child(os.getpid, timeout=PATIENCE) != os.getpid()
    assert call_in_child(divmod, 7, 3, timeout=PATIENCE) == (2, 1)
    assert call_in_child(print, "what a library prints is no result", timeout=PATIENCE) is None
    assert capfd.readouterr() == ("", "")


def test_its_environment_may_be_other():
    environment = {"HADR_TEST": "here"}
    told = call_in_child(os.getenv, "HADR_TEST", environment=environment, timeout=PATIENCE)
    assert told == "here"
    assert "HADR_TEST" not in os.environ


def test_what_the_function_raises_is_raised():
    with pytest.raises(ZeroDivisionError, match="division by zero"):
        call_in_child(operator.truediv, 1, 0, timeout=PATIENCE)


def test_how_it_died_is_told_and_nothing_else_dies():
    with pytest.raises(ChildProcessError, match="its process was ended by SIGABRT"):
        call_in_child(os.abort, timeout=PATIENCE)
    with pytest.raises(ChildProcessError, match="its process was ended with status 3"):
        call_in_child(sys.exit, 3, timeout=PATIENCE)
    with pytest.raises(ChildProcessError, match="its process was ended with status 0"):
        call_in_child(os._exit, 0, timeout=PATIENCE)


def test_it_is_not_waited_for_longer_than_is_said():
    with pytest.raises(TimeoutError, match=r"it took longer than 0\.5 s"):
        call_in_child(time.sleep, 600.0, timeout=0.5)


def test_nothing_is_imported_from_the_current_folder(tmp_path, monkeypatch):
    (tmp_path / "pickle.py").write_text("import os; os.abort()")
    (tmp_path / "planted.py").write_text("")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", os.pathsep + os.environ.get("PYTHONPATH", ""))
    monkeypatch.setenv("LD_LIBRARY_PATH", "/nowhere" + os.pathsep)  # OpenCV leaves such a one
    assert call_in_child(importlib.util.find_spec, "planted", timeout=PATIENCE) is None
    assert call_in_child(os.getenv, "LD_LIBRARY_PATH", timeout=PATIENCE) == "/nowhere"
