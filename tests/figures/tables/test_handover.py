import numpy as np
import pytest

from hadr.figures.tables.handover import (
    CONDITIONS,
    WORSE,
    beliefs_table,
    compared,
    conditions_table,
    draw_degradation,
    draw_objects,
    draw_outcomes,
    draw_success,
    incidents_table,
    motions_table,
    paired,
    partings,
    touches_table,
)
from hadr.simulation.trials import trial


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


def test_every_condition_that_can_be_run_has_a_name():
    assert set(CONDITIONS) == set(trial.CONDITIONS)


def cells(line):
    """The cells of a row; what must not break over lines is held by no-break spaces."""
    found = [cell.strip(" ") for cell in line.strip("|").split("|")]
    assert not any(" %" in cell or " to " in cell for cell in found)
    return [cell.replace("\N{NO-BREAK SPACE}", " ") for cell in found]


def test_each_condition_has_its_numbers_and_the_paper_stands_below():
    more = {f"objects_at_{share}_percent": n for share, n in ((50, 3), (80, 2), (100, 1))}
    more |= {"rate_by_object": dict.fromkeys("0145", 0.75)}
    own = row("hadr", 30, 0.484, 0.748, mean_seconds=7.25, **more)
    never = row("raw", 0, 0.484, 0.748, mean_seconds=None, **more)
    lines = conditions_table([own, never], {"GraspNet": [5, 0, 0, 0]}).splitlines()
    assert cells(lines[3]) == [
        "HADR", "**30/48**", "**62.5**", "48 to 75", "3/4", "2/4", "1/4", "7.2",
    ]  # fmt: skip
    assert cells(lines[2])[:3] == ["sensor depth", "0/48", "0.0"]
    assert cells(lines[2])[7] == "-"
    assert cells(lines[4]) == [
        "*paper: GraspNet*", "5/48", "10.4", "5 to 22", "0/8", "0/8", "0/8", "",
    ]  # fmt: skip


def test_what_happened_stands_beside_what_became_of_it():
    rows = [
        {"condition": "perfect", "incidents": {"late": [1, 4], "never stopped": [8, 9]}},
        {"condition": "hadr", "incidents": {"never stopped": [5, 7]}},
    ]
    lines = [cells(line) for line in incidents_table(rows).splitlines()]
    assert lines[0] == ["what happened", "perfect depth", "HADR"]
    assert lines[2] == ["never stopped", "8 of 9", "5 of 7"]
    assert lines[3] == ["late", "1 of 4", "0 of 0"]


def test_what_the_robot_believed_stands_in_percent_and_millimetres():
    known = {"points_right": {"success": 0.856, "failure": 0.7}}
    known["points_right_at_grasp"] = {"success": 1.0, "failure": None}
    known["grasp_off"] = {"success": 0.0123, "failure": 0.0304}
    lines = [cells(line) for line in beliefs_table([{"condition": "raw", **known}]).splitlines()]
    assert lines[2] == ["sensor depth", "86 / 70", "100 / -", "12 / 30"]


def test_each_condition_has_its_successes_by_motion():
    rows = [{"condition": "raw", "by_motion": {"still": [3, 10], "turn": [0, 9]}}]
    assert cells(motions_table(rows).splitlines()[-1]) == ["sensor depth", "30 (3/10)", "0 (0/9)"]


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
        paired(first, {"condition": "d", "verdicts": {"5": "drop"}})
    more = {"condition": "e", "verdicts": {"4": "success", "5": "success", "6": "success"}}
    assert paired(more, first) == (1, 0, 1.0)  # of the only one that both have made


def test_seeds_of_one_hold_are_one_trial_of_chance() -> None:
    always = [f"0000-{hold}{seed}" for hold in (1, 2) for seed in ("", "-1", "-2")]
    worse = {"condition": "b", "verdicts": dict.fromkeys(always, "drop")}
    better = {"condition": "a", "verdicts": dict.fromkeys(always, "success")}
    assert paired(better, worse) == (6, 0, 0.5)  # two holds: both ahead or both behind, of four
    # holds with gaps of 3 and -1: of 4, 2, -2, -4, as likely each, all are at least 2 from 0
    split = {**better["verdicts"], "0000-2": "drop", "0000-2-1": "drop", "0000-2-2": "drop"}
    mixed = {**worse["verdicts"], "0000-2-2": "success"}
    first, second = {"condition": "a", "verdicts": split}, {"condition": "b", "verdicts": mixed}
    assert paired(first, second) == (3, 1, 1.0)


