"""Figures of recorded handovers say what the states and the rows say."""

from __future__ import annotations

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest

from hadr.figures.handover.film import (
    draw_degradation,
    draw_outcomes,
    draw_success,
    film_strip,
    show_run,
)
from hadr.handover.robot import HOME_JOINTS
from hadr.handover.workflow import Stage, Transition
from hadr.simulation.film.views import side_view
from hadr.simulation.world.scenes import HeldScene, held_scene
from hadr.simulation.world.state import WorldState

CHANGES = [
    Transition(1.0, Stage.WAIT_AND_OBSERVE, Stage.APPROACH_AND_REACT, "chose a grasp"),
    Transition(3.0, Stage.APPROACH_AND_REACT, Stage.STOPPED, "no hand seen for 0.30 s"),
]


def row(arm: str, successes: int, low: float, high: float, **more: object) -> dict[str, object]:
    return {
        "arm": arm,
        "attempts": 48,
        "successes": successes,
        "rate": successes / 48,
        "interval": [low, high],
        "failures": {"drop": 40 - successes, "timeout": 8},
        **more,
    }


ROWS = [row("perfect", 40, 0.70, 0.92), row("hadr", 36, 0.61, 0.85), row("raw", 12, 0.15, 0.39)]


@pytest.fixture(autouse=True)
def close_figures():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def scene() -> HeldScene:
    return held_scene("0001", 920)


@pytest.fixture(scope="module")
def states(scene: HeldScene) -> list[WorldState]:
    first = WorldState(
        0.0, HOME_JOINTS, 0.085, scene.base_from_wrist, scene.base_from_object, "hand", 0.0, 0.2
    )
    return [
        replace(
            first,
            time=0.5 * k,
            gripper_width=0.085 - 0.005 * k,
            hand_force=1.5 * k,
            holder="gripper" if k > 5 else "hand",
        )
        for k in range(8)
    ]


def test_a_strip_has_a_still_a_time_with_its_stage_below(
    scene: HeldScene, states: list[WorldState]
) -> None:
    view = side_view(64, 36)
    figure, alt = film_strip(states, [0.0, 1.4, 3.0], scene, CHANGES, view=view, columns=2)
    assert len(figure.axes) == 3
    labels = [ax.get_xlabel() for ax in figure.axes]
    assert labels == ["0.0 s  Wait & Observe", "1.5 s  Approach & React", "3.0 s  Stopped"]
    assert [ax.images[0].get_array().shape for ax in figure.axes] == [(36, 64, 3)] * 3
    assert alt == (
        "3 stills of a handover of a wine glass: 0.0 s: Wait & Observe; 1.5 s: Approach & React; "
        "3.0 s: Stopped (no hand seen for 0.30 s)."
    )
    named, _ = film_strip(states, [0.0], scene, view=view, names=["it waits"])
    assert named.axes[0].get_xlabel() == "0.0 s  it waits\nWait & Observe"


def test_a_strip_without_times_or_with_too_few_names_is_refused(
    scene: HeldScene, states: list[WorldState]
) -> None:
    with pytest.raises(ValueError, match="got 8 states and 0 times"):
        film_strip(states, [], scene)
    with pytest.raises(ValueError, match="2 times, but 1 names"):
        film_strip(states, [0.0, 1.0], scene, names=["one"])


def test_a_run_is_drawn_in_centimetres_millimetres_and_newtons(states: list[WorldState]) -> None:
    figure = show_run(states, CHANGES, to_target=np.linspace(0.3, 0.0, 8))
    top, middle, low = figure.axes
    np.testing.assert_allclose(top.lines[0].get_ydata(), np.linspace(30, 0, 8))
    np.testing.assert_allclose(top.lines[1].get_ydata(), 20.0)
    np.testing.assert_allclose(middle.lines[0].get_ydata(), 85 - 5 * np.arange(8))
    np.testing.assert_allclose(low.lines[0].get_ydata(), 1.5 * np.arange(8))
    assert low.lines[1].get_ydata()[0] == 20.0
    assert middle.lines[1].get_xdata()[0] == 3.0  # the first state that the gripper holds it in
    bands = [(p.get_x(), p.get_x() + p.get_width()) for p in low.patches]
    np.testing.assert_allclose(bands, [(0, 1), (1, 3), (3, 3.5)])
    assert [t.get_text() for t in top.texts] == ["Wait & Observe", "Approach & React", "Stopped"]
    with pytest.raises(ValueError, match=r"8 states, but to_target has shape \(3,\)"):
        show_run(states, to_target=[0, 1, 2])
    with pytest.raises(ValueError, match="at least one state"):
        show_run([])


def test_bars_are_as_long_as_the_rates_and_stand_in_order() -> None:
    _, ax = plt.subplots()
    draw_success(ax, ROWS, published=34 / 48)
    names = [label.get_text() for label in ax.get_yticklabels()]
    assert names == ["sensor depth", "HADR", "perfect depth"]
    lengths = [bar.get_width() for bar in ax.patches]
    assert lengths == pytest.approx([25.0, 75.0, 100 * 40 / 48])
    intervals = [segment[:, 0] for segment in ax.collections[0].get_segments()]
    np.testing.assert_allclose(intervals, [[15, 39], [61, 85], [70, 92]])
    assert "75 %  (36/48)" in [text.get_text() for text in ax.texts]
    assert ax.lines[-1].get_xdata()[0] == pytest.approx(70.83, abs=0.01)


@pytest.mark.parametrize(("rate", "interval"), [(0.5, (0.6, 0.7)), (75, (61, 85)), (0.5, (0, 0.4))])
def test_a_rate_outside_of_its_interval_is_refused(rate: float, interval: tuple) -> None:
    _, ax = plt.subplots()
    wrong = {**ROWS[1], "rate": rate, "interval": interval}
    with pytest.raises(ValueError, match="hadr: the rate must lie in its interval"):
        draw_success(ax, [wrong])


def test_outcomes_fill_the_attempts() -> None:
    _, ax = plt.subplots()
    draw_outcomes(ax, ROWS)
    ends = {}
    for bar in ax.patches:
        place = round(bar.get_y() + bar.get_height() / 2)
        ends[place] = max(ends.get(place, 0), bar.get_x() + bar.get_width())
    assert ends == {0: 48, 1: 48, 2: 48}
    assert [t.get_text() for t in ax.get_legend().texts] == ["success", "drop", "timeout"]
    with pytest.raises(ValueError, match="make 49, not 48 attempts"):
        draw_outcomes(ax, [{**ROWS[1], "failures": {"drop": 13}}])


def test_degradation_has_a_line_an_arm_with_its_intervals() -> None:
    _, ax = plt.subplots()
    rows = [
        row("hadr", 36, 0.61, 0.85, hand_speed=1),
        row("hadr", 12, 0.15, 0.39, hand_speed=3),
        row("perfect", 40, 0.70, 0.92, hand_speed=1),
    ]
    draw_degradation(ax, rows[::-1], "hand_speed", "hand's speed", standard=1)
    first, second = (container.lines for container in ax.containers)
    np.testing.assert_allclose(first[0].get_ydata(), [75, 25])
    np.testing.assert_allclose(first[0].get_xdata(), [1, 3], atol=0.1)
    np.testing.assert_allclose(second[0].get_ydata(), [100 * 40 / 48])
    np.testing.assert_allclose([s[:, 1] for s in first[2][0].get_segments()], [[61, 85], [15, 39]])
    assert [t.get_text() for t in ax.get_legend().texts] == ["HADR", "perfect depth"]
