"""The commanded motion: it arrives, and no step of it breaks a limit, whatever the target."""

import re
from itertools import product

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hadr.handover import ur5
from hadr.handover.poses import between, pose_distance
from hadr.handover.robot import UnreachableError
from hadr.handover.simulated_ur5 import HOME_JOINTS, ArmConfig, in_workspace
from hadr.simulation.robot.arm_motion import LEAST_SINGULAR_VALUE, ArmMotion
from hadr.simulation.robot.motion_limits import CLEARANCE, MARGIN, MotionConfig

DT = 0.02
SOLVER = 1e-6 / DT
"""DAQP keeps a row to 1e-6; the rows bound a step's angles, so speeds are kept to this, rad/s."""


@pytest.fixture(scope="module")
def motion() -> ArmMotion:
    return ArmMotion(ArmConfig(speed_fraction=0.35))


def home(motion: ArmMotion) -> ArmMotion:
    motion.put(HOME_JOINTS.copy(), np.zeros(6))
    return motion


def random_pose(rng: np.random.Generator) -> np.ndarray:
    """The tool in front of the robot, its approach within 60 degrees of forward or of down."""
    axis = np.array([1.0, 0, 0]) if rng.random() < 0.7 else np.array([0, 0, -1.0])
    lean = np.cross(axis, rng.normal(size=3))
    lean *= np.deg2rad(rng.uniform(0, 60)) / np.linalg.norm(lean)
    approach = Rotation.from_rotvec(lean).apply(axis)
    closing = np.cross(approach, rng.normal(size=3))
    closing /= np.linalg.norm(closing)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([closing, np.cross(approach, closing), approach], axis=1)
    pose[:3, 3] = rng.uniform([0.4, -0.25, 0.15], [0.65, 0.25, 0.5])
    return pose


def reachable(motion: ArmMotion, pose: np.ndarray) -> bool:
    try:
        next(motion.joint_goals(pose))
    except UnreachableError:
        return False
    return True


def arrives(motion: ArmMotion, target: np.ndarray) -> bool:
    """Whether it comes from home to a target within eight seconds."""
    home(motion)
    for _ in range(400):
        motion.advance(target, DT)
        distance, angle = pose_distance(motion.pose(), target)
        if distance < 0.002 and angle < np.deg2rad(1):
            return True
    return False


def test_arrives_at_random_poses_also_past_obstacles(motion: ArmMotion) -> None:
    rng = np.random.default_rng(7)
    home(motion)
    targets = [pose for pose in (random_pose(rng) for _ in range(100)) if reachable(motion, pose)]
    assert all(arrives(motion, target) for target in targets[1:30:2])


def test_no_way_leads_past_a_singular_pose_where_another_does(motion: ArmMotion) -> None:
    rng = np.random.default_rng(7)
    straight = roundabout = 0
    for target in (pose for pose in (random_pose(rng) for _ in range(60))):
        home(motion)
        if not reachable(motion, target):
            continue
        start = motion.pose()
        if motion.straight_way(target) is None:
            roundabout += 1
            continue
        straight += 1
        joints = motion.joints
        for share in np.linspace(0, 1, 30)[1:]:
            joints = next(motion.joint_goals(between(start, target, float(share)), joints))
            assert (
                ur5.singularity(joints) > 0.8 * LEAST_SINGULAR_VALUE
            )  # between the 4 cm looked at
    assert straight > 5
    assert roundabout > 5


def test_swings_only_where_it_may_and_no_faster_than_told(motion: ArmMotion) -> None:
    rng = np.random.default_rng(7)
    swung = 0
    for target in (pose for pose in (random_pose(rng) for _ in range(20))):
        home(motion)
        if not reachable(motion, target) or motion.straight_way(target) is not None:
            continue
        start, aside = motion.pose()[:3, 3], {}
        along = (target[:3, 3] - start) / np.linalg.norm(target[:3, 3] - start)
        for swing in (True, False):
            home(motion).forget()
            places = []
            for _ in range(200):
                motion.advance(target, DT, speed=0.1, swing=swing)
                places.append(motion.pose()[:3, 3] - start)
            speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / DT
            assert speeds.max() < 0.115  # the half spaces let through 12 % more between axes
            off = np.array(places) - np.outer(np.array(places) @ along, along)
            aside[swing] = np.linalg.norm(off, axis=1).max()
        assert aside[False] < 0.02
        swung += aside[True] > 0.05
    assert swung > 2


def test_short_ways_are_straight_and_as_fast_as_allowed(motion: ArmMotion) -> None:
    home(motion)
    start = motion.pose()
    target = start.copy()
    target[:3, 3] += [0.1, -0.2, -0.1]
    along = (target[:3, 3] - start[:3, 3]) / np.linalg.norm(target[:3, 3] - start[:3, 3])
    places = []
    for _ in range(100):
        motion.advance(target, DT)
        places.append(motion.pose()[:3, 3] - start[:3, 3])
    aside = np.array(places) - np.outer(np.array(places) @ along, along)
    assert np.linalg.norm(aside, axis=1).max() < 0.01
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / DT
    # the half spaces around the ball of 0.25 m/s let through 89 % in the worst direction
    assert 0.89 * 0.25 / 1.02 * 0.98 < speeds.max() < 0.25
    np.testing.assert_allclose(places[-1], target[:3, 3] - start[:3, 3], atol=1e-4)


