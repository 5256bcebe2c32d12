"""Attempts: the same twice, replayed from their log, and what the robot does when sight breaks."""

import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hadr.camera import transform_points
from hadr.handover.logs.replay import replay
from hadr.handover.observation import Observation
from hadr.handover.poses import camera_at
from hadr.handover.simulated_ur5 import TOOL_SPEED
from hadr.handover.stages import ChosenGrasp, Stage, Transition
from hadr.records.result_file import digest
from hadr.simulation.camera.robot_camera import RobotCamera
from hadr.simulation.camera.sight import Fault, broken_sight, keypoint_uncertainty
from hadr.simulation.trials import trial as trial_module
from hadr.simulation.trials.outcome import AFTER_TOUCH, Shown, believed_of
from hadr.simulation.trials.trial import (
    ATTEMPT_CONFIG,
    PLANNING_TIME,
    Run,
    Trial,
    run_trial,
)
from hadr.simulation.world.judge import Judge
from hadr.simulation.world.scenes import held_scene
from hadr.simulation.world.state import WorldState

BROKEN = Trial("0004", 922, "perfect")
PICTURE, LATENCY, STEP = 0.1, 0.1, 0.02


def equal(one: WorldState, other: WorldState) -> bool:
    return all(
        np.array_equal(a, b) for a, b in zip(vars(one).values(), vars(other).values(), strict=True)
    )


def timeless(run: Run) -> str:
    """The outcome but for wall-clock times; as text, because NaN differs from NaN."""
    return repr(replace(run.outcome, planning_wall_seconds=0.0, wall_seconds=0.0))


def test_no_speed_is_asked_for_that_the_arm_does_not_have() -> None:
    assert max(ATTEMPT_CONFIG.approach_speed, ATTEMPT_CONFIG.advance_speed) <= TOOL_SPEED


def test_a_whole_attempt(whole: Run) -> None:
    assert whole.outcome.verdict == "success"
    # the judge is content before the arm is home
    assert [t.after for t in whole.transitions][-2:] == [
        Stage.APPROACH_AND_REACT,
        Stage.GRASP_AND_RETRIEVE,
    ]
    assert whole.outcome.largest_force == 0
    assert whole.outcome.first_grasp_at == whole.transitions[0].time
    (way,) = whole.outcome.forces  # the fingers close on the glass, and the hand feels it
    assert way == "through the glass, Grasp & Retrieve"
    assert 0.5 < whole.outcome.forces[way] < 20
    times = np.array([state.time for state in whole.states])
    assert np.diff(times) == pytest.approx(0.04)
    assert whole.states[0].holder == "hand"
    assert whole.states[-1].holder == "gripper"
    assert times[-1] == pytest.approx(whole.outcome.decided_at, abs=0.03)
    # every second state is kept, the judge saw all
    kept = min(state.hand_distance for state in whole.states)
    assert kept - 0.005 < whole.outcome.smallest_distance <= kept
    assert 0.8 < whole.outcome.points_right <= 1  # all but those at the outline


def test_the_same_attempt_again_is_the_same_to_the_last_bit(whole: Run) -> None:
    again = run_trial(whole.trial)
    assert timeless(again) == timeless(whole)
    assert again.transitions == whole.transitions
    assert len(again.states) == len(whole.states)
    assert all(map(equal, again.states, whole.states))
    for name, values in whole.log.arrays.items():
        np.testing.assert_array_equal(again.log.arrays[name], values, err_msg=name)


def test_another_seed_is_another_attempt(whole: Run) -> None:
    other = run_trial(replace(whole.trial, seed=1, time_limit=0.1))
    assert not np.array_equal(other.states[0].base_from_object, whole.states[0].base_from_object)
    assert not np.array_equal(other.log.arrays["keypoints"][0], whole.log.arrays["keypoints"][0])
    # the holding pose is the hold's, whatever the seed
    held = [np.linalg.inv(s.base_from_wrist) @ s.base_from_object
            for s in (other.states[0], whole.states[0])]  # fmt: skip
    np.testing.assert_allclose(*held, atol=1e-6)


