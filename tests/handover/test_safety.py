"""The safety checks on cases that can be computed by hand."""

import numpy as np
import pytest

from hadr.handover.safety import (
    DECELERATION,
    LOOK_AHEAD,
    REACTION_TIME,
    allowed_speed,
    hand_problem,
    hand_pull,
    line_velocity,
    low_confidence,
    object_in_hand,
    separation,
    stopping_speed,
    withdrawal,
)

OFF = 0.008
"""Uncertainty of the hand's place, metres."""


def flat_hand(x: float = 0.0) -> np.ndarray:
    """Wrist at (x, 0, 0), all bones along y in the plane z = 0, a palm of 9 cm."""
    hand = np.zeros((21, 3))
    for finger in range(5):
        hand[1 + 4 * finger : 5 + 4 * finger, 1] = [0.09, 0.12, 0.14, 0.16]
        hand[1 + 4 * finger : 5 + 4 * finger, 0] = 0.01 * (finger - 2)
    hand[:, 0] += x
    return hand


def test_a_hand_is_told_from_other_numbers() -> None:
    assert hand_problem(flat_hand()) == ""
    assert "(20, 3)" in hand_problem(flat_hand()[:20])
    broken = flat_hand()
    broken[8, 1] = np.inf
    assert "index_tip" in hand_problem(broken)
    far = flat_hand() + np.array([0, 0, 7.0])
    assert hand_problem(far) == "a keypoint lies 7 m away, a hand at most 5.0 m"
    assert hand_problem(3 * flat_hand()).startswith("no hand has a palm of 0.270 m")
    assert hand_problem(np.zeros((21, 3))).startswith("no hand has a palm of 0.000 m")
    line = np.linspace([0, 0, 0.5], [0, 0.2, 0.5], 21)
    assert hand_problem(line).startswith("the keypoints lie on one line within 0.0 mm")
    assert hand_problem("hand") != ""  # type: ignore[arg-type]


def test_speed_of_a_line_and_of_noise_around_it() -> None:
    times = np.array([0.0, 0.1, 0.2, 0.3])
    points = np.outer(times, [0.1, 0.0, -0.2]) + np.array([5.0, 1.0, 2.0])
    np.testing.assert_allclose(line_velocity(times, points), [0.1, 0.0, -0.2], atol=1e-12)
    points[[0, 3], 1] += 0.01  # even about the middle: no slope
    np.testing.assert_allclose(line_velocity(times, points), [0.1, 0.0, -0.2], atol=1e-12)


def test_the_speed_that_stops_within_a_way_by_hand() -> None:
    # 0.1 s at 0.05 m/s, and 0.05^2 / 1.6 to brake
    assert stopping_speed(0.0065625, 0.0) == pytest.approx(0.05)
    assert stopping_speed(-0.01, 0.0) == stopping_speed(0.0, 0.3) == 0.0


def test_separation_has_the_standard_s_terms_by_hand() -> None:
    # 0.35 m/s, brakes at 0.8 m/s2: 0.4375 s and 77 mm; the hand comes at 0.2 m/s
    terms = separation(0.35, 0.2, 0.15, 0.005, OFF)
    assert terms.stopping == pytest.approx(0.0765625)
    assert terms.robot == pytest.approx(0.035)
    assert terms.human == pytest.approx(0.2 * (0.15 + 0.10 + 0.4375))
    assert terms[3:] == (0.005, 0.008, 0.002)
    assert terms.distance == pytest.approx(0.0765625 + 0.035 + 0.1375 + 0.015)


@pytest.mark.parametrize("closing", [0.0, 0.05, 0.3])
@pytest.mark.parametrize("age", [0.02, 0.3])
def test_a_robot_that_brakes_at_the_allowed_speed_keeps_the_least_distance(
    closing: float, age: float
) -> None:
    """Both move on, step by step, from when the picture was taken until the robot stands."""
    for free in (0.02, 0.08, 0.2, 0.5):
        start = speed = allowed_speed(free, closing, age, 0.005, OFF)
        time = way = 0.0
        dt = 1e-4
        while speed > 0:
            if time >= REACTION_TIME:
                speed = max(0.0, speed - DECELERATION * dt)
            time, way = time + dt, way + speed * dt
        # what was measured on the first 5 cm of the path, and straight at the hand beyond
        gap = min(free, free + LOOK_AHEAD - way) - closing * (age + time)
        if start > 0:
            kept = 0.005 + 0.008 + 0.002
            assert gap > kept - 2e-4
            if closing > 0 or way > LOOK_AHEAD:
                assert gap == pytest.approx(kept, abs=2e-4)
        else:
            assert separation(0.0, closing, age, 0.005, OFF).distance >= free


def test_withdrawal_by_speed_and_by_distance_along_the_way() -> None:
    away = np.array([1.0, 0, 0])
    assert withdrawal(np.array([0.1, 0.5, 0]), np.array([0.1, 1.0, 0]), away) == ""
    assert "16 cm" in withdrawal(np.array([0.16, 0, 0]), None, away)
    assert "0.25 m/s" in withdrawal(np.zeros(3), np.array([0.25, 0, 0]), away)
    assert withdrawal(np.zeros(3), np.array([-0.25, 0, 0]), away) == ""


def test_confidence_and_object_in_hand() -> None:
    assert low_confidence(None) == low_confidence(0.3) == ""
    assert "0.29, needed 0.30" in low_confidence(0.29)
    assert low_confidence(float("nan")) != ""
    assert object_in_hand(np.array([[1.0, 0, 0], [0, 0.1, 0.049]]), flat_hand())
    assert not object_in_hand(np.array([[0, 0.1, 0.051]]), flat_hand())


def test_of_a_pull_on_a_way_counts_what_is_against_it_and_half_of_what_is_across() -> None:
    way = np.array([1.0, 0.0, 0.0])
    for force, pull in (
        ([-4.0, 0.0, 0.0], 4.0),
        ([4.0, 0.0, 0.0], 0.0),
        ([9.0, 6.0, 0.0], 3.0),
        ([-4.0, 6.0, 0.0], 5.0),
        ([0.0, 0.0, -4.0], 0.0),
        ([0.0, 0.0, 4.0], 2.0),
    ):
        assert hand_pull(np.array(force), way) == pytest.approx(pull)
