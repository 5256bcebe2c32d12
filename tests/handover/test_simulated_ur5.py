"""The simulated arm never leaves its limits, whatever it is told."""

from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hadr.handover import ur5
from hadr.handover.robot import Robot, UnreachableError
from hadr.handover.simulated_ur5 import (
    JOINT_ACCELERATION,
    TABLE,
    TOOL_SPEED,
    ArmConfig,
    SimulatedUR5,
    in_workspace,
)


def level_pose(x: float, y: float, z: float) -> np.ndarray:
    """A gripper at a point in the base frame that faces forward along x."""
    pose = np.eye(4)
    pose[:3, :3] = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])
    pose[:3, 3] = [x, y, z]
    return pose


def test_home_is_where_the_docstring_says() -> None:
    robot: Robot = SimulatedUR5()
    np.testing.assert_allclose(robot.tool_pose(), level_pose(0.34, 0.12, 0.38), atol=2e-3)


def test_goes_to_a_pose_at_the_speed_of_its_tool() -> None:
    robot = SimulatedUR5(ArmConfig(speed_fraction=1.0))
    target = level_pose(0.5, -0.1, 0.3)
    start, steps = robot.tool_pose()[:3, 3], 0
    while np.abs(robot.tool_pose() - target).max() > 1e-4:
        robot.servo_to(target, 0.02)
        steps += 1
    straight = np.linalg.norm(target[:3, 3] - start)
    assert straight / TOOL_SPEED < steps * 0.02 < 1.3 * straight / TOOL_SPEED + 0.5
    for _ in range(50):
        robot.servo_to(target, 0.02)
    np.testing.assert_allclose(robot.tool_pose(), target, atol=1e-9)


def test_solutions_all_reach_and_come_nearest_first() -> None:
    robot = SimulatedUR5()
    target = level_pose(0.45, 0.0, 0.35)
    solutions = robot.joint_solutions(target)
    way = np.abs(solutions - robot.joint_positions()).max(axis=1)
    assert (np.diff(way) >= 0).all()
    for joints in solutions:
        np.testing.assert_allclose(robot.tool_pose_at(joints), target, atol=1e-9)


def lowest_surface(joints: np.ndarray) -> float:
    """Height of the lowest surface of the links from the upper arm on, metres."""
    links = ur5.link_surfaces(joints)[2:]
    return float((links[:, [2, 5]] - links[:, 6:]).min())


def test_no_link_is_led_into_the_table_by_its_thickness() -> None:
    rng, robot, found = np.random.default_rng(0), SimulatedUR5(), 0
    for _ in range(400):
        pose = np.eye(4)
        pose[:3, :3] = Rotation.random(rng=rng).as_matrix()
        pose[:3, 3] = rng.uniform([0.2, -0.4, 0.1], [0.7, 0.4, 0.3])
        with suppress(UnreachableError):
            for joints in robot.joint_solutions(pose):
                found += 1
                assert lowest_surface(joints) >= TABLE
    assert found > 200


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.floats(0.1, 2.5))
def test_no_target_makes_it_break_a_limit(seed: int, spread: float) -> None:
    rng = np.random.default_rng(seed)
    robot = SimulatedUR5(ArmConfig(speed_fraction=1.0))
    for _ in range(6):
        target = np.eye(4)
        target[:3, :3] = Rotation.random(rng=rng).as_matrix()
        target[:3, 3] = rng.normal(0, spread, 3)
        dt = float(rng.uniform(0.001, 0.1))
        before, place = robot.joint_positions(), robot.tool_pose()[:3, 3]
        with suppress(UnreachableError):
            robot.servo_to(target, dt)
        joints = robot.joint_positions()
        speed = np.linalg.norm(robot.tool_pose()[:3, 3] - place) / dt
        assert speed <= 1.01 * TOOL_SPEED
        assert (np.abs(joints - before) <= np.pi * dt + 1e-12).all()
        assert (joints >= ur5.JOINT_LOWER).all()
        assert (joints <= ur5.JOINT_UPPER).all()
        outline = robot.outline()
        assert np.linalg.norm(outline[-1] - outline[1]) <= 0.85
        assert lowest_surface(joints) >= TABLE
        assert in_workspace(robot.tool_pose()[:3, 3])


