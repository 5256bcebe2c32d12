"""A rehearsal's hand, glass and moments are the same things as states of a film."""

from __future__ import annotations

import numpy as np
import pytest

from hadr.handover.robot import HOME_JOINTS
from hadr.handover.workflow import Stage
from hadr.simulation.film.rehearsal_film import film_scene, film_states
from hadr.simulation.trials.rehearsal import HeldGlass, Moment, MovingHand, camera_at

HELD = HeldGlass()
CAMERA = camera_at(np.array([0.0, -0.55, 0.65]), np.array([0.55, 0.0, 0.3]))


@pytest.fixture(scope="module")
def hand() -> MovingHand:
    return MovingHand(HELD, CAMERA, seed=1, drift=0.05, turn=0.2)


def moment(time: float, glass: np.ndarray, to_hand: float = 0.1) -> Moment:
    return Moment(
        time,
        Stage.APPROACH_AND_REACT,
        HOME_JOINTS,
        np.zeros((9, 3)),
        np.eye(4),
        0.05,
        HELD.keypoints,
        glass,
        np.nan,
        to_hand,
    )


def test_the_scene_has_the_same_hand_and_glass_at_the_same_place() -> None:
    scene = film_scene(HELD)
    np.testing.assert_allclose(scene.keypoints, HELD.keypoints, atol=1e-12)
    np.testing.assert_allclose(scene.base_from_object, HELD.base_from_glass, atol=1e-12)
    assert scene.item == HELD.glass


def test_the_drawn_hand_surrounds_the_keypoints() -> None:
    scene = film_scene(HELD)
    turn, at = scene.base_from_wrist[:3, :3], scene.base_from_wrist[:3, 3]
    skin = scene.hand(step=0.01).surface.vertices @ turn.T + at
    tips = scene.keypoints[[4, 8, 12, 16, 20]]
    assert np.linalg.norm(skin[:, None] - tips, axis=2).min(axis=0).max() < 0.02


def test_the_wrist_goes_where_the_keypoints_go(hand: MovingHand) -> None:
    now = 0.9
    glass = hand.motion(now) @ HELD.base_from_glass
    (state,) = film_states([moment(now, glass)], hand)
    # keypoint 0 is the wrist: the origin of its frame
    then = HELD.keypoints[0]
    expected = hand.motion(now)[:3, :3] @ then + hand.motion(now)[:3, 3]
    np.testing.assert_allclose(state.base_from_wrist[:3, 3], expected, atol=1e-12)
    assert np.linalg.norm(expected - then) > 0.01
    assert (state.time, state.gripper_width, state.hand_force) == (now, 0.05, 0.0)
    np.testing.assert_array_equal(state.joints, HOME_JOINTS)


def test_who_holds_the_glass_follows_from_where_it_is(hand: MovingHand) -> None:
    held = hand.motion(0.5) @ HELD.base_from_glass
    pulled = held.copy()
    pulled[0, 3] -= 0.01
    states = film_states([moment(0.5, held), moment(0.5, pulled)], hand)
    assert [state.holder for state in states] == ["hand", "gripper"]
    np.testing.assert_array_equal(states[1].base_from_object, pulled)


def test_skin_that_is_reached_into_is_at_distance_zero(hand: MovingHand) -> None:
    glass = hand.motion(0.0) @ HELD.base_from_glass
    (state,) = film_states([moment(0.0, glass, to_hand=-0.003)], hand)
    assert state.hand_distance == 0.0
