"""Logs: what is in them, that a replay gives the same transitions, that damage is refused."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hadr.handover.grasping.candidates import NoCandidateError
from hadr.handover.grasping.grasps import forward_of
from hadr.handover.logs.replay import logged_observation, replay
from hadr.handover.logs.run_log import RecordedHandover, RunLog, read_run_log
from hadr.handover.observation import Observation
from hadr.handover.simulated_ur5 import SimulatedUR5
from hadr.handover.stages import ChosenGrasp, HandoverConfig, Stage
from hadr.simulation.trials.rehearsal import (
    REHEARSAL_CAMERA,
    MovingHand,
    rehearse,
    rehearsed_grasp,
    rehearsed_scene,
)

CAMERA = REHEARSAL_CAMERA
HAND = MovingHand(rehearsed_scene(), CAMERA, drift=0.005, turn=0.01, noise=0.001)


def troubled(seen: Observation) -> Observation:
    """One thing after the other goes wrong."""
    bad = None if seen.keypoints is None else seen.keypoints.copy()
    if 0.9 <= seen.time < 1.4:
        return replace(seen, keypoints=None)
    if 3.0 <= seen.time < 3.4 and bad is not None:
        bad[8] = np.nan
        return replace(seen, keypoints=bad, confidence=np.nan)
    if 3.4 <= seen.time < 3.5 and bad is not None:
        return replace(seen, keypoints=bad[:20], object_points=np.zeros((3, 3)))
    if 3.5 <= seen.time < 3.6:
        return replace(seen, frame_time=np.inf, confidence=0.1)
    return seen


@pytest.fixture(scope="module")
def run() -> RecordedHandover:
    failures = iter([NoCandidateError("too few points"), None])

    def choose(*_: object) -> ChosenGrasp | None:
        failure = next(failures, rehearsed_grasp())
        if isinstance(failure, NoCandidateError):
            raise failure
        return None if failure is None else ChosenGrasp(rehearsed_grasp(), 0.075, 1.25)

    handover = RecordedHandover(SimulatedUR5(), choose, CAMERA, HandoverConfig(restless_after=1.0))
    rehearse(handover, HAND, dt=0.02, past_stops=True, picture_every=0.1, spoil=troubled)
    return handover


@pytest.fixture(scope="module")
def path(run: RecordedHandover, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run.log().save(tmp_path_factory.mktemp("logs") / "run.npz")


def test_the_run_is_eventful(run: RecordedHandover) -> None:
    stages = [t.after for t in run.transitions]
    assert stages.count(Stage.STOPPED) == 2
    assert stages[-1] is Stage.FINISHED


def test_a_log_comes_back_as_it_was_and_is_small(run: RecordedHandover, path: Path) -> None:
    log = read_run_log(path)
    assert log.transitions == run.transitions
    assert len(log.arrays["time"]) > 400
    assert path.stat().st_size < 300_000
    words = [said for _, said in log.cautions]
    assert "no grasp: too few points" in words
    assert any("index_tip" in said for said in words)
    seen = logged_observation(log, 10)
    expected = HAND.observe(0.2).keypoints
    assert expected is not None
    np.testing.assert_allclose(seen.keypoints, expected, atol=1e-7)
    assert (seen.time, seen.frame_time) == (0.2, 0.2)
    assert logged_observation(log, 50).keypoints is None
    servo = log.arrays["servo"]
    tools = log.arrays["tool"][1:]
    # the command runs at most 5 cm ahead of the tool
    assert np.nanmax(np.linalg.norm((servo - tools)[:, :, 3], axis=1)) < 0.051


def test_replay_gives_the_same_transitions(run: RecordedHandover, path: Path) -> None:
    again = replay(read_run_log(path))
    assert again.transitions == run.transitions
    assert again.stage is Stage.FINISHED
    assert again.tries == run.tries
    assert again.target is not None
    assert run.target is not None
    np.testing.assert_array_equal(again.target, run.target)


def test_replay_names_what_differs(path: Path) -> None:
    log = read_run_log(path)
    header = dict(log.header)
    header["config"] = {**header["config"], "patience": 0.1}
    with pytest.raises(ValueError, match=r"transition \d differs: the log has "):
        replay(RunLog(log.arrays, header))
    hands = log.arrays["keypoints"].copy()
    hands[60:] = np.nan  # no longer seen
    with pytest.raises(ValueError, match=r"differs: the log has|the log has \d+ transitions"):
        replay(RunLog({**log.arrays, "keypoints": hands}, log.header))


def test_a_log_that_was_changed_is_refused(path: Path, tmp_path: Path) -> None:
    log = read_run_log(path)
    with np.load(path) as file:
        content = {name: file[name] for name in file.files}
    changed = tmp_path / "changed.npz"
    content["width"] = log.arrays["width"] + np.float32(0.001)
    np.savez_compressed(changed, **content)
    with pytest.raises(ValueError, match=r"changed.npz was changed: .* checksum"):
        read_run_log(changed)
    content["width"] = log.arrays["width"]
    content["header"] = np.array(str(content["header"]).replace("no hand seen", "a hand seen"))
    np.savez_compressed(changed, **content)
    with pytest.raises(ValueError, match=r"changed.npz was changed"):
        read_run_log(changed)


def test_settings_of_another_version_are_named(path: Path) -> None:
    log = read_run_log(path)
    config = {**log.header["config"], "boldness": 2.0}
    with pytest.raises(ValueError, match=r"field boldness: replay .* the version that made it"):
        replay(RunLog(log.arrays, {**log.header, "config": config}))


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("format", 99, "format is 99, this version reads 2"),
        ("transitions", [[0, "Nowhere", "Finished", ""]], "transitions.*'Nowhere' is not a valid"),
        ("cautions", None, "cautions: must be a list, got None"),
        ("events", [[0, "chose", 7]], r"events has \[0, 'chose', 7\], which is none"),
        ("odd_keypoints", {"0": 7}, "odd_keypoints"),
        ("odd_keypoints", {"x": []}, "odd_keypoints must be named by steps, got 'x'"),
        ("config", 7, "config: must be named values, got 7"),
        ("base_from_camera", [["x"]], "base_from_camera.*must be a number, got 'x'"),
    ],
)
def test_a_forged_header_is_refused(
    path: Path, tmp_path: Path, name: str, value: object, says: str
) -> None:
    log = read_run_log(path)
    forged = RunLog(log.arrays, {**log.header, name: value}).save(tmp_path / "forged.npz")
    with pytest.raises(ValueError, match=rf"forged\.npz.*{says}"):
        read_run_log(forged)


@pytest.mark.parametrize(
    ("name", "change", "says"),
    [
        ("taken", lambda a: a[:3], "taken must be f8 steps"),
        ("tool", lambda a: a[:-1], "joints must be f4 answers 6"),
        ("hand", lambda a: a.astype(str), "hand must be i4 steps"),
        ("cloud", lambda a: a + 1000, "cloud must be rows of the"),
        ("keypoints", lambda a: np.float32(1), "keypoints must be f4 hands 21 3"),
    ],
)
def test_forged_arrays_are_refused(
    path: Path, tmp_path: Path, name: str, change: Callable[[np.ndarray], np.ndarray], says: str
) -> None:
    log = read_run_log(path)
    arrays = {**log.arrays, name: np.asarray(change(log.arrays[name]))}
    with pytest.raises(ValueError, match=rf"forged\.npz: {says}"):
        read_run_log(RunLog(arrays, log.header).save(tmp_path / "forged.npz"))


def test_a_replay_compares_the_commands_to_the_arm(path: Path) -> None:
    log = read_run_log(path)
    servo = log.arrays["servo"].copy()
    servo[np.flatnonzero(np.isfinite(servo[:, 0, 3]))[5], 0, 3] += 0.002
    with pytest.raises(ValueError, match=r"the command to the arm in step \d+ differs"):
        replay(RunLog({**log.arrays, "servo": servo}, log.header))


def test_forces_and_refusals_of_the_robot_are_replayed() -> None:
    arm = SimulatedUR5()
    far = rehearsed_grasp()
    far[:3, 3] = [0.6, 0.8, 0.35]
    chosen = iter([far, forward_of(rehearsed_grasp(), 0.0)])
    last = ChosenGrasp(rehearsed_grasp(), 0.075, 1.0)
    handover = RecordedHandover(
        arm, lambda *_: ChosenGrasp(next(chosen, last.pose), 0.075, 1.0), CAMERA
    )
    pushed: list[float] = []

    def push(seen: Observation) -> Observation:
        if handover.part == "close" and not pushed:
            pushed.append(seen.time)
            arm.protective_stop = "contact force 11 N"
        return seen

    rehearse(handover, HAND, dt=0.02, past_stops=True, picture_every=0.1, spoil=push)
    reasons = " ".join(t.reason for t in handover.transitions)
    assert "out of reach" in reasons
    assert "contact force 11 N" in reasons
    assert replay(handover.log()).transitions == handover.transitions


def test_a_run_that_an_error_ended_is_replayed(monkeypatch: pytest.MonkeyPatch) -> None:
    arm = SimulatedUR5()
    last = ChosenGrasp(rehearsed_grasp(), 0.075, 1.0)
    handover = RecordedHandover(arm, lambda *_: last, CAMERA)
    servo_to = arm.servo_to

    def broken(pose: np.ndarray, dt: float, **how: object) -> None:
        if handover.time > 1.0:
            raise ValueError("a defect of the driver")
        servo_to(pose, dt, **how)

    monkeypatch.setattr(arm, "servo_to", broken)
    with pytest.raises(ValueError, match="a defect of the driver"):
        rehearse(handover, HAND, dt=0.02, picture_every=0.1)
    assert handover.stage is Stage.GAVE_UP
    assert replay(handover.log()).transitions == handover.transitions


@pytest.mark.parametrize("seed", [0, 1])
def test_a_run_on_garbage_is_replayed(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    last = ChosenGrasp(rehearsed_grasp(), 0.075, 1.0)
    handover = RecordedHandover(SimulatedUR5(), lambda *_: last, CAMERA)
    odd = (np.nan, np.inf, -np.inf, 1e300, 1e-300, -1.0)

    def garble(seen: Observation) -> Observation:
        if seen.time < 0.8 or rng.random() < 0.7:
            return seen
        name = str(rng.choice(["time", "keypoints", "object_points", "confidence", "frame_time"]))
        value: object = float(rng.choice(odd))
        if name in ("keypoints", "object_points"):
            shape = [(21, 3), (20, 3), (0, 3), (), (50, 3)][rng.integers(5)]
            value = np.where(rng.random(shape) < 0.1, value, rng.normal(size=shape))
        return replace(seen, **{name: value})

    rehearse(handover, HAND, dt=0.02, longest=4.0, past_stops=True, spoil=garble)
    assert len(handover.transitions) >= 2
    again = replay(read_run_log(handover.log().save(tmp_path / "run.npz")))
    assert again.transitions == handover.transitions
    assert (again.caution, again.time) == (handover.caution, handover.time)
