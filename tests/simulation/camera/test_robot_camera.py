"""The camera beside the robot: exact labels, a moved world, an arm in the way, the picture."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hadr.camera import back_project, project, transform_points
from hadr.handover.simulated_ur5 import HOME_JOINTS, SimulatedUR5
from hadr.simulation.camera.robot_camera import EYE, RobotCamera
from hadr.simulation.camera.room import FLOOR, make_room
from hadr.simulation.world.scenes import MIDDLE, HeldScene
from hadr.simulation.world.state import WorldState
from hadr.synthesis.hand.mesh import HandMesh
from hadr.synthesis.rendering.raycast import RayCaster
from hadr.synthesis.scene.contents import Contents


def shifted(pose: np.ndarray, by: list[float]) -> np.ndarray:
    moved = pose.copy()
    moved[:3, 3] += by
    return moved


def test_it_looks_at_the_place_where_things_are_held_out(camera: RobotCamera) -> None:
    middle = transform_points(np.linalg.inv(camera.base_from_camera), MIDDLE)
    np.testing.assert_allclose(middle, [0, 0, np.linalg.norm(MIDDLE - EYE)], atol=1e-12)
    assert 0.6 < middle[2] < 0.9
    np.testing.assert_allclose(project(middle, camera.intrinsics), [127.5, 71.5], atol=0.01)
    up = transform_points(np.linalg.inv(camera.base_from_camera), MIDDLE + np.array([0, 0, 0.05]))
    assert project(up, camera.intrinsics)[1] < 60  # the image is upright


def test_labels_equal_those_of_the_exact_ray_caster_on_the_moved_scene(
    scene: HeldScene, at: Callable[..., WorldState], monkeypatch: pytest.MonkeyPatch
) -> None:
    camera = RobotCamera()
    monkeypatch.setattr(RobotCamera, "_arm_in_view", lambda self, *_: [])
    wrist = shifted(scene.base_from_wrist, [0.03, -0.05, 0.02])
    wrist[:3, :3] = Rotation.from_rotvec([0.1, 0.2, -0.3]).as_matrix() @ wrist[:3, :3]
    item = wrist @ scene.hold.wrist_from_object
    state = at(scene, 0.0, base_from_wrist=wrist, base_from_object=item)
    frame = camera.capture(state, scene, np.random.default_rng(0), color=False)
    skin = scene.hand(0.004)
    contents = Contents(
        HandMesh(skin.surface.moved(wrist), skin.albedo, skin.gloss),
        tuple(body.moved(item) for body in scene.glass()),
        surroundings=make_room(camera.room).surroundings,
    )
    exact = RayCaster(contents).labels(camera.intrinsics, camera.base_from_camera)
    assert (frame.object_mask != exact.object_mask).sum() <= 3
    assert (frame.hand_mask != exact.hand_mask).sum() <= 3
    close = np.abs(frame.depth - exact.depth) < 1e-4
    assert (~close).sum() <= 8
    assert (np.abs(frame.background_depth - exact.background_depth) >= 1e-4).sum() <= 8
    assert (frame.depth > 0).all()  # every ray ends on something
    assert not frame.arm_mask.any()


def test_the_floor_and_the_object_are_where_they_should_be(
    scene: HeldScene, camera: RobotCamera, at: Callable[..., WorldState]
) -> None:
    frame = camera.capture(at(scene, 0.0), scene, np.random.default_rng(0), color=False)
    points = transform_points(camera.base_from_camera, back_project(frame.depth, frame.camera))
    assert points[..., 2].min() == pytest.approx(FLOOR, abs=1e-4)
    on_glass = transform_points(np.linalg.inv(scene.base_from_object), points[frame.object_mask])
    assert (on_glass[:, 2] > -1e-4).all()
    assert (on_glass[:, 2] < scene.item.height + 1e-4).all()
    assert np.hypot(on_glass[:, 0], on_glass[:, 1]).max() < 0.08


def test_keypoints_follow_the_hand_and_an_object_that_was_taken_leaves_it(
    scene: HeldScene, camera: RobotCamera, at: Callable[..., WorldState]
) -> None:
    away = [0.10, 0.0, -0.05]
    state = at(scene, 0.0, base_from_wrist=shifted(scene.base_from_wrist, away))
    frame = camera.capture(state, scene, np.random.default_rng(0), color=False)
    expected = transform_points(
        np.linalg.inv(camera.base_from_camera), scene.keypoints + np.array(away)
    )
    np.testing.assert_allclose(frame.keypoints, expected, atol=1e-12)
    rest = camera.capture(at(scene, 0.0), scene, np.random.default_rng(0), color=False)
    # the object stayed: with the hand gone more of it is seen
    assert frame.object_mask.sum() > 1.1 * rest.object_mask.sum()
    assert (frame.object_mask | ~rest.object_mask).all()


def test_a_hand_that_has_opened_is_seen_open(
    scene: HeldScene, camera: RobotCamera, at: Callable[..., WorldState]
) -> None:
    opened = np.array([1.0, 1, 0.5, 0, 1])
    frame = camera.capture(at(scene, 0.0, opened=opened), scene, np.random.default_rng(0))
    hand = scene.opened(opened).keypoints
    camera_from_base = np.linalg.inv(camera.base_from_camera)
    np.testing.assert_allclose(frame.keypoints, transform_points(camera_from_base, hand), atol=1e-9)
    # the pictures' skin lies on the open fingers: their bones are just under it
    skin = transform_points(camera.base_from_camera, back_project(frame.depth, frame.camera))
    for tip in hand[[4, 8, 20]]:
        assert np.linalg.norm(skin[frame.hand_mask] - tip, axis=1).min() < 0.02
    assert np.linalg.norm(skin[frame.hand_mask] - scene.keypoints[8], axis=1).min() > 0.02


def test_the_arm_is_seen_and_hides_the_hand(
    scene: HeldScene, camera: RobotCamera, at: Callable[..., WorldState]
) -> None:
    hand = scene.keypoints.mean(axis=0)
    robot = SimulatedUR5()
    pose = robot.tool_pose()
    # the gripper crosses the line from the hand to the camera
    pose[:3, 3] = hand + 0.35 * (EYE - hand) + [0.08, 0, 0]
    state = at(scene, 0.0, joints=robot.joint_solutions(pose)[0])
    rest = camera.capture(at(scene, 0.0), scene, np.random.default_rng(0), color=False)
    frame = camera.capture(state, scene, np.random.default_rng(0), color=False)
    assert frame.arm_mask.mean() > 0.05
    assert (frame.hand_mask & frame.arm_mask).sum() == 0
    assert camera.visible(rest.keypoints, at(scene, 0.0)).all()
    seen = camera.visible(frame.keypoints, state)
    assert 0 < seen.sum() < 21
    # the ray to a hidden keypoint ends on the arm, before it
    for point, free in zip(frame.keypoints, seen, strict=True):
        u, v = np.rint(project(point, camera.intrinsics)).astype(int)
        patch = frame.arm_mask[v - 1 : v + 2, u - 1 : u + 2]
        assert patch.any() if not free else not patch.all()
    beside = frame.keypoints + np.array([2.0, 0, 0])
    assert not camera.visible(beside, state).any()
    assert not camera.visible(-frame.keypoints, state).any()  # behind the camera


def test_leaving_out_parts_beside_the_picture_changes_nothing(
    scene: HeldScene,
    camera: RobotCamera,
    monkeypatch: pytest.MonkeyPatch,
    at: Callable[..., WorldState],
) -> None:
    from hadr.simulation.robot.arm_shape import arm_surfaces

    few = camera.capture(at(scene, 0.0), scene, np.random.default_rng(0), color=False)
    assert few.arm_mask.any()
    everything = arm_surfaces(HOME_JOINTS, 0.085)
    assert len(camera._arm_in_view(at(scene, 0.0), camera.base_from_camera)) < len(everything) / 2
    monkeypatch.setattr(RobotCamera, "_arm_in_view", lambda self, *_: everything)
    full = camera.capture(at(scene, 0.0), scene, np.random.default_rng(0), color=False)
    np.testing.assert_array_equal(few.depth, full.depth)


def test_pictures_look_like_the_training_frames_and_repeat(
    scene: HeldScene, camera: RobotCamera, at: Callable[..., WorldState]
) -> None:
    one, again = (camera.capture(at(scene, 0.0), scene, np.random.default_rng(5)) for _ in range(2))
    assert one.color is not None
    assert again.color is not None
    np.testing.assert_array_equal(one.color, again.color)
    np.testing.assert_array_equal(one.raw_depth, again.raw_depth)
    gray = camera.capture(at(scene, 0.0), scene, np.random.default_rng(5), color=False)
    np.testing.assert_array_equal(gray.raw_depth, one.raw_depth)  # whoever needs no colour
    # bundled validation frames: mean 131 to 167, standard deviation 25 to 70
    assert 125 < one.color.mean() < 175
    assert 20 < one.color.std() < 75
    red, _, blue = one.color[one.hand_mask].astype(float).mean(axis=0)
    assert red > blue + 20  # skin
    missing = one.raw_depth == 0
    assert 0.6 < missing[one.object_mask].mean() < 0.95
    assert 0.03 < missing[~one.object_mask].mean() < 0.35
    error = np.abs(one.raw_depth - one.depth)
    # the glass itself is seldom measured; without it 0.02 would be right by chance
    assert 0.03 < (error[one.object_mask] < 0.01).mean() < 0.12
    assert 0.0005 < np.median(error[one.hand_mask & ~missing]) < 0.004


def test_the_arm_is_masked_where_the_calibration_expects_it(
    scene: HeldScene, camera: RobotCamera, at: Callable[..., WorldState]
) -> None:
    turned, rng = camera.miscalibrated(6.0, seed=4), np.random.default_rng
    there = RobotCamera(turned.calibration)  # a camera that stands where the other is believed to
    true, drawn, exact = (
        one.capture(at(scene, 0.0), scene, rng(0), color=False) for one in (camera, turned, there)
    )
    np.testing.assert_array_equal(drawn.arm_mask, exact.arm_mask)
    assert (drawn.arm_mask != true.arm_mask).sum() > 0.2 * true.arm_mask.sum()
    for name in ("depth", "raw_depth", "object_mask", "hand_mask"):  # the picture is the same
        np.testing.assert_array_equal(getattr(drawn, name), getattr(true, name))


@pytest.mark.parametrize("degrees", [0.0, 3.0])
def test_a_turned_calibration_is_wrong_by_that_angle_about_the_camera(degrees: float) -> None:
    camera = RobotCamera().miscalibrated(degrees, seed=4)
    true, believed = camera.base_from_camera, camera.calibration
    turn = Rotation.from_matrix(true[:3, :3].T @ believed[:3, :3]).magnitude()
    assert np.rad2deg(turn) == pytest.approx(degrees, abs=1e-9)
    np.testing.assert_array_equal(true[:3, 3], believed[:3, 3])
    np.testing.assert_array_equal(RobotCamera().calibration, RobotCamera().base_from_camera)
