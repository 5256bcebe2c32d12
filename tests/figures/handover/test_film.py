"""Figures of recorded handovers say what the states and the rows say."""

from dataclasses import replace

import numpy as np
import pytest

from hadr.figures.handover.film import decisive_state, film_strip, show_run
from hadr.handover.simulated_ur5 import HOME_JOINTS
from hadr.handover.stages import Stage, Transition
from hadr.simulation.film.world_view import side_view
from hadr.simulation.world.scenes import HeldScene, held_scene
from hadr.simulation.world.state import WorldState

CHANGES = [
    Transition(1.0, Stage.WAIT_AND_OBSERVE, Stage.APPROACH_AND_REACT, "chose a grasp"),
    Transition(3.0, Stage.APPROACH_AND_REACT, Stage.STOPPED, "no hand seen for 0.30 s"),
]


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
            through_force=2.5 * k,
            holder="gripper" if k > 5 else "hand",
        )
        for k in range(8)
    ]


def test_a_strip_has_a_still_a_time_with_its_stage_below(
    scene: HeldScene, states: list[WorldState]
) -> None:
    view = side_view(64, 36)
    figure = film_strip(states, [0.0, 1.4, 3.0], scene, CHANGES, view=view, columns=2)
    assert len(figure.axes) == 3
    labels = [ax.get_xlabel() for ax in figure.axes]
    assert labels == ["0.0 s  Wait & Observe", "1.5 s  Approach & React", "3.0 s  Stopped"]
    assert [ax.images[0].get_array().shape for ax in figure.axes] == [(36, 64, 3)] * 3
    named = film_strip(states, [0.0], scene, [], view=view, columns=2, names=["it waits"])
    assert named.axes[0].get_xlabel() == "0.0 s  it waits\nWait & Observe"


def test_a_run_is_drawn_in_centimetres_millimetres_and_newtons(states: list[WorldState]) -> None:
    top, middle, low = show_run(states, CHANGES).axes
    np.testing.assert_allclose(top.lines[0].get_ydata(), 20.0)
    np.testing.assert_allclose(middle.lines[0].get_ydata(), 85 - 5 * np.arange(8))
    np.testing.assert_allclose(low.lines[0].get_ydata(), 1.5 * np.arange(8))
    np.testing.assert_allclose(low.lines[1].get_ydata(), 2.5 * np.arange(8))
    assert low.lines[2].get_ydata()[0] == 20.0
    assert middle.lines[1].get_xdata()[0] == 3.0  # the first state that the gripper holds it in
    bands = [(p.get_x(), p.get_x() + p.get_width()) for p in low.patches]
    np.testing.assert_allclose(bands, [(0, 1), (1, 3), (3, 3.5)])
    assert [t.get_text() for t in top.texts] == ["Wait & Observe", "Approach & React", "Stopped"]


def test_what_decides_an_attempt_is_the_taking_or_the_failure(states: list[WorldState]) -> None:
    assert decisive_state(states, {"verdict": "success", "decided_at": 3.5}).time == 3.0
    assert decisive_state(states, {"verdict": "drop", "decided_at": 3.4}).time == 3.5
    assert decisive_state(states[:2], {"verdict": "time-out", "decided_at": 9.0}).time == 0.5