def test_chances_are_corrected_for_their_number():
    won = {"raw": 0, "hadr": 8, "hadr-plus": 8}  # of eight attempts
    rows = [
        {"condition": name, "verdicts": {str(k): "success" if k < n else "drop" for k in range(8)}}
        for name, n in won.items()
    ]
    lines = compared(rows, [("hadr", "raw"), ("hadr-plus", "hadr")]).splitlines()
    # eight of eight: twice in 256; as the lesser of two chances it counts double
    assert cells(lines[2]) == ["HADR", "sensor depth", "8", "8", "0", "0.008", "0.016"]
    assert cells(lines[3]) == ["HADR-plus", "HADR", "8", "0", "0", "1.000", "1.000"]


def test_the_attempts_shown_are_the_first_of_each_way_to_differ_the_commonest_first():
    won = {"a": (1, 1, 0, 0, 1, 0), "b": (1, 0, 1, 1, 1, 0)}  # alike, a, b, b, alike, alike
    rows = [
        {
            "condition": name,
            "verdicts": {f"000{k}-900": "success" if w else "drop" for k, w in enumerate(column)},
        }
        for name, column in won.items()
    ]
    assert partings(rows, ("a", "b")) == ["0002-900", "0001-900"]


def test_bars_are_as_long_as_the_rates_and_stand_in_order(ax) -> None:
    draw_success(ax, ROWS, published={"hadr": 34})
    names = [label.get_text() for label in ax.get_yticklabels()]
    assert names == ["sensor depth", "HADR", "perfect depth"]
    lengths = [bar.get_width() for bar in ax.patches]
    assert lengths == pytest.approx([25.0, 75.0, 100 * 40 / 48])
    intervals = [segment[:, 0] for segment in ax.collections[0].get_segments()]
    np.testing.assert_allclose(intervals, [[15, 39], [61, 85], [70, 92]])
    assert "75 %  (36/48)" in [text.get_text() for text in ax.texts]
    point = next(line for line in ax.lines if line.get_marker() == "D")
    assert point.get_xydata() == pytest.approx(np.array([[70.83, 1.38]]), abs=0.01)
    (paper,) = (segment[:, 0] for segment in ax.collections[1].get_segments())
    np.testing.assert_allclose(paper, [56.8, 81.8], atol=0.1)  # Wilson's, by R's prop.test


def test_objects_stand_in_columns_and_novel_ones_apart(ax) -> None:
    rows = [
        {"condition": "perfect", "rate_by_object": {"0001": 0.5, "0010": 1.0}},
        {"condition": "raw", "rate_by_object": {"0001": 0.125, "0010": 0.0}},
    ]
    draw_objects(ax, rows, {"0010": "carafe", "0001": "wine glass"}, 1)
    np.testing.assert_allclose(ax.images[0].get_array(), [[0, 12.5], [100, 50]])
    assert [label.get_text() for label in ax.get_xticklabels()] == ["carafe", "wine\nglass"]
    assert [label.get_text() for label in ax.get_yticklabels()] == ["sensor depth", "perfect depth"]
    assert ax.lines[0].get_xdata()[0] == 0.5


def test_touches_are_told_by_hand_and_through_the_glass() -> None:
    forces = {"through the glass, Stopped": 3.0, "touch, Stopped": 1.5, "touch, Going home": 2.04}
    rows = [
        {"condition": "raw", "attempts": 9, "failures": {"drop": 2}, "largest_forces_n": {}},
        {"condition": "perfect", "attempts": 5, "failures": {"human contact": 2},
         "largest_forces_n": forces},
    ]  # fmt: skip
    lines = [cells(line) for line in touches_table(rows).splitlines()]
    assert lines[2:] == [
        ["sensor depth", "0 of 9", "none", "none"],
        ["perfect depth", "2 of 5", "2.0, Going home", "3.0, Stopped"],
    ]  # fmt: skip


def test_outcomes_are_percent_and_fill_the_attempts(ax) -> None:
    draw_outcomes(ax, ROWS)
    assert [bar.get_width() for bar in ax.patches[:3]] == pytest.approx([25, 75, 100 * 40 / 48])
    ends = {}
    for bar in ax.patches:
        place = round(bar.get_y() + bar.get_height() / 2)
        ends[place] = max(ends.get(place, 0), bar.get_x() + bar.get_width())
    assert ends == pytest.approx({0: 100, 1: 100, 2: 100})
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
        row("perfect", 2, 0.01, 0.02, **usual | {"turn_degrees": 40}),
    ]
    draw_degradation(ax, rows[::-1], "hand_speed")
    first, second = (container.lines for container in ax.containers)
    np.testing.assert_allclose(first[0].get_ydata(), [75, 25])
    np.testing.assert_allclose(first[0].get_xdata(), [1, 3], atol=0.1)
    np.testing.assert_allclose(second[0].get_ydata(), [100 * 40 / 48])
    np.testing.assert_allclose([s[:, 1] for s in first[2][0].get_segments()], [[61, 85], [15, 39]])
    assert [t.get_text() for t in ax.get_legend().texts] == ["HADR", "perfect depth"]
