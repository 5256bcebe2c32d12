"""The three stages: every transition, every way to stop and to go on, the limits on the way."""

import copy
import functools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hadr.camera import transform_points
from hadr.handover import safety, ur5
from hadr.handover.grasping.grasps import forward_of
from hadr.handover.grasping.selection import GraspSelection
from hadr.handover.guarded_arm import GuardedArm
from hadr.handover.observation import Observation
from hadr.handover.poses import pose_distance
from hadr.handover.safety import TOWED
from hadr.handover.simulated_ur5 import TABLE, SimulatedUR5, in_workspace
from hadr.handover.stages import ChosenGrasp, HandoverConfig, Stage
from hadr.handover.tracking import hand_motion
from hadr.handover.workflow import Handover
from hadr.simulation.trials.rehearsal import (
    REHEARSAL_CAMERA,
    Moment,
    MovingHand,
    rehearse,
    rehearsed_grasp,
    rehearsed_scene,
)

SCENE = rehearsed_scene()
CAMERA = REHEARSAL_CAMERA
DT = 0.02
STAGES = [Stage.APPROACH_AND_REACT, Stage.GRASP_AND_RETRIEVE, Stage.FINISHED]
STILL = MovingHand(SCENE, CAMERA, drift=0.0, turn=0.0)
Spoil = Callable[[Observation], Observation]


def fixed_handover(config: HandoverConfig | None = None) -> Handover:
    """Chooses the grasp that is fixed to the glass wherever the hand has moved it."""

    def choose(_: object, keypoints: np.ndarray, *__: object) -> ChosenGrasp:
        moved = hand_motion(SCENE.keypoints, keypoints)
        return ChosenGrasp(moved.move_pose(rehearsed_grasp()), 0.075, 1.0)

    return Handover(SimulatedUR5(), choose, CAMERA, config or HandoverConfig())


def run(
    handover: Handover, hand: MovingHand = STILL, spoil: Spoil | None = None, *, longest: float = 30
) -> list[Moment]:
    """Steps at 50 Hz, pictures at 10 Hz, until it has finished or given up."""
    return rehearse(
        handover, hand, dt=DT, longest=longest, past_stops=True, picture_every=0.1, spoil=spoil
    )


def during(start: float, end: float, **wrong: object) -> Spoil:
    """Breaks parts of the observations of a span of time."""
    return lambda seen: replace(seen, **wrong) if start <= seen.time < end else seen


def first_stop(handover: Handover) -> tuple[float, str]:
    found = next(t for t in handover.transitions if t.after is Stage.STOPPED)
    return found.time, found.reason


def afters(handover: Handover) -> list[Stage]:
    return [t.after for t in handover.transitions]


def test_most_run_through_the_stages_and_all_keep_every_limit() -> None:
    """Three seeds: with another rounding a grasp that is drawn may be another one."""
    finished = 0
    for seed in (0, 1, 3):
        choose = GraspSelection(np.random.default_rng(seed), CAMERA[:3, 3])
        handover = Handover(SimulatedUR5(), choose, CAMERA)
        moments = run(handover, MovingHand(SCENE, CAMERA, seed=seed))
        finished += afters(handover) == STAGES
        assert all(t.reason for t in handover.transitions)
        joints = np.array([m.joints for m in moments])
        assert np.abs(np.diff(joints, axis=0)).max() <= 0.25 * ur5.JOINT_SPEED * DT + 1e-9
        assert min(m.outline[2:, 2].min() for m in moments) > 0.03
        assert min(m.hand_distance for m in moments) > 0.005
        tools = np.array([m.tool[:3, 3] for m in moments])
        assert np.linalg.norm(np.diff(tools, axis=0), axis=1).max() <= 1.3 * 0.25 * DT
    assert finished >= 2


def test_same_seed_same_handover() -> None:
    first, second = (run(fixed_handover(), MovingHand(SCENE, CAMERA), longest=2.5) for _ in "ab")
    np.testing.assert_array_equal([m.joints for m in first], [m.joints for m in second])


def test_approach_follows_the_moved_hand_and_without_tracking_does_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("hadr.handover.stages.CALM_SPEED", np.inf)
    hand = MovingHand(SCENE, CAMERA, seed=2, noise=0.0)
    start = forward_of(rehearsed_grasp(), -0.10)
    for tracking in (True, False):
        handover = fixed_handover(HandoverConfig(tracking=tracking))
        chosen_at = None
        for step in range(40):
            time = step * DT
            handover.step(hand.observe(time), DT)
            if handover.stage is not Stage.APPROACH_AND_REACT:
                continue
            assert handover.target is not None
            if chosen_at is None:
                chosen_at = time
                continue
            expected = hand.moved(time if tracking else chosen_at) @ start
            np.testing.assert_allclose(handover.target, expected, atol=1e-9)
        assert chosen_at is not None


@pytest.mark.parametrize(("reading", "travel"), [("past_grasp", 0.15), ("from_pre_grasp", 0.05)])
def test_final_move_travels_as_read(reading: str, travel: float) -> None:
    handover = fixed_handover(HandoverConfig(final_move=reading, tries=1))
    moments = run(handover)
    waiting = forward_of(rehearsed_grasp(), -0.10)
    far = max(
        (m.tool[:3, 3] - waiting[:3, 3]) @ waiting[:3, 2]
        for m in moments
        if m.stage is Stage.GRASP_AND_RETRIEVE
    )
    assert far == pytest.approx(travel, abs=1e-3)
    if reading == "past_grasp":
        assert afters(handover) == STAGES
        assert pose_distance(moments[-1].tool, SimulatedUR5().tool_pose())[0] < 0.01  # home
    else:  # 5 cm short of the glass
        assert "closed on nothing" in first_stop(handover)[1]
        assert afters(handover)[-1] is Stage.GAVE_UP


def test_hand_lost_for_three_tenths_stops_it_and_it_goes_on_when_it_is_back() -> None:
    handover = fixed_handover()
    moments = run(handover, spoil=during(1.0, 2.0, keypoints=None))
    time, reason = first_stop(handover)
    assert reason == "no hand seen for 0.30 s: no hand in the picture"
    assert time == pytest.approx(0.9 + 0.3)
    held = [m.joints for m in moments if 1.3 <= m.time < 1.95]  # it has braked
    assert np.abs(np.diff(held, axis=0)).max() < 1e-9
    again = next(t for t in handover.transitions if t.before is Stage.STOPPED)
    assert again.after is Stage.WAIT_AND_OBSERVE
    assert again.time == pytest.approx(2.0 + 0.5, abs=0.03)
    assert handover.stage is Stage.FINISHED


