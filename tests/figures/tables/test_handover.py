import pytest

from hadr.figures.tables.handover import arms_table, paired

ROW = {
    "arm": "hadr",
    "attempts": 48,
    "successes": 30,
    "rate": 0.625,
    "interval": [0.484, 0.748],
    "objects_at_50_percent": 5,
    "objects_at_80_percent": 2,
    "objects_at_100_percent": 1,
    "failures": {"drop": 10, "time-out": 8},
    "mean_seconds": 7.25,
}
NEVER = {**ROW, "arm": "raw", "successes": 0, "rate": 0.0, "mean_seconds": None}


def cells(line):
    """The cells of a row; what must not break over lines is held by no-break spaces."""
    found = [cell.strip(" ") for cell in line.strip("|").split("|")]
    assert not any(" %" in cell or " to " in cell for cell in found)
    return [cell.replace("\N{NO-BREAK SPACE}", " ") for cell in found]


def test_each_arm_has_its_numbers_and_the_paper_stands_below():
    lines = arms_table([ROW, NEVER], {"GraspNet": [5, 0, 0, 0]}).splitlines()
    assert cells(lines[2]) == ["HADR", "30/48", "62.5 %", "48 to 75", "5/8", "2/8", "1/8", "7.2 s"]
    assert cells(lines[3])[:3] == ["sensor depth", "0/48", "0.0 %"]
    assert cells(lines[3])[7] == "none"
    assert cells(lines[4]) == ["*paper: GraspNet*", "5/48", "10.4 %", "", "0/8", "0/8", "0/8", ""]


def test_two_arms_are_compared_attempt_by_attempt():
    first = {"arm": "a", "verdicts": {"1": "success", "2": "success", "3": "drop", "4": "drop"}}
    second = {"arm": "b", "verdicts": {"1": "success", "2": "drop", "3": "drop", "4": "success"}}
    assert paired(first, second) == (1, 1, 1.0)
    better = {"arm": "c", "verdicts": dict.fromkeys("1234", "success")}
    assert paired(better, first) == (2, 0, 0.5)  # 2 of 2: once each way in four
    assert paired(first, first) == (0, 0, 1.0)
    with pytest.raises(ValueError, match="a and d have not made the same attempts"):
        paired(first, {"arm": "d", "verdicts": {"1": "drop"}})
