"""What an observation is worth; when a grasp is searched for, and how long a reason stays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from hadr.handover.observation import HandWatch, Observation, cleaned
from hadr.handover.poses import camera_at
from hadr.handover.replay import replay
from hadr.handover.robot import SimulatedUR5
from hadr.handover.run_log import RecordedHandover
from hadr.handover.safety import SafetyConfig
from hadr.handover.stages import ChosenGrasp, HandoverConfig, Stage
from hadr.simulation.trials.rehearsal import MovingHand, rehearse, rehearsed_scene

SCENE = rehearsed_scene()
CAMERA = camera_at(np.array([0.0, -0.55, 0.65]), np.array([0.55, 0.0, 0.3]))
STILL = MovingHand(SCENE, CAMERA, drift=0.0, turn=0.0)
DT = 0.02


def noisy(seed: int) -> np.ndarray:
    return SCENE.keypoints + np.random.default_rng(seed).normal(0, 1e-4, (21, 3))


def test_points_and_numbers_are_cleaned() -> None:
    cloud = np.ones((40, 3))
    cloud[0], cloud[1, 2], cloud[2, 0] = np.nan, np.inf, 1e200
    seen = cleaned(Observation(2, None, cloud, cloud[:32], None, np.inf))  # 29 are left of these
    assert (seen.time, seen.scene_points, seen.confidence) == (2.0, None, None)
    assert np.isnan(seen.taken)
    assert seen.object_points is not None
    assert seen.object_points.shape == (37, 3)
    for odd in (cloud[:, :2], cloud.ravel(), "points", None):
        assert cleaned(Observation(0.0, None, odd)).object_points is None  # type: ignore[arg-type]
    for odd in (np.inf, np.nan, "2", 10**400, 1j):
        assert np.isnan(cleaned(Observation(0.0, confidence=odd)).confidence)  # type: ignore[arg-type]


def test_watch_sees_lost_silent_and_frozen() -> None:
    watch = HandWatch(np.eye(4), SafetyConfig())
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


def test_watch_gives_the_hand_in_the_base_frame_and_its_speed() -> None:
    base_from_camera = np.array([[0, -1, 0, 1.0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    watch = HandWatch(base_from_camera, SafetyConfig())
    at_origin = SCENE.keypoints - SCENE.keypoints[0]
    for k in range(8):
        watch.look(Observation(0.1 * k, at_origin + np.array([0.02 * k, 0, 0])), 0.1 * k)
        if k == 1:
            assert watch.velocity(0.3) is None  # 0.1 s is less than half of it
    assert watch.keypoints is not None
    np.testing.assert_allclose(watch.keypoints[0], [1.0, 0.14, 0.0], atol=1e-12)
    np.testing.assert_allclose(watch.velocity(0.3), [0.0, 0.2, 0.0], atol=1e-9)


def grasp() -> ChosenGrasp:
    pose = np.eye(4)
    pose[:3, :3] = [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
    pose[:3, 3] = SCENE.base_from_object[:3, 3] + [-0.033, 0, 0.17]
    return ChosenGrasp(pose, 0.075, 1.0)


def handover_with(
    choose: Callable[..., object], config: HandoverConfig | None = None
) -> RecordedHandover:
    return RecordedHandover(SimulatedUR5(), choose, CAMERA, config or HandoverConfig())  # type: ignore[arg-type]


def cautions(
    handover: RecordedHandover,
    longest: float,
    *,
    hand: MovingHand = STILL,
    spoil: Callable[[Observation], Observation] = lambda seen: seen,
) -> list[str]:
    """What was said after each step that waits for a grasp."""
    words = []

    def listen(seen: Observation) -> Observation:
        if seen.time > 0 and handover.stage is Stage.WAIT_AND_OBSERVE:
            words.append(handover.caution)
        return spoil(seen)

    rehearse(
        handover, hand, dt=DT, longest=longest, past_stops=True, picture_every=0.1, spoil=listen
    )
    return words


def fails_first(error: Exception | None, answer: object = None) -> Callable[..., object]:
    """Chooses well from the second call on."""
    calls = []

    def choose(*_: object) -> object:
        calls.append(1)
        if len(calls) > 1:
            return grasp()
        if error is not None:
            raise error
        return answer

    return choose


@pytest.mark.parametrize("error", [TypeError("no tensor"), KeyError("scores"), OSError(5)])
def test_a_detector_that_fails_is_named(error: Exception) -> None:
    words = cautions(handover_with(fails_first(error)), 0.6)
    assert f"no grasp: the detector failed: {type(error).__name__}: {error}" in words


def test_a_detector_that_fails_is_asked_again() -> None:
    handover = handover_with(fails_first(RuntimeError("out of memory")))
    words = cautions(handover, 12.0)
    assert "no grasp: the detector failed: RuntimeError: out of memory" in words
    assert handover.stage is Stage.FINISHED
    assert handover.tries == 0
    again = replay(handover.log())
    assert again.transitions == handover.transitions


def test_an_answer_that_is_no_grasp_is_a_failure_of_the_detector() -> None:
    handover = handover_with(fails_first(None, answer=(np.eye(4), 0.08)))
    assert any("failed: AttributeError" in said for said in cautions(handover, 12.0))
    assert handover.stage is Stage.FINISHED
    assert replay(handover.log()).transitions == handover.transitions


def test_a_replayed_failure_has_the_same_words() -> None:
    def choose(*_: object) -> ChosenGrasp:
        raise RuntimeError("out of memory")

    handover = handover_with(choose)
    cautions(handover, 1.0)
    again = replay(handover.log())
    expected = "no grasp: the detector failed: RuntimeError: out of memory"
    assert again.choosing.reason == handover.choosing.reason == expected
    assert again.caution == handover.caution == expected


def test_an_interrupt_is_no_failure_of_the_detector() -> None:
    def choose(*_: object) -> ChosenGrasp:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cautions(handover_with(choose), 1.0)


def test_the_reason_stays_until_the_next_search() -> None:
    """Between two searches, 0.3 s apart, no step is without a reason."""
    answers = iter([None, ValueError("too few points")])

    def choose(*_: object) -> ChosenGrasp | None:
        answer = next(answers, grasp())
        if isinstance(answer, ValueError):
            raise answer
        return answer

    words = cautions(handover_with(choose), 3.0)
    first = words.index("no grasp: none that is free and within reach")
    second = words.index("no grasp: too few points")
    assert set(words[first:second]) == {"no grasp: none that is free and within reach"}
    assert set(words[second:]) == {"no grasp: too few points"}
    assert second - first == pytest.approx(0.3 / DT, abs=1)


def test_another_obstacle_is_said_first_and_the_reason_after_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("hadr.handover.observation.CHOOSE_EVERY", 5.0)
    handover = handover_with(lambda *_: None)
    words = cautions(
        handover,
        1.5,
        spoil=lambda seen: replace(seen, confidence=0.1) if 0.8 <= seen.time < 1.0 else seen,
    )
    lacking, doubt = "no grasp: none that is free and within reach", "restored depth of confidence"
    told = [said for said, before in zip(words, ["", *words], strict=False) if said != before]
    assert told[-3] == told[-1] == lacking
    assert told[-2].startswith(doubt)
    assert handover.choosing.reason == lacking


def test_not_calm_stays_said_between_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hadr.handover.observation.CALM_SPEED", 1e-9)
    restless = MovingHand(SCENE, CAMERA, drift=0.04, calm_after=np.inf)
    handover = handover_with(lambda *_: None)
    words = cautions(handover, 1.5, hand=restless)
    assert set(words[20:]) == {"the hand is not calm yet"}


def test_a_handover_that_ends_without_a_grasp_names_the_reason() -> None:
    handover = handover_with(lambda *_: None, HandoverConfig(patience=1.0))
    cautions(handover, 5.0)
    assert handover.transitions[0].reason == (
        "no handover within 1 s; no grasp: none that is free and within reach"
    )


def test_a_new_start_forgets_the_reason() -> None:
    handover = handover_with(lambda *_: None)
    cautions(handover, 1.0)
    assert handover.choosing.reason
    handover.choosing.start()
    assert (handover.choosing.reason, handover.choosing.caution) == ("", "")