def test_nan_and_wrong_shape_hold_the_arm_and_name_the_keypoint() -> None:
    bad = STILL.observe(0.0).keypoints
    assert bad is not None
    bad[8] = np.nan
    for keypoints, words in ((bad[:20], "(20, 3)"), (1e3 * bad, "finite"), (bad, "index_tip")):
        handover = fixed_handover()
        longest = 2.0 if words != "index_tip" else 30.0
        moments = run(handover, spoil=during(1.0, 99, keypoints=keypoints), longest=longest)
        assert words in first_stop(handover)[1]
        held = [m.joints for m in moments if 1.3 <= m.time < 2.0]
        assert np.abs(np.diff(held, axis=0)).max() < 1e-9
    assert afters(handover)[-2:] == [Stage.GOING_HOME, Stage.GAVE_UP]
    assert words in handover.transitions[-2].reason
    home = SimulatedUR5().tool_pose()
    assert pose_distance(handover.robot.tool_pose(), home)[0] < 0.01


@pytest.mark.parametrize(("hangs", "expected"), [(False, 1.5), (True, 0.3 + 2 * 1.2)])
def test_a_camera_that_stops_on_the_way_back_slows_it(hangs: bool, expected: float) -> None:
    handover = fixed_handover()
    begun: list[Observation] = []
    carried: list[float] = []

    def hang(seen: Observation) -> Observation:
        if handover.part == "retreat":
            begun.append(seen)
        if handover.part == "carry":
            carried.append(seen.time)
        return replace(seen, frame_time=begun[0].taken) if begun and hangs else seen

    run(handover, spoil=hang)
    assert handover.stage is Stage.FINISHED
    # 15 cm at 0.1 m/s; the camera is missed after 0.3 s, the other 12 cm take twice as long
    assert carried[0] - begun[0].time == pytest.approx(expected, abs=0.12)


def test_without_pictures_it_stands_and_does_not_go_home() -> None:
    """Nobody knows where the hand is by now; a person has to look after the camera."""
    handover = fixed_handover()
    moments = run(
        handover, spoil=lambda seen: replace(seen, frame_time=min(seen.taken, 1.0)), longest=60
    )
    assert afters(handover)[-2:] == [Stage.GOING_HOME, Stage.GAVE_UP]
    assert "home not reached" in handover.transitions[-1].reason
    held = [m.joints for m in moments if m.time > 1.5]
    assert np.abs(np.diff(held, axis=0)).max() < 1e-9


def test_another_holding_pose_is_observed_again() -> None:
    def spread(seen: Observation) -> Observation:
        assert seen.keypoints is not None
        points = seen.keypoints.copy()
        if seen.time >= 1.0:
            points[[7, 8, 11, 12, 15, 16]] += [0.0, -0.05, 0.0]
        return replace(seen, keypoints=points)

    handover = fixed_handover()
    run(handover, spoil=spread, longest=3.0)
    again = handover.transitions[1]
    assert (again.before, again.after) == (Stage.APPROACH_AND_REACT, Stage.WAIT_AND_OBSERVE)
    # six of 21 points off by 5 cm: at most 0.05 sqrt(6/21) = 26.7 mm, less what the fit takes up
    assert again.reason.startswith("the holding pose changed: keypoints 2")
    assert handover.transitions[2].after is Stage.APPROACH_AND_REACT  # from the new pose


