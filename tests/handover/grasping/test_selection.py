"""The choice of a grasp: it faces the human, keeps off the hand, can be reached.

Then when one is searched for, and how long a reason stays.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hadr.handover import ur5
from hadr.handover.grasping.candidates import NoCandidateError
from hadr.handover.grasping.collision import hand_distance
from hadr.handover.grasping.grasps import Grasps, Way, forward_of
from hadr.handover.grasping.selection import GraspSelection
from hadr.handover.logs.replay import replay
from hadr.handover.logs.run_log import RecordedHandover
from hadr.handover.observation import Observation
from hadr.handover.robot import UnreachableError
from hadr.handover.simulated_ur5 import SimulatedUR5
from hadr.handover.stages import ChosenGrasp, HandoverConfig, Stage
from hadr.simulation.trials.rehearsal import (
    REHEARSAL_CAMERA,
    MovingHand,
    rehearse,
    rehearsed_grasp,
    rehearsed_scene,
    visible_points,
)

SCENE = rehearsed_scene()
CAMERA = REHEARSAL_CAMERA
EYE = CAMERA[:3, 3]
STILL = MovingHand(SCENE, CAMERA, drift=0.0, turn=0.0)
DT = 0.02
POINTS = visible_points(SCENE, EYE)


def chosen(seed: int = 0, **more: Any) -> ChosenGrasp:
    """The grasp that is chosen of the rehearsed scene by an arm at home."""
    choose = GraspSelection(np.random.default_rng(seed), EYE, **more)
    found = choose(POINTS, SCENE.keypoints, SimulatedUR5())
    assert found is not None
    return found


def test_it_faces_the_human_and_keeps_off_the_hand() -> None:
    found = chosen()
    assert found.pose[0, 2] > 0.4  # approaches forward, to the human
    assert SimulatedUR5().reachable(found.pose)
    assert hand_distance(found.pose, found.width, SCENE.keypoints) > 0.02


def test_it_leaves_the_hand_its_way_back() -> None:
    # by the scores alone the first one that can be reached stands 5.6 mm beside that way
    found = chosen(1, rescoring=False)
    pose, back = forward_of(found.pose, 0.05), SCENE.keypoints[0] - SCENE.keypoints[9]
    links = ur5.link_surfaces(SimulatedUR5().joints_at(pose))
    for way in (0.03, 0.06, 0.10, 0.15):
        hand = SCENE.keypoints + way * back / np.linalg.norm(back)
        assert hand_distance(pose, found.width, hand, links) >= 0.006


@pytest.mark.parametrize("forward", [0.05, 0.055])
def test_the_way_that_is_gone_is_the_way_that_was_checked(forward: float) -> None:
    asked = []

    def choose(*given: object) -> ChosenGrasp | None:
        asked.append(given[-1])
        return GraspSelection(np.random.default_rng(0), EYE)(*given)  # type: ignore[arg-type]

    config = HandoverConfig(forward=forward, feel_ahead=0.05)
    handover = handover_with(choose, config)
    cautions(handover, 1.2)
    assert asked[0] == config.way == Way(0.10, pytest.approx(forward), 0.05)
    found, robot = handover.grasp, SimulatedUR5()
    assert found is not None
    ends = [forward_of(found.pose, forward + s) for s in (0.0, found.feel, found.feel + 0.01)]
    for end in ends[:2]:
        links = ur5.link_surfaces(robot.joints_at(end))
        assert hand_distance(end, found.width, SCENE.keypoints, links) > 0.011
    assert 0 <= found.feel <= 0.05
    if found.feel < 0.05:  # a centimetre more is too near, or out of reach
        blocked = not robot.reachable(ends[2])
        assert blocked or hand_distance(ends[2], found.width, SCENE.keypoints) < 0.02


def test_none_is_returned_where_nothing_can_be_reached() -> None:
    away = np.array([1.0, 0, 0])
    choose = GraspSelection(np.random.default_rng(0), EYE + away)
    assert choose(POINTS + away, SCENE.keypoints + away, SimulatedUR5()) is None


def test_without_rescoring_it_takes_the_score_alone() -> None:
    drawn = GraspSelection(np.random.default_rng(0), EYE, rescoring=False).candidates(POINTS)
    given, wish = {"source": lambda _: drawn}, np.array([0.4, 0.0, -0.2])
    plain, rescored = chosen(rescoring=False, **given), chosen(**given)
    assert 0 < plain.score <= 1
    assert rescored.pose[:3, 2] @ wish > plain.pose[:3, 2] @ wish + 0.02


def test_it_keeps_off_measured_points() -> None:
    free = chosen()
    # a wall where that gripper waits; then walls all around
    wall = np.random.default_rng(0).normal(0, 0.02, (200, 3)) + free.pose[:3, 3]
    wall -= 0.12 * free.pose[:3, 2]
    choose, robot = GraspSelection(np.random.default_rng(0), EYE), SimulatedUR5()
    other = choose(POINTS, SCENE.keypoints, robot, wall)
    assert other is None or np.abs(other.pose - free.pose).max() > 0.01
    out = np.random.default_rng(1).normal(size=(4000, 3))
    shell = POINTS.mean(axis=0) + 0.16 * out / np.linalg.norm(out, axis=1, keepdims=True)
    shut = GraspSelection(np.random.default_rng(0), EYE)
    assert shut(POINTS, SCENE.keypoints, robot, shell) is None


def grasp() -> ChosenGrasp:
    return ChosenGrasp(rehearsed_grasp(), 0.075, 1.0)


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


NONE = NoCandidateError("no candidate among 800 attempts")


@pytest.mark.parametrize("error", [NONE, UnreachableError("out"), np.linalg.LinAlgError("flat")])
def test_a_search_without_a_grasp_is_made_again_and_replayed(error: Exception) -> None:
    handover = handover_with(fails_first(error))
    words = cautions(handover, 12.0)
    assert f"no grasp: {error}" in words
    assert handover.stage is Stage.FINISHED
    assert handover.tries == 0
    assert replay(handover.log()).transitions == handover.transitions


def test_a_replayed_search_without_a_grasp_has_the_same_words() -> None:
    def choose(*_: object) -> ChosenGrasp:
        raise NONE

    handover = handover_with(choose)
    cautions(handover, 1.0)
    again = replay(handover.log())
    assert again.choosing.reason == handover.choosing.reason == f"no grasp: {NONE}"
    assert again.caution == handover.caution == f"no grasp: {NONE}"


@pytest.mark.parametrize("error", [TypeError("no tensor"), KeyError("scores"), IndexError(5)])
def test_a_defect_of_the_choice_is_no_missing_grasp(error: Exception) -> None:
    handover = handover_with(fails_first(error))
    with pytest.raises(type(error)):
        cautions(handover, 1.0)
    assert handover.stage is Stage.GAVE_UP  # and the robot stands


@pytest.mark.parametrize(
    "answer", [ValueError("shapes (3,) (4,)"), ChosenGrasp(np.ones((4, 4)), 0.08, 1.0)]
)
def test_a_value_error_of_the_choice_is_a_defect_too(answer: object) -> None:
    error = answer if isinstance(answer, Exception) else None
    with pytest.raises(RuntimeError, match=r"choice of a grasp failed: (shapes|the chosen grasp)"):
        cautions(handover_with(fails_first(error, answer)), 1.0)


def test_no_candidates_in_any_round_say_why() -> None:
    def source(points: np.ndarray) -> Grasps:
        raise NONE

    choose = GraspSelection(np.random.default_rng(0), EYE, source=source)
    with pytest.raises(NoCandidateError, match="among 800"):
        choose(POINTS, SCENE.keypoints, SimulatedUR5())


def test_the_reason_stays_until_the_next_search() -> None:
    """Between two searches, 0.3 s apart, no step is without a reason."""
    answers = iter([None, NoCandidateError("too few points")])

    def choose(*_: object) -> ChosenGrasp | None:
        answer = next(answers, grasp())
        if isinstance(answer, NoCandidateError):
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
    monkeypatch.setattr("hadr.handover.stages.CHOOSE_EVERY", 5.0)
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
    monkeypatch.setattr("hadr.handover.stages.CALM_SPEED", 1e-9)
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