@settings(max_examples=12)
@given(st.integers(0, 2**32 - 1), st.floats(0.1, 1.5))
def test_no_target_breaks_a_limit(motion: ArmMotion, seed: int, spread: float) -> None:
    rng = np.random.default_rng(seed)
    limits = home(motion).motion
    for _ in range(5):
        target = np.eye(4)
        target[:3, :3] = Rotation.random(rng=rng).as_matrix()
        target[:3, 3] = [0.4, 0.0, 0.3] + spread * rng.uniform(-1, 1, 3)
        for _ in range(int(rng.integers(5, 30))):
            before, joints = motion.velocity, motion.joints
            try:
                motion.advance(target, DT)
            except UnreachableError:
                np.testing.assert_array_equal(motion.joints, joints)
                motion.brake(DT, limits.joint_acceleration)
            assert np.abs(motion.velocity).max() <= np.pi * 0.35 + SOLVER
            step = np.abs(motion.velocity - before).max()
            assert step <= limits.joint_acceleration * DT + SOLVER
            assert in_workspace(motion.pose()[:3, 3])
            assert nearest_links(motion) > CLEARANCE - 1e-3


GRIPPER = ("left_finger", "right_finger", "bar", "palm")
WRIST = ("wrist_1", "wrist_2", "wrist_3", *GRIPPER)
APART = [
    (("base", "shoulder", "shoulder_1"), ("forearm", *WRIST)),
    (("upper_arm",), WRIST),
    (("forearm", "forearm_1"), ("wrist_3", *GRIPPER)),
    (("table",), ("forearm", "forearm_1", *WRIST)),
]
"""What must keep off what."""


def nearest_links(motion: ArmMotion) -> float:
    """Smallest distance of what must keep off each other, metres, at most 0.1."""
    model, data = motion._configuration.model, motion._configuration.data
    gaps = [
        mujoco.mj_geomDistance(model, data, model.geom(a).id, model.geom(b).id, 0.1, None)
        for some, others in APART
        for a, b in product(some, others)
    ]
    return min(gaps)


@pytest.mark.parametrize(
    ("joints", "group"),
    [
        ([2.7, -2.0, 2.4, 1.4, 2.0, -0.9], 0),
        ([-0.6, -1.9, -2.6, 0.5, -1.3, 1.1], 1),
        ([-2.0, -0.7, -2.7, 1.4, -2.6, -0.7], 2),
        ([2.4, 0.1, -1.0, 3.1, -1.2, -2.0], 3),  # the forearm
        ([2.5, -2.6, -1.3, -0.9, -0.1, 0.0], 3),  # the gripper
    ],
)
def test_links_that_come_too_near_are_named(
    motion: ArmMotion, joints: list[float], group: int
) -> None:
    motion.put(np.array(joints), np.zeros(6))
    words = motion.rows.broken(motion._configuration)
    named = re.fullmatch(r"(\w+) and (\w+) would be -?\d+ mm apart", words)
    assert named
    some, others = APART[group]
    assert set(named.groups()) & set(some)
    assert set(named.groups()) & set(others)


def test_the_tool_turns_no_faster_than_it_may() -> None:
    motion = ArmMotion(ArmConfig(speed_fraction=0.35), MotionConfig(turn_speed=0.5))
    target = motion.pose()
    target[:3, :3] = target[:3, :3] @ Rotation.from_euler("z", 1.0).as_matrix()
    speeds = []
    for _ in range(40):
        before = motion.pose()
        motion.advance(target, DT)
        speeds.append(pose_distance(before, motion.pose())[1] / DT)
    assert 0.45 < max(speeds) < 0.55


def test_the_edge_of_the_workspace_holds_a_target_on_it(motion: ArmMotion) -> None:
    home(motion)
    target = motion.pose()
    target[:3, 3] = [0.5, 0.1, 0.0495]  # half a millimetre below the box
    with pytest.raises(UnreachableError, match="outside the workspace box"):
        motion.advance(target, DT)
    target[2, 3] = 0.056
    for _ in range(150):
        motion.advance(target, DT)
        assert motion.pose()[2, 3] > 0.05 + MARGIN - 1e-4


def test_braking_takes_the_time_of_the_acceleration(motion: ArmMotion) -> None:
    velocity = np.array([1.0, -0.5, 0.2, 0, 0, 0])
    motion.put(HOME_JOINTS.copy(), velocity)
    motion.brake(DT, 5.0)
    np.testing.assert_allclose(motion.velocity, 0.9 * velocity)  # 1 rad/s less 5 rad/s2 x 0.02 s
    for _ in range(9):
        motion.brake(DT, 5.0)
    np.testing.assert_allclose(motion.velocity, 0.0, atol=1e-12)