@pytest.mark.parametrize(
    ("stage", "says"),
    [
        (Stage.WAIT_AND_OBSERVE, "the hand is 10 mm from the way to the grasp"),
        (
            Stage.APPROACH_AND_REACT,
            "hand 10 mm from the gripper's path, at least 15 mm are needed",
        ),
    ],
)
def test_a_way_to_the_pre_grasp_beside_the_hand_is_not_gone(
    stage: Stage, says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    handover, free = fixed_handover(), GuardedArm.free

    def narrow(arm: GuardedArm, *path: np.ndarray, **more: float) -> float:
        return 0.010 if handover.stage is stage else free(arm, *path, **more)

    monkeypatch.setattr(GuardedArm, "free", narrow)
    run(handover, longest=0.6)
    if stage is Stage.WAIT_AND_OBSERVE:
        assert (handover.transitions, handover.caution) == ([], says)
    else:
        assert first_stop(handover)[1] == says


def test_the_approach_is_as_fast_as_the_hand_leaves_it(monkeypatch: pytest.MonkeyPatch) -> None:
    handover = fixed_handover()
    told: list[float] = []

    def note(*_: object, speed: float = 0.0, **__: object) -> None:
        if handover.stage is Stage.APPROACH_AND_REACT:
            told.append(speed)

    monkeypatch.setattr(GuardedArm, "allowed", lambda *_, **__: 0.5)
    monkeypatch.setattr(handover.robot, "servo_to", note)
    run(handover, longest=0.4)
    assert set(told) == {0.5 * 0.25}


def test_a_singular_arm_is_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    handover = fixed_handover()
    monkeypatch.setattr(ur5, "singularity", lambda _: 0.004)
    run(handover, longest=0.4)
    words = "the arm is singular: smallest singular value 0.0040 and falling"
    assert first_stop(handover)[1] == words


def test_the_target_follows_about_the_point_that_is_set() -> None:
    """One of 21 keypoints is off by 21 mm, away from the others: their middle by 1 mm."""
    out = SCENE.keypoints[0] - SCENE.keypoints.mean(axis=0)
    out /= np.linalg.norm(out)

    def stretch(seen: Observation) -> Observation:
        assert seen.keypoints is not None
        points = seen.keypoints.copy()
        points[0] += (0.021 * out) @ CAMERA[:3, :3] * (seen.time >= 0.5)
        return replace(seen, keypoints=points)

    handover = fixed_handover(HandoverConfig(about="centroid"))
    run(handover, spoil=stretch, longest=0.7)
    expected = forward_of(rehearsed_grasp(), -0.1)
    expected[:3, 3] += 0.001 * out
    assert afters(handover) == STAGES[:1]
    np.testing.assert_allclose(handover.target, expected, atol=2e-4)


def final_move(change: Callable[[np.ndarray, float], np.ndarray]) -> Handover:
    """A handover in half a second of its final move, or at its stop.

    The keypoints (21, 3), base frame, are changed by the seconds since it began.
    """
    step, handover = 60, copy.deepcopy(after(60))
    began = np.inf
    while handover.time < began + 0.5 and handover.stage is not Stage.STOPPED:
        step += 1
        seen = STILL.observe(step * DT)
        if handover.part == "advance":
            began = min(began, handover.time)
            assert seen.keypoints is not None
            points = transform_points(CAMERA, seen.keypoints)
            points = change(points, seen.time - began)
            seen = replace(seen, keypoints=transform_points(np.linalg.inv(CAMERA), points))
        handover.step(seen, DT)
    return handover


def test_another_holding_pose_in_the_final_move_stops_it() -> None:
    def spread(points: np.ndarray, since: float) -> np.ndarray:
        points[[7, 8, 11, 12, 15, 16]] += CAMERA[:3, :3] @ [0.0, -0.2 * since, 0.0]
        return points

    handover = final_move(spread)
    assert first_stop(handover)[1].startswith("the holding pose changed: keypoints 2")
    assert afters(handover) == [*STAGES[:2], Stage.STOPPED]


def test_in_the_final_move_the_target_goes_two_centimetres_away_with_the_hand() -> None:
    """By then the hand has gone 5 cm along the approach axis."""
    handover = final_move(lambda points, since: points + np.array([0.1, 0, 0]) * since)
    assert afters(handover) == STAGES[:2]
    assert handover.target is not None
    gone = (handover.target - handover._began)[:3, 3] @ handover.target[:3, 2]
    assert gone == pytest.approx(0.02, abs=1e-6)


def test_hand_beside_the_path_stops_it_and_it_backs_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hadr.handover.stages.BACK_OFF", 0.05)
    monkeypatch.setattr("hadr.handover.safety.GRASP_DISTANCE", 0.06)
    handover = fixed_handover()
    moments = run(handover, longest=7.0)
    reason = first_stop(handover)[1]
    assert "mm from the gripper's path, at least 60 mm are needed" in reason
    assert min(m.hand_distance for m in moments) > 0.06 - 0.03
    stop = first_stop(handover)[0]
    at_stop = next(m for m in moments if m.time >= stop)
    later = next(m for m in moments if m.time >= stop + 0.5 + 0.05 / 0.1 + 0.4)
    moved = at_stop.tool[:3, :3].T @ (later.tool[:3, 3] - at_stop.tool[:3, 3])
    np.testing.assert_allclose(moved, [0, 0, -0.05], atol=0.003)


def test_it_slows_down_beside_the_hand_and_says_so() -> None:
    handover = fixed_handover(HandoverConfig(human_uncertainty=0.06))
    said = []
    run(handover, spoil=lambda seen: (said.append(handover.caution), seen)[1])
    slow = [words for words in said if words.endswith("% of the speed")]
    assert slow
    final = [t.time for t in handover.transitions]
    fast = fixed_handover()
    run(fast)
    assert handover.stage is fast.stage is Stage.FINISHED
    assert final[-1] > fast.transitions[-1].time + 0.3


def test_out_of_reach_stops_it() -> None:
    far = rehearsed_grasp()
    far[:3, 3] = [0.6, 0.8, 0.35]  # in the workspace's box, beside the hand, 1 m from the base
    handover = Handover(SimulatedUR5(), lambda *_: ChosenGrasp(far, 0.07, 1.0), CAMERA)
    run(handover, longest=2.0)
    assert "out of reach" in first_stop(handover)[1]


def test_low_confidence_waits_and_then_goes_home() -> None:
    handover = fixed_handover(HandoverConfig(patience=3.0))
    run(handover, spoil=during(0.0, 99, confidence=0.21))
    assert afters(handover) == [Stage.GOING_HOME, Stage.GAVE_UP]
    words = "no handover within 3 s; restored depth of confidence 0.21, needed 0.30"
    assert handover.transitions[0].reason == words
    handover = fixed_handover()
    run(handover, spoil=during(0.0, 1.5, confidence=0.21))
    assert afters(handover) == STAGES
    assert handover.transitions[0].time == pytest.approx(1.5)


@pytest.mark.parametrize(("speed", "words"), [(0.5, "moves away at"), (0.1, "cm farther away")])
def test_a_human_who_withdraws_is_not_followed(speed: float, words: str) -> None:
    def withdraw(seen: Observation) -> Observation:
        way = max(0.0, speed * (seen.taken - 1.0)) * np.linalg.inv(CAMERA)[:3, 0]
        assert seen.keypoints is not None
        assert seen.object_points is not None
        keypoints, points = seen.keypoints + way, seen.object_points + way
        return replace(seen, keypoints=keypoints, object_points=points)

    handover = fixed_handover(HandoverConfig(restless_after=99.0))
    moments = run(handover, spoil=withdraw, longest=4.0)
    time, reason = first_stop(handover)
    assert reason.startswith("the human withdraws")
    assert words in reason
    # 0.5 m/s: seen in the second picture; 0.1 m/s along x: 15 cm along the way from tool to hand
    assert 1.1 <= time <= (1.3 if speed == 0.5 else 1.0 + 0.15 / (0.1 * 0.75))
    stood = next(m for m in moments if m.time >= time)
    assert handover.robot.tool_pose()[0, 3] < stood.tool[0, 3]  # backed off


def test_an_object_that_slips_away_is_named_and_tried_again() -> None:
    handover = fixed_handover()
    arm = handover.robot
    assert isinstance(arm, SimulatedUR5)
    dropped: list[float] = []

    def drop(seen: Observation) -> Observation:
        if handover.part == "retreat" and not dropped:
            dropped.append(seen.time)
        if dropped and seen.time < dropped[0] + 0.5:
            arm.between_fingers = 0.0
        return seen

    run(handover, spoil=drop)
    assert "the object was dropped on the way back" in first_stop(handover)[1]
    assert afters(handover) == [*STAGES[:2], Stage.STOPPED, Stage.WAIT_AND_OBSERVE, *STAGES]


def test_an_object_that_is_not_in_the_hand_is_left_alone() -> None:
    def fallen(seen: Observation) -> Observation:
        assert seen.object_points is not None
        return replace(seen, object_points=seen.object_points + np.array([0, 0.4, 0]))

    handover = fixed_handover(HandoverConfig(patience=2.0))
    run(handover, spoil=fallen)
    reason = "no handover within 2 s; the object is not in the hand"
    assert handover.transitions[0].reason == reason


def test_in_the_final_move_the_pre_grasp_behind_it_need_not_be_within_reach(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    handover = fixed_handover()

    def reachable(pose: np.ndarray) -> bool:
        assert handover.target is not None
        behind = handover.stage is Stage.GRASP_AND_RETRIEVE and handover.advance.travelled > 0.02
        return not (behind and pose_distance(pose, handover.target)[0] < 0.005)

    monkeypatch.setattr(handover.robot, "reachable", reachable)
    run(handover)
    assert afters(handover) == STAGES


Disturb = Callable[[Handover, SimulatedUR5, float], None]


def disturbed(
    part: str,
    disturb: Disturb,
    hand_goes: float = 0.0,
    *,
    unseen: bool = False,
    config: HandoverConfig | None = None,
) -> tuple[Handover, list[Moment], float]:
    """A run that is disturbed from a part's begin on (seconds since then); and that begin.

    From then on the hand is seen to go away from the camera, m/s, by at most 40 cm, or not seen.
    """
    handover = fixed_handover(config)
    arm = handover.robot
    assert isinstance(arm, SimulatedUR5)
    begun: list[float] = []

    def look(seen: Observation) -> Observation:
        if handover.part == part and not begun:
            begun.append(seen.time)
        if not begun:
            return seen
        since = seen.time - begun[0]
        disturb(handover, arm, since)
        if unseen:
            return replace(seen, keypoints=None)
        if not hand_goes or seen.keypoints is None:
            return seen
        gone = np.array([0.0, 0.0, min(hand_goes * since, 0.4)])
        return replace(seen, keypoints=seen.keypoints + gone)

    moments = run(handover, spoil=look)
    return handover, moments, begun[0]


def halt(handover: Handover, arm: SimulatedUR5, since: float) -> None:
    arm.protective_stop = "contact force 11 N" if since == 0 else arm.protective_stop


def late(handover: Handover, arm: SimulatedUR5, since: float) -> None:
    handover._entered = -np.inf if since == 0 else handover._entered


def numb(handover: Handover, arm: SimulatedUR5, since: float) -> None:
    arm.wrench[:] = np.nan if since == 0 else 0.0


@pytest.mark.parametrize("part", ["let go", "retreat", "carry"])
@pytest.mark.parametrize("cause", [halt, late, numb])
def test_what_the_gripper_holds_no_stop_makes_it_drop(part: str, cause: Disturb) -> None:
    """It stands, after a protective stop until a person has released it, and goes on home."""
    handover, moments, _ = disturbed(part, cause)
    time, _ = first_stop(handover)
    held = [m for m in moments if m.time >= time]
    assert max(m.gripper_width for m in held) <= held[0].gripper_width + 1e-9 < 0.06
    again = next(t.time for t in handover.transitions if t.before is Stage.STOPPED)
    assert again - time == pytest.approx(5.5 if cause is halt else 1.0, abs=0.6)
    stood = [m.tool[:3, 3] for m in held if time + 0.3 < m.time < again]
    assert np.ptp(stood, axis=0).max() < 1e-6
    assert afters(handover) == [*STAGES[:2], Stage.STOPPED, Stage.GRASP_AND_RETRIEVE, STAGES[2]]


def test_too_many_stops_with_an_object_leave_it_standing_with_the_object() -> None:
    def stay_numb(handover: Handover, arm: SimulatedUR5, since: float) -> None:
        arm.wrench[:] = np.nan

    handover, moments, _ = disturbed("retreat", stay_numb)
    words = "stands where it is: stopped 3 times with an object in the gripper"
    assert handover.transitions[-1].reason == words
    assert moments[-1].gripper_width < 0.06


def pull(until: float) -> Disturb:
    def aside(handover: Handover, arm: SimulatedUR5, since: float) -> None:
        held = arm.gripper_width() < 0.06
        pulls = 4.0 * (since < until)
        arm.wrench[:3] = [0.0, pulls * held, -3.6 * held]  # and the weight of a glass

    return aside


@pytest.mark.parametrize("part", ["let go", "retreat"])
def test_it_waits_for_who_pulls_and_gives_back_what_is_pulled_at_for_long(part: str) -> None:
    assert afters(disturbed(part, pull(1.0))[0]) == STAGES
    handover, moments, begun = disturbed(part, pull(4.0))
    waits = [m for m in moments if begun + 0.3 < m.time < begun + 2.0]
    assert np.ptp([m.tool[:3, 3] for m in waits], axis=0).max() < 1e-6
    assert max(m.gripper_width for m in waits) < 0.06
    time, reason = first_stop(handover)
    assert reason == "somebody pulls at the object with 4.0 N"
    assert time == pytest.approx(begun + 2.0, abs=0.05)
    later = next(m for m in moments if m.time >= time + 1.5)
    assert later.gripper_width == pytest.approx(0.075)
    away = later.tool[:3, 3] - waits[-1].tool[:3, 3]
    assert away @ waits[-1].tool[:3, 2] < -0.02  # backs off


def test_what_pulls_where_no_hand_is_gets_nothing() -> None:
    handover, moments, begun = disturbed("carry", pull(4.0))
    assert first_stop(handover)[1] == "somebody pulls at the object with 4.0 N"
    held = [m for m in moments if m.time >= begun]
    assert max(m.gripper_width for m in held) < 0.06
    assert handover.stage is Stage.FINISHED


@pytest.mark.parametrize("part", ["let go", "retreat"])
@pytest.mark.parametrize("force", [(0.0, 4.0, -3.6), (0.0, 0.0, -8.0)])
def test_with_the_hand_gone_neither_a_pull_nor_a_heavy_glass_opens(
    part: str, force: tuple[float, float, float]
) -> None:
    """It is seen to go as soon as it has let go, before the gripper has drawn back at all."""

    def weigh(handover: Handover, arm: SimulatedUR5, since: float) -> None:
        arm.wrench[:3] = force

    _, moments, begun = disturbed(part, weigh, hand_goes=0.7)
    assert max(m.gripper_width for m in moments if m.time > begun) < 0.06


@pytest.mark.parametrize("part", ["let go", "retreat", "carry"])
@pytest.mark.parametrize("force", [np.nan, 0.0])
def test_fingers_that_feel_nothing_are_around_what_keeps_them_apart(
    force: float, part: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = GuardedArm.read

    def feels_nothing(arm: GuardedArm) -> None:
        read(arm)
        arm.reading = arm.reading._replace(press=force)

    def numb_fingers(handover: Handover, arm: SimulatedUR5, since: float) -> None:
        monkeypatch.setattr(GuardedArm, "read", feels_nothing)
        late(handover, arm, since)

    handover, moments, begun = disturbed(part, numb_fingers)
    assert first_stop(handover)[0] >= begun
    assert max(m.gripper_width for m in moments if m.time >= begun) < 0.06
    assert handover.stage is Stage.FINISHED


@pytest.mark.parametrize("lets_go", [1.5, np.inf])
def test_a_hand_that_comes_along_is_not_towed(lets_go: float) -> None:
    """It pulls less than the robot would notice, and lets go late or never."""
    handover = fixed_handover()
    arm = handover.robot
    closed: list[tuple[float, np.ndarray, np.ndarray]] = []
    seen_at: list[tuple[float, float]] = []

    def look(seen: Observation) -> Observation:
        if handover.part == "retreat" and not closed:
            closed.append((seen.time, arm.tool_pose(), seen.keypoints))
        if not closed:
            return seen
        since, tool, keypoints = seen.time - closed[0][0], closed[0][1], closed[0][2]
        way = arm.tool_pose()[:3, 3] - tool[:3, 3]
        seen_at.append((since, float(np.linalg.norm(way))))
        arm.wrench[:3] = [2.5, 0, -1.0] if since < lets_go else 0.0
        held = 1e-6 * since + keypoints + way @ CAMERA[:3, :3]
        return replace(
            seen, keypoints=held if since < lets_go else keypoints + np.array([0, 0, 0.3])
        )

    run(handover, spoil=look)
    towed = max(way for since, way in seen_at if since < lets_go)
    assert TOWED - 0.01 < towed < TOWED + 0.03
    assert handover.stage is (Stage.FINISHED if lets_go < 9 else Stage.GAVE_UP)
    assert 0.01 < arm.gripper_width() < 0.06  # it drops nothing


@pytest.mark.parametrize(("fingers", "opens"), [(0.03, True), (0.10, False)])
def test_a_camera_that_dies_as_the_fingers_close_stops_them(fingers: float, opens: bool) -> None:
    """Slow ones are on their way and open again; fast ones are around the glass and stay so."""
    handover = fixed_handover()
    arm = handover.robot
    assert isinstance(arm, SimulatedUR5)
    arm.config = replace(arm.config, finger_speed=fingers)
    begun: list[Observation] = []
    parts: list[str] = []

    def hang(seen: Observation) -> Observation:
        if handover.part == "close" or begun:
            begun.append(seen)
            parts.append(handover.part)
        dead = begun and seen.time < begun[0].time + 2.0
        return replace(seen, frame_time=begun[0].taken) if dead else seen

    moments = run(handover, spoil=hang)
    time, reason = first_stop(handover)
    assert reason.startswith("the camera stopped: no new picture for 0.3")
    assert time < begun[0].time + 0.4
    assert parts[: round((time - begun[0].time) / DT)].count("close") >= 10  # and no other part
    blind = [m for m in moments if time + 0.8 < m.time < begun[0].time + 2.0]
    assert "retreat" not in parts[:100]
    if opens:
        assert blind[-1].gripper_width == pytest.approx(0.075)
    else:
        assert max(m.gripper_width for m in blind) < 0.06
        assert np.ptp([m.tool[:3, 3] for m in blind], axis=0).max() < 1e-6
    assert handover.stage is Stage.FINISHED  # once the camera is back


@pytest.mark.parametrize("part", ["let go", "retreat"])
def test_a_glass_is_given_back_to_no_hand_that_is_not_seen(part: str) -> None:
    def tug(handover: Handover, arm: SimulatedUR5, since: float) -> None:
        arm.wrench[:3] = [0.0, 4.0, -3.6]

    impatient = HandoverConfig(patience=5.0)
    handover, moments, begun = disturbed(part, tug, unseen=True, config=impatient)
    assert first_stop(handover)[1] == "somebody pulls at the object with 4.0 N"
    assert max(m.gripper_width for m in moments if m.time > begun) < 0.06
    assert handover.transitions[-1].reason.endswith("with an object in the gripper")


def test_stuck_fingers_drag_nobody_and_are_not_taken_for_free_ones(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Whoever pulls at the glass has to be helped by a person: it stands and says so."""

    def stick(handover: Handover, arm: SimulatedUR5, since: float) -> None:
        monkeypatch.setattr(arm, "_move_fingers", lambda dt: None)
        arm.wrench[:3] = [6.0, 0.0, 0.0]

    handover, moments, begun = disturbed("let go", stick)
    places = [m.tool[:3, 3] for m in moments if m.time > begun]
    assert np.ptp(places, axis=0).max() < 0.003
    assert max(m.gripper_width for m in moments if m.time > begun) < 0.06
    reasons = [t.reason for t in handover.transitions]
    assert "the fingers do not open" in reasons
    assert reasons[-1].endswith("with an object in the gripper")
    before = [t.after for t in handover.transitions if t.time > begun]
    assert set(before) == {Stage.STOPPED, Stage.GRASP_AND_RETRIEVE, Stage.GAVE_UP}


def test_patience_does_not_end_what_the_gripper_holds() -> None:
    handover = fixed_handover(HandoverConfig(patience=7.0))
    arm = handover.robot
    carried: list[float] = []

    def look(seen: Observation) -> Observation:
        if handover.part == "carry" and not carried:
            carried.append(seen.time)
        arm.wrench[:] = np.nan if carried and 0.05 < seen.time - carried[0] < 0.15 else 0.0
        return seen

    run(handover, spoil=look)
    assert first_stop(handover)[0] < 7.0 + handover._first_seen < handover.transitions[-2].time
    assert handover.stage is Stage.FINISHED


def test_patience_that_ends_beside_the_object_backs_off_before_it_goes_home() -> None:
    handover = fixed_handover(HandoverConfig(patience=3.0))
    begun: list[float] = []

    def look(seen: Observation) -> Observation:
        late = handover.part == "advance" and handover.time > 3.0 + handover._first_seen
        if late and handover.advance.travelled > 0.12 and not begun:
            begun.append(seen.time)
        lost = bool(begun) and seen.time < begun[0] + 0.6
        # it is offered late, and so taken late
        points = None if seen.time < 1.0 else seen.object_points
        return replace(seen, object_points=points, keypoints=None if lost else seen.keypoints)

    moments = run(handover, spoil=look)
    assert begun
    assert [t.after for t in handover.transitions][2:] == [
        Stage.STOPPED, Stage.GOING_HOME, Stage.GAVE_UP
    ]  # fmt: skip
    stopped, left = (t.time for t in handover.transitions[2:4])
    before, after = (
        next(m.tool for m in moments if m.time >= time - 1e-9) for time in (stopped, left)
    )
    out = -before[:3, 2] @ (after - before)[:3, 3]
    assert out > 0.1  # straight back along the approach axis
    assert np.linalg.norm((after - before)[:3, 3]) == pytest.approx(out, abs=0.005)


def test_after_a_pause_the_hand_of_before_is_not_believed() -> None:
    """The newest picture that comes is still the one from before the pause."""
    handover = fixed_handover()
    number = 0
    while handover.stage is not Stage.APPROACH_AND_REACT or number < 30:
        seen = STILL.observe(round(0.1 * (number // 5), 6))
        handover.step(replace(seen, time=DT * number, frame_time=seen.time), DT)
        number += 1
    places = [handover.robot.tool_pose()[:3, 3]]
    for later in range(14):
        handover.step(replace(seen, time=DT * (number + later) + 5.0, frame_time=seen.time), DT)
        places.append(handover.robot.tool_pose()[:3, 3])
        assert handover.caution or handover.stage is Stage.STOPPED
    way = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert way.sum() < 0.012  # it brakes
    assert way[-4:].max() < 1e-4


def test_a_picture_of_a_camera_whose_clock_is_ahead_is_believed_when_its_time_has_come() -> None:
    handover = fixed_handover()
    seen = STILL.observe(0.0)
    known = []
    for number in range(4):
        handover.step(replace(seen, time=DT * number, frame_time=0.03), DT)
        known.append(handover.watch.keypoints is not None)
    assert known == [False, False, True, True]


def test_a_clock_that_stood_still_makes_no_picture_new() -> None:
    handover = fixed_handover()
    for number in range(30):
        seen = STILL.observe(round(0.1 * (number // 5), 6))
        handover.step(replace(seen, time=DT * number, frame_time=seen.time), DT)
    assert handover.watch.keypoints is not None
    for later in [0] * 8 + [1, 2, 3]:
        handover.step(replace(seen, time=DT * (29 + later), frame_time=seen.time), DT)
        assert handover.watch.keypoints is None
    new = STILL.observe(0.6)
    handover.step(replace(new, time=DT * 33, frame_time=new.time), DT)
    assert handover.watch.keypoints is not None


def test_with_the_object_it_waits_for_a_hand_in_its_way_to_go() -> None:
    handover = fixed_handover()
    begun: list[tuple[float, np.ndarray]] = []

    def block(seen: Observation) -> Observation:
        tool, home = handover.arm.reading.tool[:3, 3], handover.arm.home[:3, 3]
        if handover.part == "carry" and not begun:
            begun.append((seen.time, tool + 0.15 * (home - tool) / np.linalg.norm(home - tool)))
        if not begun or seen.time > begun[0][0] + 4.0:
            return seen
        if seen.time < begun[0][0] + 0.1:
            return replace(seen, keypoints=None)
        hand = SCENE.keypoints - SCENE.keypoints.mean(axis=0) + begun[0][1]
        hand += 1e-6 * np.random.default_rng(int(1e3 * seen.taken)).normal(size=hand.shape)
        return replace(seen, keypoints=(hand - CAMERA[:3, 3]) @ CAMERA[:3, :3])

    run(handover, spoil=block)
    stops = [t for t in handover.transitions if t.after is Stage.STOPPED]
    assert ["from the gripper's path" in t.reason for t in stops] == [True]
    again = next(t.time for t in handover.transitions if t.before is Stage.STOPPED)
    assert 4.0 < again - begun[0][0] < 5.5
    assert handover.stage is Stage.FINISHED


def test_the_fingers_press_firmly_only_after_a_way_without_a_pull() -> None:
    forces: dict[str, list[float]] = {}
    firm: list[np.ndarray] = []
    places: list[np.ndarray] = []

    def note(handover: Handover, arm: SimulatedUR5, since: float) -> None:
        force = arm.finger_force()
        forces.setdefault(handover.part, []).append(force)
        (firm if force == 22.0 else places).append(arm.tool_pose()[:3, 3])

    disturbed("close", note)
    assert set(forces["close"]) <= {0.0, 7.0}
    assert set(forces["let go"]) == {7.0}
    start = max(places, key=lambda place: float(place[0]))  # the grasp faces along x
    assert np.linalg.norm(firm[0] - start) == pytest.approx(0.02, abs=0.006)
    assert set(forces["carry"]) == {22.0}


@pytest.mark.parametrize("jump", [1.5, -1.8, 3600.0])
@pytest.mark.parametrize("once", [True, False])
def test_a_clock_that_jumps_is_said_and_forgiven(jump: float, once: bool) -> None:
    """Once wrong, or of another clock from then on: a slow picture, a garbled one, a reset."""
    said: list[tuple[float, str]] = []

    def late(seen: Observation) -> Observation:
        said.append((seen.time, handover.caution))
        wrong = abs(seen.time - 1.0) < 1e-6 if once else seen.time > 0.99
        return replace(seen, time=seen.time + jump, frame_time=seen.taken + jump) if wrong else seen

    handover = fixed_handover()
    run(handover, spoil=late)
    jumps = [time for time, words in said if "clock jumped by" in words]
    # heard in the step after, and until there is another picture
    assert jumps == pytest.approx([1.02, 1.04, 1.06, 1.08, 1.1])
    assert afters(handover) == STAGES


def delayed(spoil: Spoil) -> Spoil:
    """Ten pictures a second, each 0.1 s late, and then what breaks."""
    shown: list[Observation] = []

    def late(seen: Observation) -> Observation:
        if not shown or seen.taken > shown[-1].taken:
            shown.append(seen)
        picture = shown[max(0, len(shown) - 2)]
        return spoil(replace(picture, time=seen.time, frame_time=picture.taken))

    return late


@pytest.mark.parametrize("jump", [1.5, -1.5])
@pytest.mark.parametrize("clock", ["time", "frame_time"])
def test_one_clock_that_jumps_alone_stops_it_until_pictures_are_dated_anew(
    clock: str, jump: float
) -> None:
    handover = fixed_handover()
    ages: list[tuple[float, float, float]] = []
    true: list[tuple[float, float]] = []

    def spoil(seen: Observation) -> Observation:
        if true and handover.watch.keypoints is not None:
            ages.append((*true[-1], handover.watch.age))
        true.append((seen.time, seen.time - seen.taken))
        jumped = getattr(seen, clock) + jump
        return replace(seen, **{clock: jumped}) if seen.time > 0.99 else seen

    moments = run(handover, spoil=delayed(spoil))
    time, reason = first_stop(handover)
    words = "the camera stopped: no new picture for 0.30 s, its clock jumped by "
    assert reason == words + f"{jump if clock == 'frame_time' else -jump:+.2f} s"
    assert 1.2 - 1e-6 < time < 1.3 + 1e-6
    assert afters(handover) == [STAGES[0], Stage.STOPPED, Stage.WAIT_AND_OBSERVE, *STAGES]
    again = next(t.time for t in handover.transitions if t.before is Stage.STOPPED)
    assert 1.4 + 0.5 - 0.1 < again < 1.4 + 0.5 + 0.1  # five pictures, and half a second
    held = [m.joints for m in moments if time + 0.1 <= m.time < again]
    assert np.abs(np.diff(held, axis=0)).max() < 1e-9
    assert len([t for t, *_ in ages if t > 2.0]) > 100
    for at, age, counted in ages:
        assert age - 1e-6 <= counted
        assert counted <= age + 1e-6 or at < 2.0


@pytest.mark.parametrize("grows", ["at once", "slowly"])
def test_pictures_that_are_late_are_no_clock_that_jumped(grows: str) -> None:
    """They come ten times a second as before, but what they show is 1.5 s old."""
    pictures: list[Observation] = []

    def pipe(seen: Observation) -> Observation:
        if not pictures or seen.taken > pictures[-1].taken:
            pictures.append(seen)
        slower = 1.5 if grows == "at once" else min(1.5, 0.5 * (seen.time - 1.0))
        until = max(1.0, seen.time - slower) if seen.time > 1.0 else seen.time
        picture = [p for p in pictures if p.taken <= until + 1e-9][-1]
        return replace(picture, time=seen.time, frame_time=picture.taken)

    handover = fixed_handover()
    moments = run(handover, spoil=pipe, longest=12.0)
    late = ", what comes is 0.60 s old, or its clock is off" * (grows == "slowly")
    assert first_stop(handover)[1] == f"the camera stopped: no new picture for 0.30 s{late}"
    backed_off = first_stop(handover)[0] + 2.0
    stood = [m.joints for m in moments if m.time > backed_off]
    assert len(stood) > 300
    assert np.abs(np.diff(stood, axis=0)).max() < 1e-9
    assert handover.watch.keypoints is None or handover.watch.age > 5.0


@pytest.mark.parametrize("part", ["", "advance"])
@pytest.mark.parametrize(
    "jump", [(0.0, 0.12, 0.0), (0.0, -0.18, 0.0), (0.0, 0.0, 0.25)], ids=["12", "18", "25"]
)
def test_a_grasp_is_not_carried_along_with_a_hand_that_jumps(
    jump: tuple[float, float, float], part: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It stops once the hand is believed to be elsewhere, and chooses a grasp there."""
    handover = fixed_handover()
    begun: list[float] = []
    sent: list[tuple[float, Stage, np.ndarray, np.ndarray]] = []
    shift, servo_to = np.array(jump), handover.robot.servo_to

    def note(pose: np.ndarray, *args: float, **given: float) -> None:
        if begun and handover.target is not None:
            sent.append((handover.time, handover.stage, handover.target, pose))
        servo_to(pose, *args, **given)

    def look(seen: Observation) -> Observation:
        assert seen.keypoints is not None
        assert seen.object_points is not None
        there = handover.part == "advance" if part else seen.time >= 1.0
        if there and seen.time == seen.taken and not begun:
            begun.append(seen.time)
        if not begun or seen.taken < begun[0]:
            return seen
        moved = shift @ CAMERA[:3, :3]
        keypoints, points = seen.keypoints + moved, seen.object_points + moved
        return replace(seen, keypoints=keypoints, object_points=points)

    monkeypatch.setattr(handover.robot, "servo_to", note)
    run(handover, spoil=look, longest=6.0)
    time, reason = first_stop(handover)
    size = float(np.linalg.norm(shift))
    assert reason == f"the hand is elsewhere: it jumped {100 * size:.0f} cm"
    assert begun[0] + 0.1 - 1e-6 < time < begun[0] + 0.3 - 1e-6  # before it is missed
    _, _, target, pose = sent[0]
    before = [row for row in sent if row[0] <= time and row[1] is not Stage.STOPPED]
    assert len(before) >= 5
    assert max(np.linalg.norm((row[2] - target)[:3, 3]) for row in before) < 0.001
    assert max((row[3] - pose)[:3, 3] @ shift / size for row in before) < 0.01
    new = next(row[2] for row in sent if row[0] > time and row[1] is Stage.APPROACH_AND_REACT)
    there = forward_of(rehearsed_grasp(), -0.1)[:3, 3] + shift
    np.testing.assert_allclose(new[:3, 3], there, atol=0.002)


def test_a_hand_that_goes_aside_fast_is_followed() -> None:
    """Fifteen centimetres in 0.4 s, at most 0.7 m/s, as a hand that reaches does."""
    way: list[np.ndarray] = []

    def aside(seen: Observation) -> Observation:
        s = min(max((seen.taken - 1.0) / 0.4, 0.0), 1.0)
        if seen.time >= 1.0 and not way:  # not away from the robot
            x, y, _ = handover._away
            way.append(np.array([-y, x, 0.0]) / np.hypot(x, y))
        moved = 0.15 * s**3 * (10 - 15 * s + 6 * s**2) * (CAMERA[:3, :3].T @ way[0] if way else 0)
        assert seen.keypoints is not None
        assert seen.object_points is not None
        return replace(
            seen, keypoints=seen.keypoints + moved, object_points=seen.object_points + moved
        )

    handover = fixed_handover()
    run(handover, spoil=aside, longest=3.0)
    assert afters(handover) == STAGES[:2]
    assert handover.target is not None
    there = forward_of(rehearsed_grasp(), -0.1)[:3, 3] + 0.15 * way[0]
    np.testing.assert_allclose(handover.target[:3, 3], there, atol=0.002)


@pytest.mark.parametrize("method", ["servo_to", "tool_pose", "stop"])
def test_a_drivers_exception_leaves_the_robot_stopped(
    method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    handover = fixed_handover()
    stops: list[float] = []

    def stop() -> None:
        stops.append(handover.time)
        if method == "stop":
            raise ConnectionError("the cable")

    def torn(*_: object, **__: object) -> None:
        raise ConnectionError("the cable")

    def tear(seen: Observation) -> Observation:
        if seen.time > 1.0:
            monkeypatch.setattr(handover.robot, "stop", stop)
            if method != "stop":
                monkeypatch.setattr(handover.robot, method, torn)
            else:  # where it was to stop anyway
                return replace(seen, keypoints=None, frame_time=seen.time)
        return seen

    with pytest.raises(ConnectionError, match="the cable"):
        run(handover, spoil=tear)
    assert handover.stage is Stage.GAVE_UP
    assert stops[0] == handover.time
    assert handover.transitions[-1].reason == "stands where it is: ConnectionError: the cable"
    assert handover.step(STILL.observe(9.0), DT) is Stage.GAVE_UP


def test_a_defect_of_ours_is_no_stop_of_the_method(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> str:
        raise ValueError("a defect")

    handover = fixed_handover()
    monkeypatch.setattr(safety, "withdrawal", broken)
    with pytest.raises(ValueError, match="a defect"):
        run(handover)
    assert handover.stage is Stage.GAVE_UP
    assert handover.transitions[-1].reason == "stands where it is: ValueError: a defect"


def test_an_approach_that_is_too_slow_three_times_sends_it_home() -> None:
    handover = fixed_handover(HandoverConfig(approach_timeout=0.2))
    run(handover)
    assert first_stop(handover)[1] == "pre-grasp not reached within 0.2 s"
    assert afters(handover).count(Stage.STOPPED) == 3
    assert handover.transitions[-2].reason.startswith("stopped 3 times")
    assert handover.transitions[-1].reason == "at home without the object"


def test_a_grasp_is_chosen_in_a_calm_hand_or_after_two_seconds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    handover = fixed_handover()
    run(handover, longest=1.0)
    assert handover.transitions[0].time == pytest.approx(0.2)  # half of the window is enough
    restless = MovingHand(SCENE, CAMERA, drift=0.04, calm_after=np.inf)
    monkeypatch.setattr("hadr.handover.stages.CALM_SPEED", 1e-9)
    handover = fixed_handover()
    run(handover, restless, longest=3.0)
    assert handover.transitions[0].time == pytest.approx(2.0)


def test_searches_are_limited_and_from_new_pictures() -> None:
    times: list[float] = []
    handover = fixed_handover()

    def never(*_: object) -> None:
        times.append(handover.time)

    handover.choosing.choose_grasp = never
    run(handover, longest=2.0)
    assert len(times) >= 5
    assert np.diff(times).min() >= 0.3 - 1e-9
    np.testing.assert_allclose(np.array(times) * 10, np.round(np.array(times) * 10), atol=1e-9)


def test_a_restless_hand_is_not_grasped_at_once() -> None:
    restless = MovingHand(SCENE, CAMERA, drift=0.03, calm_after=np.inf)
    times = []
    for drift in (np.inf, 0.005):
        handover = fixed_handover(HandoverConfig(largest_drift=drift))
        run(handover, restless, longest=8.0)
        times.append(next(t.time for t in handover.transitions if t.after is STAGES[1]))
    assert times[0] < times[1]


def test_waits_without_a_hand_or_points() -> None:
    handover = fixed_handover()
    joints = handover.robot.joint_positions()
    for step in range(300):
        assert handover.step(Observation(step * DT), DT) is Stage.WAIT_AND_OBSERVE
    assert handover.caution.startswith("no hand seen")
    np.testing.assert_allclose(handover.robot.joint_positions(), joints, atol=1e-9)


ANY = st.floats(allow_nan=True, allow_infinity=True)
SHAPES = st.sampled_from([(21, 3), (20, 3), (0, 3), (3,), (), (40, 3), (21, 4), (40, 3, 1)])
CLOUDS = st.none() | SHAPES.flatmap(lambda shape: arrays(np.float64, shape, elements=ANY))


@functools.cache
def after(steps: int) -> Handover:
    """A handover after so many good steps, the fingers around something 6 cm wide."""
    handover = fixed_handover()
    assert isinstance(handover.robot, SimulatedUR5)
    handover.robot.between_fingers = 0.06
    for step in range(steps):
        handover.step(STILL.observe(step * DT), DT)
    return handover


@settings(max_examples=25)
@given(data=st.data(), start=st.sampled_from([0, 30, 60, 110, 160, 210]))
def test_garbage_neither_raises_nor_leaves_the_workspace(data: st.DataObject, start: int) -> None:
    handover = copy.deepcopy(after(start))
    arm = handover.robot
    assert isinstance(arm, SimulatedUR5)
    for step in range(4):
        good = STILL.observe((start + step) * DT)
        garbage = Observation(
            data.draw(ANY | st.just(good.time)),
            data.draw(CLOUDS | st.just(good.keypoints)),
            data.draw(CLOUDS | st.just(good.object_points)),
            data.draw(CLOUDS),
            data.draw(st.none() | ANY),
            data.draw(st.none() | ANY),
        )
        before = arm.joint_positions()
        handover.step(garbage, DT)
        assert in_workspace(arm.tool_pose()[:3, 3])
        assert arm.outline()[2:, 2].min() >= TABLE
        turned = np.abs(arm.joint_positions() - before).max()
        assert turned <= 0.25 * ur5.JOINT_SPEED * DT + 1e-9


def test_camera_pose_and_dt_are_checked() -> None:
    with pytest.raises(ValueError, match="base_from_camera must hold a proper rotation"):
        Handover(SimulatedUR5(), lambda p, k, r, s: None, np.diag([1.0, 1, -1, 1]))
    with pytest.raises(ValueError, match=r"dt must be .* got 0.2"):
        fixed_handover().step(Observation(0.0), 0.2)


def test_only_the_tables_changes_of_stage_happen() -> None:
    handover = fixed_handover()
    with pytest.raises(RuntimeError, match="Finished may not follow Wait & Observe: by mistake"):
        handover._enter(Stage.FINISHED, "by mistake")
    assert handover.stage is Stage.WAIT_AND_OBSERVE