def test_steps_of_one_length_keep_the_acceleration_too() -> None:
    rng = np.random.default_rng(0)
    robot, velocity = SimulatedUR5(ArmConfig(speed_fraction=1.0)), np.zeros(6)
    for _ in range(12):
        target = level_pose(*rng.uniform([0.3, -0.3, 0.2], [0.6, 0.3, 0.55]))
        for _ in range(30):
            before = robot.joint_positions()
            robot.servo_to(target, 0.02)
            last, velocity = velocity, (robot.joint_positions() - before) / 0.02
            assert np.abs(velocity - last).max() <= JOINT_ACCELERATION * 0.02 + 1e-9


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_bad_numbers_do_not_move_it(value: float) -> None:
    robot = SimulatedUR5()
    before = robot.joint_positions()
    target = robot.tool_pose()
    target[0, 3] = value
    with pytest.raises(ValueError, match="base_from_tool must be finite"):
        robot.servo_to(target, 0.03)
    for dt in (0.0, -1.0, 5.0, value):
        with pytest.raises(ValueError, match="dt must be more than 0"):
            robot.servo_to(robot.tool_pose(), dt)
    np.testing.assert_array_equal(robot.joint_positions(), before)


def test_unreachable_targets_name_the_limit() -> None:
    robot = SimulatedUR5()
    with pytest.raises(UnreachableError, match="forearm reach"):
        robot.servo_to(level_pose(1.4, 0.0, 0.4), 0.03)
    with pytest.raises(UnreachableError, match="outside the workspace box"):
        robot.servo_to(level_pose(0.5, 0.0, 0.01), 0.03)
    with pytest.raises(UnreachableError, match=r"reach is 0\.85 m"):
        robot.servo_to(level_pose(0.97, 0.0, 0.4), 0.03)
    assert not robot.reachable(level_pose(1.4, 0.0, 0.4))
    assert robot.reachable(level_pose(0.5, 0.0, 0.3))


@pytest.mark.parametrize("far", [(1.4, 0.0, 0.4), (0.5, 0.0, 0.01)])  # no joints, only bad ones
def test_before_a_target_out_of_reach_it_brakes_and_does_not_leap_to_a_stand(
    far: tuple[float, float, float],
) -> None:
    arm, dt = SimulatedUR5(), 0.008
    near = arm.tool_pose()
    near[0, 3] += 0.1
    for _ in range(20):
        arm.servo_to(near, dt)
    before, moved = arm.joint_positions(), []
    for _ in range(40):
        with pytest.raises(UnreachableError):
            arm.servo_to(level_pose(*far), dt)
        moved.append(np.abs(arm.joint_positions() - before).max() / dt)
        before = arm.joint_positions()
    assert moved[0] > 0
    assert moved[-1] == 0
    assert max(-np.diff(moved)) <= JOINT_ACCELERATION * dt + 1e-9


def test_home_is_allowed_and_speeds_are_checked() -> None:
    assert SimulatedUR5().reachable(SimulatedUR5().tool_pose())
    with pytest.raises(ValueError, match=r"speed_fraction must lie in \(0, 1\], got 2"):
        ArmConfig(speed_fraction=2.0)


def test_after_a_stop_the_arm_begins_from_rest() -> None:
    """Whoever stops and releases a moving arm must not see it jump to its old speed."""
    robot = SimulatedUR5()
    goal = robot.tool_pose()
    goal[2, 3] -= 0.15
    for _ in range(12):
        robot.servo_to(goal, 1 / 30)
    robot.stop()
    robot.release()
    before = robot.joint_positions()
    robot.servo_to(goal, 1 / 30)
    assert np.abs(robot.joint_positions() - before).max() <= JOINT_ACCELERATION / 900 + 1e-9


def test_stop_holds_until_released() -> None:
    robot = SimulatedUR5()
    before = robot.joint_positions()
    robot.stop()
    robot.servo_to(level_pose(0.5, 0, 0.3), 0.05)
    np.testing.assert_array_equal(robot.joint_positions(), before)
    robot.release()
    for _ in range(8):
        robot.servo_to(level_pose(0.5, 0, 0.3), 0.05)
    assert np.abs(robot.joint_positions() - before).max() > 1e-2
    stood = robot.joint_positions()
    robot.stop()
    robot.servo_to(level_pose(0.5, 0, 0.3), 0.02)
    np.testing.assert_array_equal(robot.joint_positions(), stood)


def test_gripper_closes_at_its_speed_and_refuses_nonsense() -> None:
    robot = SimulatedUR5()
    robot.set_gripper(0.05, 7.0)
    for _ in range(3):
        robot.servo_to(robot.tool_pose(), 0.1)
    assert robot.gripper_width() == pytest.approx(0.055)  # 0.085 - 3 * 0.1 s * 0.1 m/s
    robot.servo_to(robot.tool_pose(), 0.1)
    assert robot.gripper_width() == pytest.approx(0.05)
    for width in (-0.01, 0.2, np.nan):
        with pytest.raises(ValueError, match="gripper width must lie between"):
            robot.set_gripper(width, 7.0)
