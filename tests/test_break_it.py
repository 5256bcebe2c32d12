"""The attempt to break hadr: that there is enough of it, and that its judge sees what breaks."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).resolve().parents[1] / "benchmarks"


@pytest.fixture
def worker(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    from break_it import worker

    return worker


def test_enough_is_tried() -> None:
    line = [sys.executable, str(BENCHMARKS / "break_it.py"), "--list"]
    told = subprocess.run(line, capture_output=True, text=True, check=True).stdout
    inputs, kills = re.search(r"(\d+) bad inputs, (\d+) kills", told.splitlines()[-1]).groups()
    assert int(inputs) >= 1200
    assert int(kills) >= 50
    assert len(set(told.splitlines())) > 1200


SENTENCE = "hadr restore: error: depth d.png does not exist\n"


@pytest.mark.parametrize(
    ("verdict", "expect", "status", "told", "after"),
    [
        ("fine", "refused", 2, SENTENCE, {}),
        ("fine", "safe", 0, "", {"out/depth.png": "1"}),
        ("fine", "refused", 2, "\r50%|#  | 1/2\r" + SENTENCE, {}),
        ("accepted", "refused", 0, "", {"out/depth.png": "1"}),
        ("accepted", "noted", 0, "note: it is dark", {"out/depth.png": "1"}),
        ("fine", "noted", 0, "note: d.png is dark", {"out/depth.png": "1"}),
        ("damaged", "refused", 2, SENTENCE, {"d.png": "other"}),
        ("damaged", "safe", 0, "", {"d.png": None}),
        ("left over", "refused", 2, SENTENCE, {".out-x": "1"}),
        ("left over", "safe", 0, "", {"strange": "1"}),
        ("executed", "refused", 2, SENTENCE, {"executed-pickle": "1"}),
        ("traceback", "refused", "KeyError: 'x'", "", {}),
        ("refused a right one", "works", 2, SENTENCE, {}),
        ("wrong status", "refused", -11, SENTENCE, {}),
        ("unclear", "refused", 2, "a warning\n" + SENTENCE, {}),
        ("unclear", "refused", 2, "hadr restore: error: it does not exist\n", {}),
        ("unclear", "refused", 2, "d.png does not exist\n", {}),
        ("unclear", "refused", 2, "", {}),
    ],
)
def test_the_judge_sees(worker, verdict, expect, status, told, after) -> None:
    case = {"command": "restore", "expect": expect, "says": ["d.png"], "may": [], "out": ["out"]}
    before = {"d.png": "as it was"}
    left = {name: kind for name, kind in {**before, **after}.items() if kind}
    assert worker.judged(case, before, left, status, told)[0] == verdict


def test_the_summary_counts_the_kills_that_came_in_time(worker) -> None:
    place = BENCHMARKS / "break_it.py"  # a script beside the package of its name
    spec = importlib.util.spec_from_file_location("break_it_script", place)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    names = ("train: kill 1", "train: kill 2, came too late", "train: the end")
    rows = [{"command": "train", "kind": "kill", "name": n, "verdict": "fine"} for n in names]
    rows.append({"command": "view", "kind": "field", "name": "fx = 1", "verdict": "accepted"})
    table = script.summary(rows)
    assert table["train"] == {"tried": 3, "kills": 1, "fine": 3}
    assert table["all"] == {"tried": 4, "kills": 1, "fine": 3, "accepted": 1}
    assert script.summary_text(table).splitlines()[0].split() == [
        "tried",
        "kills",
        "fine",
        "accepted",
    ]