def test_whole_numbers_and_their_floats_are_one_attempt() -> None:
    whole_number, number = (Trial("0000", 920, turn_degrees=angle) for angle in (60, 60.0))
    assert digest(whole_number.record) == digest(number.record)


def test_what_a_grasp_went_by(whole: Run) -> None:
    outcome = whole.outcome
    assert not outcome.torn
    assert 0.8 < outcome.points_right_at_grasp <= 1
    assert outcome.grasp_off < 0.02  # the glass was between the fingers in the end


def test_what_a_chosen_grasp_went_by_is_counted_where_the_fingers_close() -> None:
    scene, believed = held_scene("0000", 920), camera_at(np.array([0, -0.5, 0.6]), np.zeros(3))
    pose = np.eye(4)
    pose[:3, 3] = [0.3, 0.1, 0.2]
    handover: Any = SimpleNamespace(
        grasp=ChosenGrasp(pose, 0.08, 1.0), config=ATTEMPT_CONFIG, base_from_camera=believed
    )
    # the tool goes 5 cm past the predicted grasp, the pads' middle is 3 cm behind its point
    place = pose[:3, 3] + [0, 0, 0.05 - 0.03]
    points = place + np.array([[0.01, 0, 0], [0, 0.02, 0], [0, 0, -0.029], [0.2, 0, 0]])
    seen = Observation(0.0, None, transform_points(np.linalg.inv(believed), points))
    glass, height = np.eye(4), 0.05
    radius = scene.item.outer_radius(height)
    glass[:3, 3] = place - [radius + 0.03, 0, height]  # three centimetres beside its wall
    shown = Shown(seen, np.array([True, False, False, True]), glass)
    whole, near, off = believed_of(handover, shown, scene)
    assert (whole, near) == pytest.approx((2 / 4, 1 / 3))
    assert off == pytest.approx(0.03, abs=2e-3)


def test_a_search_for_a_grasp_takes_its_time_and_the_arm_stands(whole: Run) -> None:
    times, servo = whole.log.arrays["time"], whole.log.arrays["servo"]
    chosen = int(np.searchsorted(times, whole.transitions[0].time - 1e-9))
    assert times[chosen + 1] - times[chosen] == pytest.approx(PLANNING_TIME + STEP, abs=0.011)
    during = [s.joints for s in whole.states if times[chosen] <= s.time <= times[chosen + 1] + 1e-6]
    assert len(during) >= 3
    assert np.abs(np.diff(during, axis=0)).max() < 1e-4
    assert np.isfinite(servo[chosen + 1]).all()


def test_an_attempt_goes_on_for_a_while_after_a_touch(monkeypatch: pytest.MonkeyPatch) -> None:
    """The hand is put in the robot's way: what follows the first touch is seen and told."""
    looked = Judge.look

    def touched(judge: Judge, state: WorldState) -> str:
        force = 3.0 if state.time > 1.0 else 0.0
        return looked(judge, replace(state, hand_force=force + (state.time > 1.5)))

    monkeypatch.setattr(Judge, "look", touched)
    run = run_trial(BROKEN)
    assert run.outcome.verdict == "human contact"
    assert run.states[-1].time == pytest.approx(run.outcome.decided_at + AFTER_TOUCH, abs=0.05)
    assert run.outcome.largest_force == 4.0


def test_a_watcher_sees_each_step_and_changes_nothing(whole: Run) -> None:
    seen: list[tuple[float, Stage]] = []
    short = replace(whole.trial, time_limit=1.0)
    run = run_trial(short, on_step=lambda world, state, stage: seen.append((state.time, stage)))
    assert [t for t, _ in seen] == pytest.approx(np.arange(1, len(seen) + 1) * STEP)
    assert run.outcome.verdict == "time-out"
    assert run.outcome.reason == "time-out in Approach & React"
    assert run.outcome.decided_at == pytest.approx(1.0, abs=STEP)
    assert all(map(equal, run.states, whole.states))
    chosen = whole.transitions[0].time
    assert {stage for t, stage in seen if t <= chosen - STEP} == {Stage.WAIT_AND_OBSERVE}
    assert {stage for t, stage in seen if t > chosen + STEP} == {Stage.APPROACH_AND_REACT}


