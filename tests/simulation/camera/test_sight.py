"""What the robot sees: sources that differ by depth alone, noise that lasts, clouds of points."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from hadr.camera import back_project, transform_points
from hadr.handover.simulated_ur5 import SimulatedUR5
from hadr.simulation.camera import sight
from hadr.simulation.camera.robot_camera import CapturedFrame, RobotCamera
from hadr.simulation.camera.sight import (
    FAULTS,
    KEYPOINT_NOISE,
    SOURCES,
    Fault,
    Sight,
    broken_sight,
    bundled_finder,
    keypoint_uncertainty,
    object_depth,
    object_points,
    scene_points,
    without_outliers,
)
from hadr.simulation.camera.training_frames import camera_frame
from hadr.simulation.world.scenes import HeldScene
from hadr.simulation.world.state import WorldState


@pytest.fixture
def quiet(monkeypatch: pytest.MonkeyPatch) -> None:
    """No noise on keypoints and mask."""
    monkeypatch.setattr(sight, "KEYPOINT_NOISE", 0.0)
    monkeypatch.setattr(sight, "MASK_JITTER", 0.0)


def test_perfect_depth_gives_points_on_the_object(
    scene: HeldScene, camera: RobotCamera, at: Callable[..., WorldState], quiet: None
) -> None:
    seen = Sight(scene, camera, "perfect").look(at(scene, 0.0), with_points=True)
    assert seen.object_points is not None
    own = transform_points(
        np.linalg.inv(scene.base_from_object) @ camera.base_from_camera, seen.object_points
    )
    distance, _ = cKDTree(scene.glass()[0].vertices).query(own)
    assert distance.max() < 0.004  # vertices are some millimetres apart
    assert len(own) > 600
    assert seen.confidence == 1.0


def test_sources_see_the_same_hand_and_mask_and_differ_in_depth(
    scene: HeldScene, camera: RobotCamera, at: Callable[..., WorldState]
) -> None:
    seen = {
        source: Sight(scene, camera, source, seed=3).look(at(scene, 0.0), with_points=True)
        for source in SOURCES
    }
    reference = seen["perfect"].keypoints
    for source in SOURCES:
        np.testing.assert_array_equal(seen[source].keypoints, reference)
        assert seen[source].object_points is not None
    true = seen["perfect"].object_points
    errors = {source: abs(np.median(seen[source].object_points[:, 2] - np.median(true[:, 2])))
              for source in SOURCES}  # fmt: skip
    assert max(errors[name] for name in ("unet-hand", "hadr", "hadr-plus")) < 0.03
    assert errors["raw"] > 0.2
    assert errors["inpainted"] > 0.2
    # the mask's pixels without depth give no points
    assert len(seen["raw"].object_points) < 0.5 * len(true)
    assert seen["raw"].confidence is None
    assert seen["hadr"].confidence is None, "it cannot say how sure it is"
    assert seen["hadr-plus"].confidence is not None
    assert 0.1 < seen["hadr-plus"].confidence < 1.0


def test_the_network_never_sees_depth_inside_of_the_mask(
    scene: HeldScene, camera: RobotCamera, at: Callable[..., WorldState]
) -> None:
    frame = camera.capture(at(scene, 0.0), scene, np.random.default_rng(0))
    mask = frame.object_mask
    wrong = replace(frame, raw_depth=np.where(mask, 3.0, frame.raw_depth).astype(np.float32))
    one, _ = object_depth("hadr", frame, mask, frame.keypoints)
    other, _ = object_depth("hadr", wrong, mask, frame.keypoints)
    np.testing.assert_array_equal(one[mask], other[mask])
    # without a hand it restores nothing, and says that it is not sure
    nothing, confidence = object_depth("hadr", frame, mask, None)
    assert (nothing[mask] == 0).all()
    assert confidence == 0.0


def test_keypoint_noise_has_its_size_and_lasts(
    scene: HeldScene, camera: RobotCamera, at: Callable[..., WorldState]
) -> None:
    raw = Sight(scene, camera, "raw", seed=1)
    true = camera.true_keypoints(at(scene, 0.0), scene)
    errors = np.array([raw._keypoint_noise(0.1 * k) for k in range(4000)])
    assert errors.std() == pytest.approx(0.004, rel=0.05)
    common = errors.mean(axis=1)
    assert common.std() == pytest.approx(0.004 * np.sqrt(0.5 + 0.5 / 21), rel=0.1)
    later = (errors[1:] * errors[:-1]).mean() / errors.var()
    assert later == pytest.approx(np.exp(-0.1 / 0.3), abs=0.03)
    seen = [raw.look(at(scene, 500.0 + t), with_points=False).keypoints for t in (0.0, 0.1)]
    assert np.abs(np.array(seen) - true).max() < 0.03
    assert not np.array_equal(seen[0], seen[1])


def test_keypoints_behind_the_gripper_are_guessed(
    scene: HeldScene,
    camera: RobotCamera,
    at: Callable[..., WorldState],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    hand = scene.keypoints.mean(axis=0)
    robot = SimulatedUR5()
    pose = robot.tool_pose()
    pose[:3, 3] = hand + 0.35 * (camera.base_from_camera[:3, 3] - hand)
    state = replace(at(scene, 0.0), joints=robot.joint_solutions(pose)[0])
    true = camera.true_keypoints(state, scene)
    free = camera.visible(true, state)
    assert 5 <= free.sum() < 21
    hidden = Sight(scene, camera, "raw", seed=1).look(state, with_points=False).keypoints
    monkeypatch.setattr(sight, "SMALLEST_VISIBLE", int(free.sum()) + 1)
    assert Sight(scene, camera, "raw").look(state, with_points=False).keypoints is None
    monkeypatch.setattr(RobotCamera, "_arm_in_view", lambda self, *_: [])
    in_view = Sight(scene, camera, "raw", seed=1).look(state, with_points=False).keypoints
    guessed_anyway = camera.behind_hand_or_glass(true, state, scene)
    factor = np.where(free | guessed_anyway, 1.0, 2.0)[:, None]
    np.testing.assert_allclose(hidden - true, factor * (in_view - true), atol=1e-12)


def test_keypoints_behind_glass_or_hand_are_guessed(
    scene: HeldScene,
    camera: RobotCamera,
    at: Callable[..., WorldState],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    state = at(scene, 0.0)
    true = camera.true_keypoints(state, scene)
    hidden = camera.behind_hand_or_glass(true, state, scene)
    assert 2 < hidden.sum() < 19
    # with the hand alone fewer are, and none of a point before everything
    away = scene.base_from_object.copy()
    away[2, 3] += 1.0
    alone = camera.behind_hand_or_glass(true, replace(state, base_from_object=away), scene)
    assert (hidden | ~alone).all()
    assert not camera.behind_hand_or_glass(0.5 * true, state, scene).any()
    seen = Sight(scene, camera, "raw", seed=1).look(state, with_points=False).keypoints
    monkeypatch.setattr(sight, "HIDDEN_NOISE", 1.0)
    plain = Sight(scene, camera, "raw", seed=1).look(state, with_points=False).keypoints
    factor = np.where(hidden, 2.0, 1.0)[:, None]
    np.testing.assert_allclose(seen - true, factor * (plain - true), atol=1e-12)


def test_a_hand_outside_of_the_picture_is_not_found(
    scene: HeldScene, camera: RobotCamera, at: Callable[..., WorldState]
) -> None:
    away = scene.base_from_wrist.copy()
    away[:3, 3] += [0.0, 0.0, 1.0]
    state = replace(at(scene, 0.0), base_from_wrist=away)
    seen = Sight(scene, camera, "perfect").look(state, with_points=True)
    assert seen.keypoints is None
    gone = replace(state, base_from_object=away @ scene.hold.wrist_from_object)
    seen = Sight(scene, camera, "perfect").look(gone, with_points=True)
    assert seen.object_points is None
    assert seen.scene_points is not None


def test_the_masks_outline_wavers_without_a_bias(
    scene: HeldScene, camera: RobotCamera, at: Callable[..., WorldState]
) -> None:
    raw = Sight(scene, camera, "raw", seed=1)
    frame = camera.capture(at(scene, 0.0), scene, np.random.default_rng(0), color=False)
    true = frame.object_mask
    seen = np.array([raw._seen_mask(true) for _ in range(60)])
    changed = (seen != true).sum(axis=(1, 2))
    assert 0.02 < changed.mean() / true.sum() < 0.25
    assert seen.sum(axis=(1, 2)).mean() == pytest.approx(true.sum(), rel=0.05)
    from scipy import ndimage

    far = ndimage.binary_dilation(true, iterations=4)
    assert not (seen & ~far).any()


@pytest.mark.parametrize("fault", FAULTS)
def test_sight_breaks_on_demand(
    scene: HeldScene, camera: RobotCamera, fault: Fault, at: Callable[..., WorldState]
) -> None:
    raw = Sight(scene, camera, "raw", seed=1)
    look = broken_sight(fault, 0.2, 0.45)(raw.look)
    seen = [look(at(scene, 0.1 * k), False) for k in range(7)]
    for k in (0, 1, 5, 6):
        assert np.isfinite(seen[k].keypoints).all()
        assert seen[k].frame_time == pytest.approx(0.1 * k)
        assert seen[k].confidence is None
    broken = seen[2:5]
    assert [s.time for s in broken] == pytest.approx([0.2, 0.3, 0.4])
    taken = [0.1, 0.1, 0.1] if fault == "no frames" else [0.2, 0.3, 0.4]
    assert [s.frame_time for s in broken] == pytest.approx(taken)
    assert all({
        "no hand": s.keypoints is None,
        "nan keypoints": s.keypoints is not None and np.isnan(s.keypoints).any(),
        "frozen keypoints": s.keypoints is seen[1].keypoints,
        "no frames": s.keypoints is seen[1].keypoints,
        "low confidence": s.confidence == 0.02,
    }[fault] for s in broken)  # fmt: skip


def test_wrong_faults_are_refused() -> None:
    with pytest.raises(ValueError, match="got 'asleep'"):
        broken_sight("asleep")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"since must not be later than until, got 2\.0 and 1\.0"):
        broken_sight("no hand", 2.0, 1.0)


def test_networks_find_glass_and_hand_in_a_picture_of_this_camera() -> None:
    """Not of a trial, nor of the training: a frame of the split for scoring."""
    frame = camera_frame("test", 2)
    found = CapturedFrame(
        frame.color, frame.raw_depth, frame.depth, frame.background_depth, frame.hand_mask,
        frame.object_mask, np.zeros_like(frame.hand_mask), frame.keypoints, frame.camera,
    )  # fmt: skip
    mask, hand, keypoints = bundled_finder().find(found)
    for seen, true in ((mask, frame.object_mask), (hand, frame.hand_mask)):
        assert (seen & true).sum() / (seen | true).sum() > 0.5
    assert not (mask & hand).any()
    assert keypoints is not None
    assert np.linalg.norm(keypoints - frame.keypoints, axis=1).mean() < 0.04
    with pytest.raises(ValueError, match="a picture with colour, got none"):
        bundled_finder().find(replace(found, color=None))


def test_a_robot_with_networks_is_told_nothing_by_the_simulator(
    scene: HeldScene, camera: RobotCamera, at: Callable[..., WorldState]
) -> None:
    told: list[CapturedFrame] = []

    class Blind:
        def find(self, frame: CapturedFrame):
            told.append(frame)
            return np.zeros_like(frame.object_mask), np.zeros_like(frame.hand_mask), None

    seen = Sight(scene, camera, "hadr", finder=Blind()).look(at(scene, 0.0), with_points=True)
    assert seen.keypoints is None
    assert seen.object_points is None
    assert told[0].color is not None


def test_keypoints_of_networks_are_steadied_and_the_simulator_s_are_not(
    scene: HeldScene, camera: RobotCamera, at: Callable[..., WorldState]
) -> None:
    class Shaky:
        """Finds the hand three millimetres to one side, then to the other."""

        count = 0

        def find(self, frame: CapturedFrame):
            self.count += 1
            side = 0.003 * (-1) ** self.count
            blank = np.zeros_like(frame.object_mask)
            return blank, blank, frame.keypoints + np.array([side, 0.0, 0.0])

    sight = Sight(scene, camera, "raw", finder=Shaky())
    seen = [sight.look(at(scene, 0.1 * number), with_points=False) for number in range(12)]
    middles = np.array(
        [look.keypoints.mean(axis=0)[0] for look in seen if look.keypoints is not None]
    )
    steps = np.abs(np.diff(middles))
    assert steps[0] == pytest.approx(0.003, abs=1e-6)  # half of the way, see HandFilter
    assert (steps[5:] < 0.0045).all()
    assert np.ptp(middles[6:]) < 0.0045


def test_the_guard_reckons_with_the_error_of_what_finds_the_keypoints(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert keypoint_uncertainty(by_networks=False) == pytest.approx(2 * KEYPOINT_NOISE)
    errors = np.random.default_rng(0).normal(scale=0.011, size=(100_000, 3))
    record = {"validation": {"keypoints_m": np.linalg.norm(errors, axis=1).mean()}}
    monkeypatch.setattr(sight, "read_record", lambda path: record)
    assert keypoint_uncertainty(by_networks=True) == pytest.approx(0.022, rel=0.01)


def test_scene_points_hold_the_forearm_but_neither_hand_nor_arm_nor_object(
    scene: HeldScene, camera: RobotCamera, at: Callable[..., WorldState]
) -> None:
    frame = camera.capture(at(scene, 0.0), scene, np.random.default_rng(0), color=False)
    exact = replace(frame, raw_depth=frame.depth)
    points = scene_points(exact, frame.object_mask, frame.keypoints)
    distance, _ = cKDTree(frame.keypoints).query(points)
    assert distance.min() > 0.06
    assert np.linalg.norm(points - frame.keypoints.mean(axis=0), axis=1).max() < 0.5
    images = {
        name: back_project(np.where(mask, frame.depth, 0), frame.camera)[mask]
        for name, mask in (("hand", frame.hand_mask), ("arm", frame.arm_mask))
    }
    on_forearm, _ = cKDTree(points).query(images["hand"])
    beyond, _ = cKDTree(frame.keypoints).query(images["hand"])
    assert (on_forearm[beyond > 0.08] < 0.03).mean() > 0.9
    off_arm, _ = cKDTree(images["arm"]).query(points)
    assert off_arm.min() > 0.005
    cubes = np.floor(points / 0.015)
    assert len(np.unique(cubes, axis=0)) == len(points)


def test_outliers_are_dropped_and_a_sheet_stays_whole() -> None:
    grid = np.stack(np.meshgrid(np.arange(20), np.arange(20)), axis=-1).reshape(-1, 2) * 0.003
    sheet = np.column_stack([grid, np.full(400, 0.6)])
    cloud = np.vstack([sheet, [[0.03, 0.03, 0.9], [0.2, 0.0, 0.6]]])
    kept = without_outliers(cloud)
    assert (kept[:, 2] == 0.6).all()
    assert kept[:, 0].max() < 0.1
    assert len(kept) >= 396
    assert len(without_outliers(sheet[:5])) == 5


def test_object_points_are_thinned_and_too_few_are_none(camera: RobotCamera) -> None:
    depth = np.full(camera.intrinsics.shape, 0.6, np.float32)
    mask = np.zeros(depth.shape, bool)
    mask[20:80, 50:110] = True
    points = object_points(depth, mask, camera.intrinsics, np.random.default_rng(0))
    assert points is not None
    assert 1400 < len(points) <= 1500
    depth[:] = 0
    depth[30, 60:69] = np.nan
    assert object_points(depth, mask, camera.intrinsics, np.random.default_rng(0)) is None
    depth[30, 60:69] = 0.6
    assert object_points(depth, mask, camera.intrinsics, np.random.default_rng(0)) is None
