"""What an observation is worth."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from hadr.camera import Array
from hadr.handover.observation import HandWatch, Observation, cleaned
from hadr.handover.safety import FROZEN_FRAMES
from hadr.handover.tracking import HandFilter
from hadr.simulation.trials.rehearsal import rehearsed_scene

SCENE = rehearsed_scene()


def noisy(seed: int) -> np.ndarray:
    return SCENE.keypoints + np.random.default_rng(seed).normal(0, 1e-4, (21, 3))


def test_points_and_numbers_are_cleaned() -> None:
    cloud = np.ones((40, 3))
    cloud[0], cloud[1, 2], cloud[2, 0] = np.nan, np.inf, 1e200
    seen = cleaned(Observation(2, None, cloud, cloud[:4], None, np.inf))
    assert (seen.time, seen.confidence) == (2.0, None)
    np.testing.assert_array_equal(seen.scene_points, cloud[3:4])  # few, but in the way
    assert cleaned(Observation(2, None, cloud[:32], cloud[:3])).object_points is None  # 29 are left
    assert cleaned(Observation(2, None, cloud, cloud[:3])).scene_points is None
    assert np.isnan(seen.taken)
    assert seen.object_points is not None
    assert seen.object_points.shape == (37, 3)
    for odd in (cloud[:, :2], cloud.ravel(), "points", None):
        assert cleaned(Observation(0.0, None, odd)).object_points is None  # type: ignore[arg-type]
    for odd in (np.inf, np.nan, "2", 10**400, 1j):
        assert np.isnan(cleaned(Observation(0.0, confidence=odd)).confidence)  # type: ignore[arg-type]


def test_watch_sees_lost_silent_and_frozen() -> None:
    watch = HandWatch(np.eye(4))
    assert watch.look(Observation(0.0, noisy(0)), 0.0)
    assert not watch.look(Observation(0.02, noisy(1), frame_time=0.0), 0.02)  # the same picture
    assert not watch.look(Observation(0.04, noisy(1), frame_time=9.0), 0.04)  # the future
    assert not watch.look(Observation(0.06, noisy(1), frame_time=float("nan")), 0.06)
    np.testing.assert_array_equal(watch.keypoints, noisy(0))
    assert watch.trouble(0.29) == ""
    assert watch.trouble(0.30).startswith("the camera stopped")
    assert watch.look(Observation(0.3), 0.3)
    assert watch.keypoints is None
    assert watch.trouble(0.31) == "no hand seen for 0.31 s: no hand in the picture"
    assert watch.look(Observation(0.4, noisy(2)), 0.4)
    assert watch.trouble(0.4) == ""
    for k in range(4):
        assert watch.trouble(0.4 + 0.1 * k) == ""
        watch.look(Observation(0.5 + 0.1 * k, noisy(2)), 0.5 + 0.1 * k)
    assert "the same in 5 pictures" in watch.trouble(0.8)
    watch.look(Observation(0.9, noisy(3)), 0.9)
    assert watch.trouble(0.9) == ""


@pytest.mark.parametrize("none", [None, np.full((21, 3), np.nan), np.ones((20, 3))])
def test_a_picture_without_a_hand_is_no_frozen_one(none: np.ndarray | None) -> None:
    watch = HandWatch(np.eye(4))
    for k in range(6):
        watch.look(Observation(0.1 * k, noisy(0)), 0.1 * k)
    assert watch.blind(0.5).startswith("keypoints frozen")
    watch.look(Observation(0.6, none), 0.6)
    assert watch.blind(0.6) == ""
    assert watch.trouble(0.6) == ""  # the last hand is 0.1 s old
    watch.look(Observation(0.8, none), 0.8)
    assert watch.trouble(0.8).startswith("no hand seen for 0.30 s")


def test_watch_gives_the_hand_in_the_base_frame_and_its_speed() -> None:
    base_from_camera = np.array([[0, -1, 0, 1.0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    watch = HandWatch(base_from_camera)
    at_origin = SCENE.keypoints - SCENE.keypoints[0]
    for k in range(8):
        watch.look(Observation(0.1 * k, at_origin + np.array([0.02 * k, 0, 0])), 0.1 * k)
        if k == 1:
            assert watch.velocity(0.3) is None  # 0.1 s is less than half of it
    assert watch.keypoints is not None
    np.testing.assert_allclose(watch.keypoints[0], [1.0, 0.14, 0.0], atol=1e-12)
    np.testing.assert_allclose(watch.velocity(0.3), [0.0, 0.2, 0.0], atol=1e-9)


def test_five_pictures_a_second_give_a_speed_and_an_age_too() -> None:
    watch = HandWatch(np.eye(4))
    for k in range(2):
        assert watch.velocity(0.15) is None
        watch.look(Observation(0.2 * k, noisy(0) + np.array([0.0, 0.0, 0.03 * k])), 0.2 * k)
    np.testing.assert_allclose(watch.velocity(0.15), [0.0, 0.0, 0.15], atol=1e-9)
    watch.look(Observation(0.35, noisy(1), frame_time=0.2), 0.35)
    assert watch.age == pytest.approx(0.15)


def shown(turn_rate: float, velocity: float, until: float) -> Array:
    """A hand at a time, seconds, that turns about x and goes along y."""
    hand = noisy(0)
    angle = Rotation.from_rotvec([turn_rate * until, 0, 0]).as_matrix()
    turned = (hand - hand.mean(axis=0)) @ angle.T + hand.mean(axis=0)
    return np.asarray(turned + np.array([0.0, velocity * until, 0.0]))


@pytest.mark.parametrize(("rate", "counts"), [(2.0, 1.7), (0.25, 0.0), (-1.0, -0.7)])
def test_a_hand_that_turns_in_its_place_is_seen_to_turn_on(rate: float, counts: float) -> None:
    watch = HandWatch(np.eye(4))
    for picture in range(8):
        assert watch.soon(0.1) is None or picture > 1
        watch.look(Observation(0.1 * picture, shown(rate, 0.2, 0.1 * picture)), 0.1 * picture)
    soon, now = watch.soon(0.1), shown(rate, 0.2, 0.7)
    assert soon is not None
    expected = (now - now.mean(axis=0)) @ Rotation.from_rotvec([0.1 * counts, 0, 0]).as_matrix().T
    np.testing.assert_allclose(
        soon, expected + now.mean(axis=0) + np.array([0, 0.02, 0]), atol=1e-6
    )
    watch.look(Observation(0.8, np.zeros((21, 3))), 0.8)  # no hand
    assert watch.soon(0.1) is None


@pytest.mark.parametrize("jump", [0.12, 0.3, 0.49])
def test_a_hand_that_jumps_is_doubted_until_it_could_be_there(jump: float) -> None:
    watch = HandWatch(np.eye(4))
    doubted = 0
    for k in range(12):
        away = jump * (k > 3) * np.array([0.6, 0.8, 0.0])
        watch.look(Observation(0.1 * k, noisy(k) + away), 0.1 * k)
        told = watch.keypoints is not None and k == 4 + doubted > 4
        words = f"the hand is elsewhere: it jumped {100 * jump:.0f} cm"
        assert watch.jumped == words * told
        if k > 3 and watch.keypoints is None:
            doubted += 1
            assert watch.problem.startswith(f"the hand jumped {100 * jump:.0f} cm within 0.")
            np.testing.assert_array_equal(watch.last, noisy(3))
    # believed once it could have gone there at 0.8 m/s, less 2 cm
    assert doubted == int((jump - 0.02) / 0.8 / 0.1 - 1e-9)
    np.testing.assert_array_equal(watch.keypoints, noisy(11) + away)
    for k in range(4):  # and once in a picture only: back at once
        watch.look(Observation(1.2 + 0.1 * k, noisy(k) + away + jump * (k == 1)), 1.2 + 0.1 * k)
        assert (watch.keypoints is None) == (k == 1)
        assert not watch.jumped


TEN = np.arange(10, 40) / 10  # when pictures come, seconds, after ten good ones
LATE = TEN + 1.0


@pytest.mark.parametrize(
    ("came", "told", "believed"),
    [
        (TEN[:4], TEN[:4] - 1.6, False),
        (TEN[:5], TEN[:5] - 1.6, True),
        (TEN[:5], TEN[:5] + 1.4, True),
        (TEN[:5], TEN[:5] - 1e6, True),
        (TEN[:6], [99.0, *(TEN[1:6] - 1.6)], True),  # and a garbled one
        (1 + TEN[:10] / 50, TEN[:10] / 50 - 0.6, False),  # not for long enough
        (TEN, TEN - 1.6 - 0.3 * (np.arange(30) % 2), False),  # uneven
        (TEN, TEN - np.minimum(1.6, 0.1 + 0.05 * np.arange(30)), False),  # ever later
        (LATE, TEN - 0.1, False),  # late at once
        (LATE, [*TEN[:5] - 0.1, 1.5, 1.4, *TEN[7:] - 0.1], False),  # and a pair exchanged
        (LATE, [*TEN[:5] - 0.1, 99.0, *TEN[6:] - 0.1], False),  # and a garbled one
        ([1.0, *LATE[1:]], TEN - 1.6, False),  # another clock, and late
        (LATE + 1.0, TEN + 0.4, False),  # another clock while none came: it looks late
    ],
)
def test_a_clock_that_jumped_is_told_from_pictures_that_are_late(
    came: Array, told: Array, believed: bool
) -> None:
    watch, anew = HandWatch(np.eye(4)), [False]
    for time in np.arange(10) / 10:
        assert watch.look(Observation(time, noisy(0), frame_time=time - 0.1), time)
    for k, (time, frame_time) in enumerate(zip(came, told, strict=True)):
        anew.append(watch.look(Observation(time, noisy(k), frame_time=frame_time), time))
        assert not watch.look(Observation(time, noisy(k), frame_time=frame_time), time + 0.01)
    assert sum(anew[-5:]) == anew[-1] == believed


def test_pictures_that_stay_too_old_are_not_believed_but_named() -> None:
    """They are late, or the clock went back while none came: no number tells which."""
    watch, words = HandWatch(np.eye(4)), "the camera stopped: no new picture for "
    for time in np.arange(10) / 10:
        watch.look(Observation(time, noisy(0), frame_time=time - 0.1), time)
    assert watch.blind(2.9) == words + "2.00 s"
    for time in LATE + 1.0:
        assert not watch.look(Observation(time, noisy(0), frame_time=time - 1.6), time)
    assert watch.blind(5.9) == words + "5.00 s, what comes is 1.60 s old, or its clock is off"
    assert watch.look(Observation(6.0, noisy(0), frame_time=5.9), 6.0)  # set right
    assert watch.blind(6.3) == words + "0.30 s"


def test_no_picture_is_taken_for_younger_than_those_before_the_jump() -> None:
    watch = HandWatch(np.eye(4))
    for k, age in enumerate([0.3, 0.06, 0.1, 0.08, 0.06, 0.06]):
        assert watch.look(Observation(0.1 * k, noisy(k), frame_time=0.1 * k - age), 0.1 * k)
    for k, more in enumerate([0.02, 0.0, 0.05, 0.0, 0.03, 0.0, 0.07], start=6):
        new = watch.look(Observation(0.1 * k, noisy(k), frame_time=0.1 * k - 5.0 - more), 0.1 * k)
        assert new == (k >= 10)
        if new:  # the oldest of the last five came after 0.1 s
            assert watch.age == pytest.approx(0.1 + more)


def test_where_no_picture_was_believed_a_clock_that_is_off_is_never_forgiven() -> None:
    watch = HandWatch(np.eye(4))
    for k in range(30):
        assert not watch.look(Observation(0.1 * k, noisy(k), frame_time=0.1 * k + 5), 0.1 * k)


def test_a_hand_that_turns_faster_than_hands_do_is_doubted() -> None:
    watch = HandWatch(np.eye(4))
    for k in range(4):
        watch.look(Observation(0.1 * k, noisy(k)), 0.1 * k)
    middle = noisy(4).mean(axis=0)
    turned = (noisy(4) - middle) @ np.diag([-1.0, -1.0, 1.0]) + middle
    watch.look(Observation(0.4, turned), 0.4)
    assert watch.keypoints is None
    assert "the hand jumped" in watch.problem


@pytest.mark.parametrize(
    "odd", [[[10**400] * 3] * 21, torch.ones(21, 3, requires_grad=True)], ids=["huge", "tensor"]
)
def test_what_is_no_array_of_numbers_is_named_and_raises_nothing(odd: Any) -> None:
    watch = HandWatch(np.eye(4))
    found = cleaned(Observation(0.0, odd, object_points=odd))
    assert found.object_points is None
    assert watch.look(found, 0.0)
    assert watch.keypoints is None
    assert watch.problem


def test_a_camera_that_hangs_is_seen_behind_the_filter_too() -> None:
    watch, steadies = HandWatch(np.eye(4)), HandFilter()
    for k in range(20):
        taken = 0.1 * k
        watch.look(Observation(taken, steadies.steadied(taken, noisy(min(k, 10)))), taken)
        assert ("frozen" in watch.blind(taken)) == (k >= 10 + FROZEN_FRAMES - 1)
