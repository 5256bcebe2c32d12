"""The plan that `hadr reproduce` prints."""

import pytest

from hadr.experiments import reproduction_plan
from hadr.experiments.reproduction_plan import Step, seconds_text, steps_text

STEPS = [
    Step("tables", "known/raw/seed-0", "done", 0.0, "runs/a.json"),
    Step("tables", "known/hadr/seed-0", "3 of 12 epochs", 600.0, "runs/b.json"),
    Step("tables", "known/tode/seed-0", "12 of 12 epochs", None, "runs/c.json"),
    Step("chapters", "00_introduction", "execution", 30.0, "executed/00.ipynb"),
]


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(None, "?"), (0.2, "1 s"), (99.4, "99 s"), (99.6, "2 min"), (5940, "99 min"),
     (6000, "1 h 40 min"), (40200, "11 h 10 min")],
)  # fmt: skip
def test_estimates_for_readers(seconds, text):
    assert seconds_text(seconds) == text


def test_each_step_has_a_line_with_what_is_left_its_time_and_its_output():
    lines = [line.split() for line in steps_text(STEPS).splitlines()]
    assert lines[1] == ["tables"]
    assert lines[2] == ["known/raw/seed-0", "done", "-", "runs/a.json"]
    assert lines[3] == ["known/hadr/seed-0", "3", "of", "12", "epochs", "10", "min", "runs/b.json"]
    assert lines[4][-2:] == ["?", "runs/c.json"]
    assert lines[5] == ["chapters"]
    assert lines[6] == ["00_introduction", "execution", "30", "s", "executed/00.ipynb"]
    assert "3 of 4 steps are left: about 10 min, one after the other" in steps_text(STEPS)
    assert "not counted: 1 of them, marked ?" in steps_text(STEPS)


def test_several_at_a_time_share_all_but_the_chapters(monkeypatch):
    monkeypatch.setattr(reproduction_plan, "usable_cores", lambda: 2)
    steps = [STEPS[1], STEPS[1], STEPS[3]]
    assert "; about 10 min, 2 at a time" in steps_text(steps, jobs=8)
    assert "at a time" not in steps_text(steps, jobs=1)


def test_a_plan_without_times_or_without_work_says_so():
    assert "none of them has a time on record" in steps_text([STEPS[2]])
    assert "all of 1 steps are done" in steps_text([STEPS[0]])