@pytest.mark.parametrize(("rate", "latency"), [(10.0, 0.1), (5.0, 0.1), (25.0, 0.3), (30.0, 0.1)])
def test_pictures_come_at_their_rate_and_late(rate: float, latency: float) -> None:
    run = run_trial(replace(BROKEN, picture_rate=rate, latency=latency, time_limit=0.8))
    times, taken = (np.rint(run.log.arrays[n] * 50) for n in ("time", "taken"))  # whole steps
    # each picture at the first step at or after its due time: 0, 1.67, 3.33, 5, ... at 30 a second
    due = np.array([-(-step * 50 // int(rate)) for step in range(50)])
    latest = np.searchsorted(due, np.maximum(times - 50 * latency, 0), side="right") - 1
    np.testing.assert_array_equal(taken, due[latest])


@pytest.mark.parametrize("condition", ["perfect", "hadr-plus-networks"])
def test_the_guard_knows_how_far_off_keypoints_are(condition: str) -> None:
    run = run_trial(replace(BROKEN, condition=condition, time_limit=0.1))
    expected = keypoint_uncertainty(by_networks=condition != "perfect")
    assert run.log.header["config"]["human_uncertainty"] == pytest.approx(expected)


def test_an_attempt_is_made_as_it_is_described(monkeypatch: pytest.MonkeyPatch) -> None:
    kept: dict[str, object] = {}
    for name in ("motion_for", "GraspSelection"):
        made = getattr(trial_module, name)
        monkeypatch.setattr(
            trial_module, name, lambda *a, made=made, **k: kept.update(k) or made(*a, **k)
        )
    impatient = replace(ATTEMPT_CONFIG, patience=0.05)
    monkeypatch.setattr(trial_module, "ATTEMPT_CONFIG", impatient)
    run = run_trial(
        Trial(
            "0004",
            922,
            "perfect-no-rescoring-no-tracking",
            hand_speed=2.0,
            restless=True,
            turn_degrees=60.0,
            extrinsics_error_deg=3.0,
            time_limit=0.4,
        )
    )
    turn = pytest.approx(np.pi / 3)
    assert kept == {"speed": 2.0, "restless": True, "turn": turn, "rescoring": False}
    assert run.log.header["config"]["tracking"] is False
    believed = np.array(run.log.header["base_from_camera"])[:3, :3]
    off = Rotation.from_matrix(RobotCamera().base_from_camera[:3, :3].T @ believed).magnitude()
    assert np.rad2deg(off) == pytest.approx(3.0)
    assert run.outcome.verdict == "gave up"


STOPS: list[tuple[Fault, float | None, float, str]] = [
    # what breaks, when (None: in the final move), how long the robot may still move, what it says
    ("no hand", 1.7, 0.3, r"^no hand seen for 0\.3. s: no hand in the picture$"),
    ("nan keypoints", 1.7, 0.3, r"^no hand seen for 0\.3. s: keypoints .*finite.*index_tip"),
    ("frozen keypoints", 1.7, 0.4, r"^keypoints frozen: the same in 5 pictures in a row$"),
    ("no frames", 1.7, 0.3, r"^the camera stopped: no new picture for 0\.3. s$"),
    ("no hand", None, 0.3, r"^no hand seen for 0\.3. s: no hand in the picture$"),
]


@pytest.mark.parametrize(("fault", "since", "limit", "reason"), STOPS)
def test_broken_sight_stops_the_robot_in_time(
    fault: Fault, since: float | None, limit: float, reason: str, whole: Run
) -> None:
    trial, stage = BROKEN, Stage.APPROACH_AND_REACT
    if since is None:
        trial, stage = whole.trial, Stage.GRASP_AND_RETRIEVE
        since = 0.3 + next(t.time for t in whole.transitions if t.after is stage)
    latest = since + PICTURE + LATENCY + limit + STEP
    run = run_trial(replace(trial, time_limit=latest + 0.5), spoil=broken_sight(fault, since))
    stop = only_stop(run)
    assert stop.before is stage
    assert since < stop.time <= latest + 1e-9
    assert re.search(reason, stop.reason)
    assert run.outcome.verdict == "time-out"
    assert re.fullmatch(
        rf"time-out in Stopped, (still|open|back|clear): {re.escape(stop.reason)}",
        run.outcome.reason,
    )
    # it brakes within 0.3 s and stands for the rest of the stand time
    standing = fastest_joint(run, stop.time + 0.3, stop.time + 0.5)
    assert standing < 0.01
    assert fastest_joint(run, since - 0.2, since) > 10 * standing
    assert run.outcome.largest_force == 0
    assert all(s.hand_force == 0 for s in run.states)
    assert tuple(replay(run.log).transitions) == run.transitions


def fastest_joint(run: Run, since: float, until: float) -> float:
    """Radians per second."""
    joints = np.array([s.joints for s in run.states if since <= s.time <= until])
    assert len(joints) >= 4
    return float(np.abs(np.diff(joints, axis=0)).max() / 0.04)


def only_stop(run: Run) -> Transition:
    (stop,) = [t for t in run.transitions if t.after is Stage.STOPPED]
    return stop


def test_depth_of_low_confidence_is_not_grasped_at() -> None:
    trial = replace(BROKEN, time_limit=1.5)  # with whole sight it chooses after 0.9 s
    run = run_trial(trial, spoil=broken_sight("low confidence"))
    assert run.transitions == ()
    assert run.outcome.grasps_chosen == 0
    assert np.isnan(run.outcome.first_grasp_at)
    assert run.outcome.reason == (
        "no grasp was chosen: restored depth of confidence 0.02, needed 0.30"
    )
    assert run.outcome.largest_force == 0
    joints = np.array([s.joints for s in run.states])
    assert np.abs(joints - joints[0]).max() < 0.01  # it waits where it was


def test_a_short_fault_is_lived_through() -> None:
    """Two pictures without a hand: it holds, follows again, and stops nowhere."""
    run = run_trial(replace(BROKEN, time_limit=3.0), spoil=broken_sight("no hand", 2.0, 2.15))
    assert Stage.STOPPED not in {t.after for t in run.transitions}
    assert any("no hand" in why for _, why in run.log.header["cautions"])


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"object_id": "0099"}, r"no object '0099'; there are 0000"),
        ({"object_id": "../a"}, r"no object '\.\./a'"),
        ({"hold_number": -1}, r"hold_number must be 0 or more, got -1"),
        ({"seed": -2}, r"seed must be 0 or more, got -2"),
        ({"condition": "rau"}, r"condition must be one of raw, .*got 'rau'"),
        ({"hand_speed": 0.0}, r"hand_speed must be a factor above 0, got 0\.0"),
        ({"hand_speed": float("nan")}, r"hand_speed .* got nan"),
        ({"hand_speed": float("inf")}, r"hand_speed .* got inf"),
        ({"extrinsics_error_deg": -1.0}, r"extrinsics_error_deg must lie in 0\.\.90, got -1\.0"),
        ({"extrinsics_error_deg": 200.0}, r"got 200\.0"),
        ({"time_limit": 0.0}, r"time_limit must be seconds above 0, got 0\.0"),
        ({"picture_rate": 1e-9}, r"picture_rate must be .* 0\.1 to 50, got 1e-09"),
        ({"picture_rate": 50.1}, r"got 50\.1"),
        ({"picture_rate": float("nan")}, r"got nan"),
        ({"turn_degrees": 0.0}, r"turn_degrees must be above 0 and at most 90, got 0\.0"),
        ({"turn_degrees": 91.0}, r"got 91\.0"),
        ({"latency": -0.1}, r"latency must lie in 0\.\.2, a multiple of 0\.02, got -0\.1"),
        ({"latency": 0.13}, r"got 0\.13"),
        ({"latency": float("nan")}, r"got nan"),
    ],
)
def test_what_is_wrong_with_a_description_is_named(wrong: dict[str, object], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        replace(BROKEN, **wrong)
