"""The safety checks on cases that can be computed by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from hadr.handover import ur5
from hadr.handover.dimensions import FINGER_WIDTH
from hadr.handover.grasping.collision import FLESH
from hadr.handover.guarded_arm import GuardedArm
from hadr.handover.observation import HandWatch, Observation, clean_points, number
from hadr.handover.poses import between, toward
from hadr.handover.robot import HOME_JOINTS
from hadr.handover.safety import (
    SafetyConfig,
    closing_speed,
    hand_problem,
    line_velocity,
    low_confidence,
    object_in_hand,
    path_distance,
    singularity,
    something_held,
    speed_factor,
    withdrawal,
)
from hadr.handover.stages import HandoverConfig

C = SafetyConfig()


def flat_hand(x: float = 0.0) -> np.ndarray:
    """Wrist at (x, 0, 0), all bones along y in the plane z = 0, a palm of 9 cm."""
    hand = np.zeros((21, 3))
    for finger in range(5):
        hand[1 + 4 * finger : 5 + 4 * finger, 1] = [0.09, 0.12, 0.14, 0.16]
        hand[1 + 4 * finger : 5 + 4 * finger, 0] = 0.01 * (finger - 2)
    hand[:, 0] += x
    return hand


def noisy(seed: int) -> np.ndarray:
    return flat_hand() + np.random.default_rng(seed).normal(0, 1e-4, (21, 3))


def test_a_hand_is_told_from_other_numbers() -> None:
    assert hand_problem(flat_hand()) == ""
    assert "(20, 3)" in hand_problem(flat_hand()[:20])
    broken = flat_hand()
    broken[8, 1] = np.inf
    assert "index_tip" in hand_problem(broken)
    far = flat_hand() + np.array([0, 0, 7.0])
    assert hand_problem(far) == "a keypoint lies 7 m away, a hand at most 5.0 m"
    assert hand_problem(3 * flat_hand()).startswith("no hand has a palm of 0.270 m")
    assert hand_problem(np.zeros((21, 3))).startswith("no hand has a palm of 0.000 m")
    assert hand_problem("hand") != ""  # type: ignore[arg-type]


def test_speed_of_a_line_and_of_noise_around_it() -> None:
    times = np.array([0.0, 0.1, 0.2, 0.3])
    points = np.outer(times, [0.1, 0.0, -0.2]) + np.array([5.0, 1.0, 2.0])
    np.testing.assert_allclose(line_velocity(times, points), [0.1, 0.0, -0.2], atol=1e-12)
    points[[0, 3], 1] += 0.01  # even about the middle: no slope
    np.testing.assert_allclose(line_velocity(times, points), [0.1, 0.0, -0.2], atol=1e-12)


def test_free_space_on_a_path_is_that_of_its_nearest_pose() -> None:
    far, near = np.eye(4), np.eye(4)
    far[2, 3], near[2, 3] = 0.30 + 0.12, 0.10 + 0.12  # the stem's end stands 12 cm below the tool
    expected = 0.10 - FLESH - FINGER_WIDTH / 2
    hand = flat_hand()  # the stem's line x = y = 0 meets the wrist
    assert path_distance([far, near], 0.05, hand) == pytest.approx(expected)
    assert path_distance([far], 0.05, hand) == pytest.approx(expected + 0.20)


def test_closing_speed_counts_only_what_comes_nearer() -> None:
    hand, tool = np.array([1.0, 0, 0]), np.zeros(3)
    assert closing_speed(np.array([-0.3, 0.4, 0]), hand, tool) == pytest.approx(0.3)
    assert closing_speed(np.array([0.3, 0.4, 0]), hand, tool) == 0.0
    assert closing_speed(None, hand, tool) == 0.0


def test_speed_factor_keeps_the_least_distance_for_the_reaction_time() -> None:
    # 35 mm free, 5 needed, 0.2 s to react: together 0.15 m/s are allowed
    assert speed_factor(0.035, 0.005, 0.3, 0.0, 0.2) == pytest.approx(0.5)
    assert speed_factor(0.035, 0.005, 0.3, 0.09, 0.2) == pytest.approx(0.2)
    assert speed_factor(0.035, 0.005, 0.3, 0.2, 0.2) == 0.0
    assert speed_factor(0.035, 0.005, 0.1, 0.0, 0.2) == 1.0
    assert speed_factor(0.004, 0.005, 0.1, 0.0, 0.2) == 0.0
    assert speed_factor(0.006, 0.005, 0.1, 0.0, 0.0) == 1.0


def test_withdrawal_by_speed_and_by_distance_along_the_way() -> None:
    away = np.array([1.0, 0, 0])
    assert withdrawal(np.array([0.1, 0.5, 0]), np.array([0.1, 1.0, 0]), away, C) == ""
    assert "16 cm" in withdrawal(np.array([0.16, 0, 0]), None, away, C)
    assert "0.25 m/s" in withdrawal(np.zeros(3), np.array([0.25, 0, 0]), away, C)
    assert withdrawal(np.zeros(3), np.array([-0.25, 0, 0]), away, C) == ""


def test_confidence_held_and_object_in_hand() -> None:
    assert low_confidence(None, 0.3) == low_confidence(0.3, 0.3) == ""
    assert "0.29, needed 0.30" in low_confidence(0.29, 0.3)
    assert low_confidence(float("nan"), 0.3) != ""
    assert something_held(0.034, 0.03, 0.003)
    assert not something_held(0.0325, 0.03, 0.003)
    assert object_in_hand(np.array([[1.0, 0, 0], [0, 0.1, 0.049]]), flat_hand(), 0.05)
    assert not object_in_hand(np.array([[0, 0.1, 0.051]]), flat_hand(), 0.05)


def test_singular_value_is_the_smallest_stretch_of_the_jacobian() -> None:
    for change in ({2: 0.0}, {4: 0.0}):  # elbow stretched; wrist's axes parallel
        joints = HOME_JOINTS.copy()
        for index, angle in change.items():
            joints[index] = angle
        assert singularity(joints) == pytest.approx(0.0, abs=1e-9)
    jacobian = np.zeros((6, 6))
    step = 1e-6
    for i in range(6):
        ahead, behind = HOME_JOINTS.copy(), HOME_JOINTS.copy()
        ahead[i] += step
        behind[i] -= step
        a, b = ur5.forward_kinematics(ahead), ur5.forward_kinematics(behind)
        jacobian[:3, i] = (a - b)[:3, 3] / (2 * step)
        turn = (a[:3, :3] @ b[:3, :3].T - np.eye(3)) / (2 * step)
        jacobian[3:, i] = [turn[2, 1], turn[0, 2], turn[1, 0]]
    expected = np.linalg.svd(jacobian, compute_uv=False)[-1]
    assert singularity(HOME_JOINTS) == pytest.approx(expected, rel=1e-5)
    assert singularity(np.zeros(7)) == np.inf


def test_thresholds_are_checked() -> None:
    with pytest.raises(ValueError, match="reaction_time must be 0 or more, got -1"):
        SafetyConfig(reaction_time=-1)
    with pytest.raises(ValueError, match="hand_lost_after must be 0 or more, got nan"):
        SafetyConfig(hand_lost_after=float("nan"))


def test_points_and_numbers_are_cleaned() -> None:
    cloud = np.ones((40, 3))
    cloud[0], cloud[1, 2], cloud[2, 0] = np.nan, np.inf, 1e200
    kept = clean_points(cloud)
    assert kept is not None
    assert kept.shape == (37, 3)
    for wrong in (cloud[:32], cloud[:, :2], cloud.ravel(), "points", None):
        assert clean_points(wrong) is None
    assert number(2) == 2.0
    for odd in (np.inf, np.nan, None, "2", 10**400, 1j):
        assert np.isnan(number(odd))


def test_watch_sees_lost_silent_and_frozen() -> None:
    watch = HandWatch(np.eye(4), C)
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
    watch = HandWatch(base_from_camera, C)
    for k in range(8):
        watch.look(Observation(0.1 * k, flat_hand(0.02 * k)), 0.1 * k)
        if k == 1:
            assert watch.velocity(0.3) is None  # 0.1 s is less than half of it
    assert watch.keypoints is not None
    np.testing.assert_allclose(watch.keypoints[0], [1.0, 0.14, 0.0], atol=1e-12)
    np.testing.assert_allclose(watch.velocity(0.3), [0.0, 0.2, 0.0], atol=1e-9)


def test_a_pose_between_two() -> None:
    second = np.eye(4)
    second[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    second[:3, 3] = [0.2, 0, 0]
    half = between(np.eye(4), second, 0.5)
    s = np.sqrt(0.5)
    np.testing.assert_allclose(half[:3, :3], [[s, -s, 0], [s, s, 0], [0, 0, 1]], atol=1e-12)
    np.testing.assert_allclose(half[:3, 3], [0.1, 0, 0])
    np.testing.assert_array_equal(toward(np.eye(4), second, 1.0, 4.0), second)
    np.testing.assert_allclose(toward(np.eye(4), second, 0.05, 4.0)[0, 3], 0.05)
    # 9 degrees of 90: a tenth of the way, although the distance would allow more
    np.testing.assert_allclose(toward(np.eye(4), second, 1.0, np.deg2rad(9))[0, 3], 0.02)


def test_the_reference_moves_at_its_speed_and_does_not_run_ahead() -> None:
    tool, goal, told = np.eye(4), np.eye(4), []
    goal[0, 3] = 1.0
    robot = SimpleNamespace(
        tool_pose=tool.copy, joint_positions=lambda: np.zeros(6), gripper_width=lambda: 0.08,
        protective_stop="", servo_to=lambda pose, dt: told.append(pose.copy()),
        release=lambda: None,
    )  # fmt: skip
    arm = GuardedArm(robot, HandoverConfig())
    for _ in range(4):
        arm.go(goal, 1.0, 0.02)
    np.testing.assert_allclose([pose[0, 3] for pose in told], [0.02, 0.04, 0.05, 0.05])
    arm.hold(0.02)
    np.testing.assert_array_equal(told[-1], np.eye(4))
    tool[2, 3] = -0.01  # the tool sags
    arm.read()
    arm.hold(0.02)
    np.testing.assert_array_equal(told[-1], np.eye(4))  # holds where it began to
    arm.release()
    arm.hold(0.02)
    np.testing.assert_array_equal(told[-1], tool)
