import numpy as np
import pytest

from hadr.figures.tables.handover import (
    WORSE,
    commonest_parting,
    compared,
    conditions_table,
    draw_degradation,
    draw_outcomes,
    draw_success,
    motions_table,
    paired,
)

ROW = {
    "condition": "hadr",
    "attempts": 48,
    "successes": 30,
    "rate": 0.625,
    "interval": [0.484, 0.748],
    "objects_at_50_percent": 3,
    "objects_at_80_percent": 2,
    "objects_at_100_percent": 1,
    "rate_by_object": dict.fromkeys("0145", 0.75),
    "failures": {"drop": 10, "time-out": 8},
    "mean_seconds": 7.25,
}
NEVER = {**ROW, "condition": "raw", "successes": 0, "rate": 0.0, "mean_seconds": None}


def cells(line):
    """The cells of a row; what must not break over lines is held by no-break spaces."""
    found = [cell.strip(" ") for cell in line.strip("|").split("|")]
    assert not any(" %" in cell or " to " in cell for cell in found)
    return [cell.replace("\N{NO-BREAK SPACE}", " ") for cell in found]


def test_each_condition_has_its_numbers_and_the_paper_stands_below():
    lines = conditions_table([ROW, NEVER], {"GraspNet": [5, 0, 0, 0]}).splitlines()
    assert cells(lines[3]) == [
        "HADR", "**30/48**", "**62.5**", "48 to 75", "3/4", "2/4", "1/4", "7.2",
    ]  # fmt: skip
    assert cells(lines[2])[:3] == ["sensor depth", "0/48", "0.0"]
    assert cells(lines[2])[7] == "-"
    assert cells(lines[4]) == ["*paper: GraspNet*", "5/48", "10.4", "", "0/8", "0/8", "0/8", ""]


def test_each_condition_has_its_successes_by_motion():
    rows = [{"condition": "raw", "by_motion": {"still": [3, 10], "turn": [0, 9]}}]
    assert cells(motions_table(rows).splitlines()[-1]) == ["sensor depth", "3/10", "0/9"]


def test_two_conditions_are_compared_attempt_by_attempt():
    first, second = (
        {"condition": name, "verdicts": dict(zip("1234", ends, strict=True))}
        for name, ends in (("a", [*2 * ["success"], *2 * ["drop"]]),
                           ("b", ["success", "drop", "drop", "success"]))
    )  # fmt: skip
    assert paired(first, second) == (1, 1, 1.0)
    better = {"condition": "c", "verdicts": dict.fromkeys("1234", "success")}
    assert paired(better, first) == (2, 0, 0.5)  # 2 of 2: once each way in four
    assert paired(first, first) == (0, 0, 1.0)
    with pytest.raises(ValueError, match="a and d have not made the same attempts"):
        paired(first, {"condition": "d", "verdicts": {"1": "drop"}})


def test_chances_are_corrected_for_their_number():
    won = {"raw": 0, "hadr": 8, "hadr-plus": 8}  # of eight attempts
    rows = [
        {"condition": name, "verdicts": {str(k): "success" if k < n else "drop" for k in range(8)}}
        for name, n in won.items()
    ]
    lines = compared(rows, [("hadr", "raw"), ("hadr-plus", "hadr")]).splitlines()
    # eight of eight: twice in 256; as the lesser of two chances it counts double
    assert cells(lines[2]) == ["HADR", "8", "sensor depth", "0", "0.008", "0.016"]
    assert cells(lines[3]) == ["HADR-plus", "0", "HADR", "0", "1.000", "1.000"]


def test_the_attempt_shown_is_the_first_on_which_conditions_differ_in_the_commonest_way():
    won = {"a": (1, 1, 0, 0, 1, 0), "b": (1, 0, 1, 1, 1, 0)}  # alike, a, b, b, alike, alike
    rows = [
        {
            "condition": name,
            "verdicts": {f"000{k}-900": "success" if w else "drop" for k, w in enumerate(column)},
        }
        for name, column in won.items()
    ]
    assert commonest_parting(rows, ("a", "b")) == "0002-900"


def row(
    condition: str, successes: int, low: float, high: float, **more: object
) -> dict[str, object]:
    return {
        "condition": condition,
        "attempts": 48,
        "successes": successes,
        "rate": successes / 48,
        "interval": [low, high],
        "failures": {"drop": 40 - successes, "timeout": 8},
        **more,
    }


ROWS = [row("perfect", 40, 0.70, 0.92), row("hadr", 36, 0.61, 0.85), row("raw", 12, 0.15, 0.39)]


def test_bars_are_as_long_as_the_rates_and_stand_in_order(ax) -> None:
    draw_success(ax, ROWS, published=34 / 48)
    names = [label.get_text() for label in ax.get_yticklabels()]
    assert names == ["sensor depth", "HADR", "perfect depth"]
    lengths = [bar.get_width() for bar in ax.patches]
    assert lengths == pytest.approx([25.0, 75.0, 100 * 40 / 48])
    intervals = [segment[:, 0] for segment in ax.collections[0].get_segments()]
    np.testing.assert_allclose(intervals, [[15, 39], [61, 85], [70, 92]])
    assert "75 %  (36/48)" in [text.get_text() for text in ax.texts]
    assert ax.lines[-1].get_xdata()[0] == pytest.approx(70.83, abs=0.01)


def test_outcomes_fill_the_attempts(ax) -> None:
    draw_outcomes(ax, ROWS)
    ends = {}
    for bar in ax.patches:
        place = round(bar.get_y() + bar.get_height() / 2)
        ends[place] = max(ends.get(place, 0), bar.get_x() + bar.get_width())
    assert ends == {0: 48, 1: 48, 2: 48}
    assert [t.get_text() for t in ax.get_legend().texts] == ["success", "drop", "timeout"]


def test_degradation_has_a_line_a_condition_with_its_intervals(ax) -> None:
    usual = {name: value for name, (_, value) in WORSE.items()} | {
        "restless": False,
        "time_limit": 13.0,
    }
    rows = [
        row("hadr", 36, 0.61, 0.85, **usual),
        row("hadr", 12, 0.15, 0.39, **usual | {"hand_speed": 3}),
        row("perfect", 40, 0.70, 0.92, **usual),
        row("perfect", 1, 0.01, 0.02, **usual | {"hand_speed": 3, "latency": 0.3}),
        row("perfect", 2, 0.01, 0.02, **usual | {"hand_speed": 3, "restless": True}),
        row("perfect", 2, 0.01, 0.02, **usual | {"hand_speed": 3, "time_limit": 26.0}),
    ]
    draw_degradation(ax, rows[::-1], "hand_speed")
    first, second = (container.lines for container in ax.containers)
    np.testing.assert_allclose(first[0].get_ydata(), [75, 25])
    np.testing.assert_allclose(first[0].get_xdata(), [1, 3], atol=0.1)
    np.testing.assert_allclose(second[0].get_ydata(), [100 * 40 / 48])
    np.testing.assert_allclose([s[:, 1] for s in first[2][0].get_segments()], [[61, 85], [15, 39]])
    assert [t.get_text() for t in ax.get_legend().texts] == ["HADR", "perfect depth"]
