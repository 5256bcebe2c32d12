"""Frames of the robot's camera for training: reproducible, labelled, and none of a trial."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hadr.data.frame import Frame, write_frame
from hadr.data.transhand import TransHand
from hadr.handover.simulated_ur5 import HOME_JOINTS
from hadr.simulation.camera import training_frames
from hadr.simulation.camera.robot_camera import EYE, RobotCamera
from hadr.simulation.camera.training_frames import EYE_SPREAD, FRAME_OBJECTS, HOLDS, camera_frame
from hadr.simulation.trials import TRIAL_HOLDS
from hadr.simulation.world.state import WorldState
from hadr.synthesis.glass.objects import NOVEL_OBJECTS


@pytest.fixture(scope="module")
def frame() -> Frame:
    return camera_frame("train", 3)


def test_the_same_number_gives_the_same_frame(frame: Frame) -> None:
    again, other = camera_frame("train", 3), camera_frame("train", 3, seed=1)
    np.testing.assert_array_equal(again.color, frame.color)
    np.testing.assert_array_equal(again.raw_depth, frame.raw_depth)
    assert not np.array_equal(other.color, frame.color)


def test_no_split_shares_a_hold_with_another_or_with_the_trials() -> None:
    splits = [*map(set, HOLDS.values()), set(TRIAL_HOLDS)]
    assert len(set.union(*splits)) == sum(map(len, splits))
    assert not set(FRAME_OBJECTS) & set(NOVEL_OBJECTS)


def test_the_labels_fit_the_picture(frame: Frame) -> None:
    assert frame.object_id == FRAME_OBJECTS[3]
    assert frame.object_mask.sum() > 50
    assert not (frame.object_mask & frame.hand_mask).any()
    inside = frame.object_mask
    assert (frame.background_depth[inside] > frame.depth[inside]).mean() > 0.99
    assert (frame.raw_depth[inside] == 0).mean() > 0.4  # most of the glass is not measured
    u, v = np.round(frame.keypoints_uv).astype(int).T
    seen = (u >= 0) & (u < 256) & (v >= 0) & (v < 144)
    on_hand = (frame.hand_mask | frame.object_mask)[v[seen], u[seen]]
    assert on_hand.mean() > 0.7


def test_the_camera_stands_near_to_its_place_in_the_trials(frame: Frame) -> None:
    away = np.abs(frame.world_from_camera[:3, 3] - EYE)
    assert 0 < away.max() <= EYE_SPREAD


def test_a_training_reads_what_is_written(frame: Frame, tmp_path: Path) -> None:
    write_frame(tmp_path, frame, depth_format="png", normals="none")
    read = TransHand(tmp_path, "train")[0]
    np.testing.assert_array_equal(read.color, frame.color)
    np.testing.assert_allclose(read.depth, frame.depth, atol=6e-5)
    np.testing.assert_allclose(read.keypoints, frame.keypoints, atol=1e-5)
    assert read.hold_id == frame.hold_id


def test_wrong_arguments_are_named() -> None:
    with pytest.raises(ValueError, match="split must be one of train, val, test, got 'trials'"):
        camera_frame("trials", 0)
    with pytest.raises(ValueError, match="number must be 0 or more, got -1"):
        camera_frame("train", -1)


@pytest.mark.parametrize(("share", "at_home"), [(1.0, True), (0.0, False)])
def test_the_arm_is_at_home_in_its_share_of_the_frames(
    share: float, at_home: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[np.ndarray] = []

    class DrawnError(Exception):
        """The arm's pose is drawn: the picture is not needed."""

    def capture(camera: RobotCamera, state: WorldState, *_: object) -> None:
        seen.append(state.joints)
        raise DrawnError

    monkeypatch.setattr(RobotCamera, "capture", capture)
    monkeypatch.setattr(training_frames, "ARM_AT_HOME", share)
    with pytest.raises(DrawnError):
        camera_frame("train", 0)
    assert np.array_equal(seen[0], HOME_JOINTS) == at_home
