"""How hands move: identity at the start, rest in the end, every kind as it is called."""

from collections import Counter

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hadr.simulation.trials import TRIAL_HOLDS, TRIAL_OBJECTS
from hadr.simulation.world import hand_motions
from hadr.simulation.world.hand_motions import (
    KINDS,
    MotionKind,
    SeededMotion,
    kind_for,
    motion_for,
)
from hadr.simulation.world.scenes import held_scene

WRIST = np.array([0.70, 0.05, 0.30])
TIMES = np.arange(0.0, 14.0, 0.02)


@pytest.fixture
def no_tremor(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hand_motions, "TREMOR", 0.0)
    monkeypatch.setattr(hand_motions, "TREMOR_TURN", 0.0)


def wrist_path(motion: SeededMotion, times: np.ndarray = TIMES) -> np.ndarray:
    poses = np.array([motion.moved(float(t)) for t in times])
    return poses[:, :3, :3] @ motion.wrist + poses[:, :3, 3]


def turned(motion: SeededMotion, times: np.ndarray = TIMES) -> np.ndarray:
    return np.array([Rotation.from_matrix(motion.moved(t)[:3, :3]).magnitude() for t in times])


@pytest.mark.parametrize("kind", KINDS)
def test_every_motion_starts_at_the_identity_exactly_and_stays_rigid(kind: MotionKind) -> None:
    motion = SeededMotion(kind, WRIST, 3)
    assert np.array_equal(motion.moved(0.0), np.eye(4))
    assert np.array_equal(motion.moved(-1.0), np.eye(4))
    for time in (0.4, 2.5, 9.0):
        pose = motion.moved(time)
        np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
        np.testing.assert_array_equal(pose[3], [0, 0, 0, 1])


@pytest.mark.parametrize("kind", KINDS)
def test_motions_are_smooth_and_reproducible(kind: MotionKind) -> None:
    motion, again = SeededMotion(kind, WRIST, 5), SeededMotion(kind, WRIST, 5)
    np.testing.assert_array_equal(wrist_path(motion), wrist_path(again))
    assert not np.allclose(wrist_path(motion), wrist_path(SeededMotion(kind, WRIST, 6)))
    fine = np.arange(0.0, 8.0, 0.005)
    steps = np.linalg.norm(np.diff(wrist_path(motion, fine), axis=0), axis=1)
    assert steps.max() < 0.005 * 0.8  # no jump: under 0.8 m/s


def test_a_still_hand_trembles_by_about_a_millimetre() -> None:
    path = wrist_path(SeededMotion("still", WRIST, 1), np.arange(0, 60, 0.01))
    spread = np.sqrt(((path - path.mean(axis=0)) ** 2).sum(axis=1).mean())
    assert spread == pytest.approx(0.001, rel=0.15)


@pytest.mark.parametrize("kind", ["drift", "swing", "turn"])
def test_motions_calm_down_unless_the_hand_is_restless(kind: MotionKind, no_tremor: None) -> None:
    motion, restless = SeededMotion(kind, WRIST, 2), SeededMotion(kind, WRIST, 2, restless=True)
    poses = np.array([motion.moved(float(t))[:3] for t in TIMES])
    change = np.abs(np.diff(poses, axis=0)).max(axis=(1, 2)) / 0.02
    assert change[TIMES[:-1] < 2].max() > 0.03
    assert change[TIMES[:-1] > 10].max() < 1e-3
    poses = np.array([restless.moved(t)[:3] for t in TIMES])
    assert np.abs(np.diff(poses[-250:], axis=0)).max() / 0.02 > 0.03


def test_each_kind_moves_as_it_is_called(no_tremor: None) -> None:
    drift, swing, turn = (SeededMotion(k, WRIST, 4, restless=True) for k in KINDS[1:4])
    away = np.abs(wrist_path(drift) - WRIST).max(axis=0)
    np.testing.assert_allclose(away, hand_motions.DRIFT, rtol=0.01)
    assert turned(drift).max() < 1e-7
    # a swing goes to the side along one horizontal line
    path = wrist_path(swing) - WRIST
    assert np.abs(path[:, 2]).max() < 1e-12
    assert np.linalg.norm(path, axis=1).max() == pytest.approx(hand_motions.SWING, rel=0.01)
    assert np.linalg.matrix_rank(path, tol=1e-9) == 1
    assert np.abs(path[:, 1]).max() > 0.8 * hand_motions.SWING
    assert turned(swing).max() == pytest.approx(hand_motions.SWING_TURN, rel=0.01)
    # a turn leaves the wrist where it is
    np.testing.assert_allclose(wrist_path(turn), np.broadcast_to(WRIST, path.shape), atol=1e-12)
    assert turned(turn).max() == pytest.approx(hand_motions.TURN, rel=0.01)


