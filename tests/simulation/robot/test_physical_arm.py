"""The arm with mass: it arrives, it keeps its limits, it refuses nonsense, it yields to a hand."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hadr.handover.poses import pose_distance
from hadr.handover.robot import Robot, UnreachableError
from hadr.handover.simulated_ur5 import ArmConfig, SimulatedUR5, in_workspace
from hadr.simulation.robot.motion_limits import MotionConfig
from hadr.simulation.robot.physical_arm import PROTECTIVE_FORCE
from hadr.simulation.world.physics import World
from hadr.simulation.world.scenes import HeldScene, held_scene


@pytest.fixture(scope="module")
def scene() -> HeldScene:
    return held_scene("0000", 925)


def moved(pose: np.ndarray, *shift: float) -> np.ndarray:
    target = pose.copy()
    target[:3, 3] += shift
    return target


def drive(world: World, target: np.ndarray, seconds: float) -> None:
    for _ in range(round(seconds / 0.02)):
        world.robot.servo_to(target, 0.02)
        world.step(0.02)


def test_arrives_and_stands_still(scene: HeldScene) -> None:
    world = World(scene)
    robot: Robot = world.robot
    assert pose_distance(robot.tool_pose(), SimulatedUR5().tool_pose())[0] < 1e-6
    target = moved(robot.tool_pose(), 0.05, -0.2, -0.1)
    target[:3, :3] = target[:3, :3] @ Rotation.from_euler("y", 0.3).as_matrix()
    assert robot.reachable(target)
    drive(world, target, 2.2)
    distance, angle = pose_distance(robot.tool_pose(), target)
    assert distance < 0.001
    assert angle < np.deg2rad(0.3)
    before = robot.joint_positions()
    drive(world, target, 0.2)
    assert np.abs(robot.joint_positions() - before).max() < 1e-4  # no trembling


def test_no_number_is_no_target_and_the_arm_does_not_move(scene: HeldScene) -> None:
    world = World(scene)
    before = world.robot.tool_pose()
    with pytest.raises(ValueError, match="must be finite"):
        world.robot.servo_to(moved(before, np.nan, 0, 0), 0.02)
    with pytest.raises(ValueError, match=r"at most 0\.1 seconds, got nan"):
        world.robot.servo_to(before, np.nan)
    with pytest.raises(UnreachableError, match=r"forearm reach from"):
        world.robot.servo_to(moved(before, 3, 0, 0), 0.02)
    with pytest.raises(ValueError, match="gripper width must lie between"):
        world.robot.set_gripper(np.nan, 7.0)
    world.step(0.2)
    np.testing.assert_allclose(world.robot.tool_pose(), before, atol=1e-5)
    assert not world.robot.reachable(moved(before, 3, 0, 0))


def test_the_joints_themselves_keep_speed_and_acceleration(scene: HeldScene) -> None:
    """The physical ones, by differences over 10 ms."""
    arm, motion = ArmConfig(speed_fraction=0.6), MotionConfig(joint_acceleration=9.0)
    world = World(scene, None, arm, motion)
    places, home = [world.robot.joint_positions()], world.robot.tool_pose()
    for shift in ([0.1, -0.3, 0.1], [-0.05, 0.2, -0.15], [0.1, -0.1, 0.15]):
        target = moved(home, *shift)
        target[:3, :3] = target[:3, :3] @ Rotation.from_euler("xz", [0.6, -0.8]).as_matrix()
        for _ in range(40):
            world.robot.servo_to(target, 0.02)
            for _ in range(2):
                world.step(0.01)
                places.append(world.robot.joint_positions())
    speed = np.diff(places, axis=0) / 0.01
    assert 0.8 < np.abs(speed).max() / (0.6 * np.pi) <= 1.0
    assert 0.8 < np.abs(np.diff(speed, axis=0)).max() / 0.01 / 9.0 <= 1.0


def test_a_silent_client_makes_the_arm_brake(scene: HeldScene) -> None:
    world = World(scene)
    target = moved(world.robot.tool_pose(), 0.0, -0.35, 0.0)
    drive(world, target, 0.5)
    moving = world.robot.tool_pose()
    world.step(0.4)
    stood = world.robot.tool_pose()
    world.step(0.2)
    # 0.35 m/s for at most a quarter of a second, even without slowing down
    assert 0.01 < pose_distance(moving, stood)[0] < 0.0875
    assert pose_distance(world.robot.tool_pose(), stood)[0] < 2e-4


def test_stop_holds_until_release(scene: HeldScene) -> None:
    world = World(scene)
    target = moved(world.robot.tool_pose(), 0.0, -0.35, 0.0)
    drive(world, target, 0.4)
    world.robot.stop()
    drive(world, target, 0.4)
    stood = world.robot.tool_pose()
    drive(world, target, 0.3)
    assert pose_distance(world.robot.tool_pose(), stood)[0] < 2e-4
    world.robot.release()
    drive(world, target, 2.0)
    assert pose_distance(world.robot.tool_pose(), target)[0] < 0.001


@settings(max_examples=4, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 2**32 - 1))
def test_the_tool_never_leaves_its_workspace(scene: HeldScene, seed: int) -> None:
    rng = np.random.default_rng(seed)
    world = World(scene)
    for _ in range(8):
        target = np.eye(4)
        target[:3, :3] = Rotation.random(rng=rng).as_matrix()
        target[:3, 3] = rng.uniform([-0.9, -0.9, 0.0], [1.0, 0.9, 1.2])
        for _ in range(15):
            try:
                world.robot.servo_to(target, 0.02)
            except UnreachableError:
                break
            world.step(0.02)
            assert in_workspace(world.robot.tool_pose()[:3, 3])
        world.step(0.1)
        assert in_workspace(world.robot.tool_pose()[:3, 3])


def test_fingers_move_together_at_their_speed(scene: HeldScene) -> None:
    world = World(scene)
    assert world.robot.gripper_width() == pytest.approx(0.085, abs=1e-4)
    world.robot.set_gripper(0.025, 7.0)
    world.step(0.3)  # 0.1 m/s: half of the way of 60 mm
    assert world.robot.gripper_width() == pytest.approx(0.055, abs=0.004)
    world.step(0.5)
    assert world.robot.gripper_width() == pytest.approx(0.025, abs=5e-4)
    left, right = (world._data.joint(f"{side}_finger").qpos[0] for side in ("left", "right"))
    assert left == pytest.approx(right, abs=1e-4)


@pytest.mark.parametrize(
    ("speed", "keypoint"), [(0.1, 0), (0.1, 12), (0.2, 0), (0.2, 5), (0.15, 12)]
)
def test_a_push_into_the_hand_stays_gentle(scene: HeldScene, speed: float, keypoint: int) -> None:
    """At 0.2 m/s the tip of the middle finger would feel 25 N."""
    world = World(scene)
    start = world.robot.tool_pose()
    way = scene.keypoints[keypoint] - start[:3, 3]
    length = float(np.linalg.norm(way))
    forces = []
    for step in range(round((length + 0.1) / speed / 0.02)):
        far = min(speed * 0.02 * (step + 1), length + 0.08)
        world.robot.servo_to(moved(start, *(way / length * far)), 0.02)
        world.step(0.02)
        forces.append(world.state().hand_force)
        assert world.state().hand_force == forces[-1]  # looking changes nothing
        if world.robot.protective_stop:
            break
    assert 2.0 < max(forces) < 20.0
    said = rf"\d\d?\.\d N on the arm, more than {PROTECTIVE_FORCE}"
    assert re.match(said, world.robot.protective_stop)
    stood = world.robot.tool_pose()
    drive(world, start, 0.2)  # commands do nothing now
    assert pose_distance(world.robot.tool_pose(), stood)[0] < 0.005
    world.robot.release()
    assert world.robot.protective_stop  # that is a person's business
    drive(world, start, 4.7)
    assert world.robot.protective_stop
    drive(world, start, 12.0)  # a hand that still leans on it stops it once more
    assert pose_distance(world.robot.tool_pose(), start)[0] < 0.005


def test_a_hand_that_comes_against_the_forearm_stops_the_arm(scene: HeldScene) -> None:
    """The knuckles begin 15 cm above its middle and want to go 10 cm below it."""
    wrist = scene.base_from_wrist.copy()
    wrist[:3, 3] += World(scene)._data.geom("forearm").xpos - scene.keypoints[9] + [0, 0, 0.15]
    world = World(replace(scene, base_from_wrist=wrist), lambda t: moved(np.eye(4), 0, 0, -0.2 * t))
    assert world.state().hand_distance > 0.02
    forces = []
    while world.time < 1.25 and not world.robot.protective_stop:
        world.step(0.02)
        forces.append(world.state().hand_force)
    assert world.robot.protective_stop
    assert PROTECTIVE_FORCE < max(forces) < 20.0


def test_the_wrist_feels_what_the_gripper_pushes(scene: HeldScene) -> None:
    """Closed fingers run into the glass: the hand's spring says how hard."""
    world = World(scene)
    robot = world.robot
    silent = np.array([robot.tool_wrench() for _ in range(400)])
    np.testing.assert_allclose(silent.mean(axis=0), 0.0, atol=0.02)
    np.testing.assert_allclose(silent.std(axis=0), [0.1] * 3 + [0.005] * 3, rtol=0.2)
    robot.set_gripper(0.0, 7.0)
    drive(world, robot.tool_pose(), 1.2)
    start = robot.tool_pose()
    middle = scene.base_from_object @ [0.0, 0.0, scene.item.height / 2, 1.0]
    start[:3, 3] = middle[:3] - [0.16, 0.0, 0.0]
    drive(world, start, 2.0)
    assert np.linalg.norm(robot.tool_wrench()[:3]) < 0.6  # noise
    felt = np.zeros(6)
    for step in range(60):
        world.robot.servo_to(moved(start, 0.002 * step, 0.0, 0.0), 0.02)
        world.step(0.02)
        felt = robot.tool_wrench()
        if np.linalg.norm(felt[:3]) > 1.5:
            break
    tool = robot.tool_pose()
    assert 1.5 < -felt[:3] @ tool[:3, 2] < 8.0  # against the approach
    # the torque is that of a force at the tips, no farther aside than a finger is wide
    lever = felt[3:] @ tool[:3, 1] / -(felt[:3] @ tool[:3, 2])
    assert abs(lever) < 0.015