@pytest.mark.parametrize("seed", range(5))
def test_a_hand_gives_withdraws_and_gives_again(seed: int, no_tremor: None) -> None:
    path = wrist_path(SeededMotion("give-and-withdraw", WRIST, seed)) - WRIST
    away = np.linalg.norm(path, axis=1)
    assert 0.15 - 1e-9 <= away.max() <= 0.25 + 1e-9
    assert path[away.argmax(), 0] > 0.9 * away.max() * 0.95  # toward the human
    leaves = TIMES[away > 0.005 * away.max()][0]
    assert 1.5 <= leaves <= 3.3
    there = TIMES[away > 0.995 * away.max()]
    assert 0.5 < there[0] - leaves < 1.0  # the way back takes about a second
    assert 1.0 <= there[-1] - there[0] < 2.5
    assert away[-1] <= 0.02 * np.sqrt(3)
    np.testing.assert_array_equal(path[-1], path[-100])


@pytest.mark.parametrize("seed", range(5))
def test_a_hand_steps_aside_once_and_stays_there(seed: int, no_tremor: None) -> None:
    path = wrist_path(SeededMotion("step-aside", WRIST, seed)) - WRIST
    away = np.linalg.norm(path, axis=1)
    assert (np.diff(away) >= 0).all()
    assert 0.12 <= away[-1] <= 0.20
    assert -path[-1, 1] > 0.8 * away[-1]  # to the robot's right, which its camera sees
    begins, ends = TIMES[away > 0.005 * away[-1]][0], TIMES[away > 0.995 * away[-1]][0]
    assert 1.5 <= begins <= 3.3
    assert 0.6 < ends - begins < 1.0


def test_speed_goes_through_the_same_motion_faster(no_tremor: None) -> None:
    slow, fast = (SeededMotion("drift", WRIST, 7, speed, restless=True) for speed in (1.0, 3.0))
    for time in (0.3, 1.0, 2.2):
        np.testing.assert_allclose(fast.moved(time), slow.moved(3 * time), atol=1e-12)
    slow, fast = (SeededMotion("give-and-withdraw", WRIST, 7, speed) for speed in (1.0, 3.0))
    steps = [np.linalg.norm(np.diff(wrist_path(m), axis=0), axis=1).max() for m in (slow, fast)]
    assert steps[1] / steps[0] == pytest.approx(3.0, rel=0.02)


def test_all_kinds_occur_for_every_object_of_the_experiment() -> None:
    for seed in (0, 3):
        for name in TRIAL_OBJECTS:
            assert {kind_for(name, hold, seed) for hold in TRIAL_HOLDS} == set(KINDS)
        counts = Counter(kind_for(n, h, seed) for n in TRIAL_OBJECTS for h in TRIAL_HOLDS)
        assert min(counts.values()) >= 8


def test_the_motion_of_an_attempt_turns_about_the_scenes_wrist() -> None:
    scene = held_scene("0004", 921)
    motion = motion_for(scene, 921)
    np.testing.assert_array_equal(motion.wrist, scene.base_from_wrist[:3, 3])
    assert not np.allclose(motion_for(scene, 926).moved(2.0), motion.moved(2.0))


def test_hands_that_all_turn_turn_so_far(no_tremor: None) -> None:
    scene, angle = held_scene("0004", 921), np.deg2rad(50)
    for hold in (921, 922):  # two kinds of motion else
        motion = motion_for(scene, hold, restless=True, turn=angle)
        path = wrist_path(motion)
        np.testing.assert_allclose(path, np.broadcast_to(motion.wrist, path.shape), atol=1e-12)
        assert turned(motion).max() == pytest.approx(angle, rel=0.01)
