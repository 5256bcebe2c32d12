"""The UR5's geometry against published poses, and all inverse solutions."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hadr.handover import ur5
from hadr.handover.poses import check_pose
from hadr.handover.robot import UnreachableError
from hadr.handover.simulated_ur5 import HOME_JOINTS

PAIRS = (
    *("zero", "ros_main", "compas_doc", "compas_ik0", "home"),
    *("compas_q", "rtb_qr", "rtb_ik", "up"),
)
DISTINCT = {"zero": 2, "rtb_qr": 2, "rtb_ik": 1, "up": 1}


@pytest.fixture(scope="module")
def reference(realdata: Path) -> dict:
    return json.loads((realdata / "ur5" / "ur5_fk_ik_reference.json").read_text())


def same_angles(a: np.ndarray, b: np.ndarray) -> bool:
    return bool(np.abs((a - b + np.pi) % (2 * np.pi) - np.pi).max() < 1e-5)


@pytest.mark.parametrize("name", PAIRS)
def test_forward_kinematics_equals_the_reference_in_both_frames(reference: dict, name: str) -> None:
    pair = reference["pairs"][name]
    joints = np.array(pair["q"], dtype=float)
    flange, tool = ur5.forward_kinematics(joints), ur5.ros_forward_kinematics(joints)
    np.testing.assert_allclose(flange[:3], np.array(pair["T_dh_base_to_flange"])[:3], atol=1e-6)
    np.testing.assert_allclose(tool[:3], np.array(pair["T_base_link_to_ee"])[:3], atol=1e-6)


def test_forward_kinematics_at_zero_by_hand() -> None:
    # stretched out: lengths along minus x, d4 + d6 along minus y, d1 - d5 along z
    flange = ur5.forward_kinematics(np.zeros(6))
    expected = [-(0.425 + 0.39225), -(0.10915 + 0.0823), 0.089159 - 0.09465]
    np.testing.assert_allclose(flange[:3, 3], expected, atol=1e-12)


def test_published_points_of_compas_fab(reference: dict) -> None:
    for case in reference["published_by_compas_fab"]:
        if "q" in case:
            pose = ur5.ros_forward_kinematics(np.array(case["q"], dtype=float))
            tolerance = float(case["tol"].split()[0])
            np.testing.assert_allclose(pose[:3, 3], case["ee_point"], atol=tolerance)


@pytest.mark.parametrize("name", PAIRS)
def test_inverse_kinematics_gives_the_reference_set(reference: dict, name: str) -> None:
    pair = reference["pairs"][name]
    joints = np.array(pair["q"], dtype=float)
    target = ur5.forward_kinematics(joints)
    found = ur5.inverse_kinematics(target, free_angle=joints[5])
    expected = ur5.distinct_solutions(np.array(pair["ik"]))
    assert len(found) == len(expected) == DISTINCT.get(name, 8)
    for solution in found:
        np.testing.assert_allclose(ur5.forward_kinematics(solution), target, atol=1e-9)
        assert sum(same_angles(solution, other) for other in expected) == 1


@settings(max_examples=60)
@given(st.lists(st.floats(-3.1, 3.1), min_size=6, max_size=6))
@example([0.0, 0.0, 0.0, 0.0, 1e-7, 0.0])
@example([0.3, -1.0, 1.0, 0.2, -3e-8, 0.4])
@example([0.3, -1.0, 1.0, 0.2, 1e-9, 0.4])
@example([0.3, -1.0, 1.0, 0.2, np.pi - 1e-9, 0.4])
def test_every_solution_returns_the_pose_and_one_is_the_start(angles: list[float]) -> None:
    joints = np.array(angles)
    target = ur5.forward_kinematics(joints)
    solutions = ur5.inverse_kinematics(target, free_angle=joints[5])
    assert 1 <= len(solutions) <= 8
    for solution in solutions:
        np.testing.assert_allclose(ur5.forward_kinematics(solution), target, atol=1e-7)
    singular = min(abs(np.sin(joints[[2, 4]]))) < 1e-3
    if not singular:
        distance = np.abs(ur5.wrap_angle(solutions - joints)).max(axis=1)
        assert distance.min() < 1e-5


def test_free_angle_moves_on_where_the_wish_cannot_be_reached() -> None:
    joints = np.array([0, -0.3, 0, -2.2, 0, 2.0])  # stretched, and the wrist singular
    target = ur5.forward_kinematics(joints)
    for solution in ur5.inverse_kinematics(target, free_angle=0.0):
        np.testing.assert_allclose(ur5.forward_kinematics(solution), target, atol=1e-9)


def test_unreachable_targets_say_why() -> None:
    far, near = np.eye(4), np.eye(4)
    far[:3, 3] = [1.2, 0.0, 0.3]
    near[:3, 3] = [0.05, 0.0, 0.5]
    with pytest.raises(UnreachableError, match=r"forearm reach from 0\.033 to 0\.817 m"):
        ur5.inverse_kinematics(far)
    with pytest.raises(UnreachableError, match=r"0\.050 m from the base's axis"):
        ur5.inverse_kinematics(near)


def test_a_mirror_or_nan_is_no_pose() -> None:
    with pytest.raises(ValueError, match="proper rotation"):
        ur5.inverse_kinematics(np.diag([1.0, 1.0, -1.0, 1.0]))
    with pytest.raises(ValueError, match="must be finite"):
        ur5.inverse_kinematics(np.full((4, 4), np.nan))
    with pytest.raises(ValueError, match=r"shape \(3, 4\)"):
        check_pose(np.eye(4)[:3])
    with pytest.raises(ValueError, match="six angles"):
        ur5.forward_kinematics(np.zeros(5))


def test_wrap_angle_keeps_pi_and_not_minus_pi() -> None:
    wrapped = ur5.wrap_angle(np.array([np.pi, -np.pi, 3 * np.pi, 0.5 - 4 * np.pi]))
    np.testing.assert_allclose(wrapped, [np.pi, np.pi, np.pi, 0.5], atol=1e-12)


def test_nearest_turns_stay_within_limits() -> None:
    current = np.array([6.0, -6.0, 3.0, 0, 0, 0])
    joints = np.array([[-0.2, 0.2, -3.1, 0, 0, 0]])
    nearest = ur5.nearest_turns(joints, current)[0]
    # joint 1 goes to 2 pi - 0.2, joint 2 to 0.2 - 2 pi; the elbow may not pass pi
    np.testing.assert_allclose(nearest[:3], [2 * np.pi - 0.2, 0.2 - 2 * np.pi, -3.1])


def test_outline_ends_at_the_flange_and_keeps_link_lengths() -> None:
    joints = Rotation.random(2, rng=np.random.default_rng(0)).as_rotvec().ravel()
    outline = ur5.link_outline(joints)
    np.testing.assert_allclose(outline[-1], ur5.forward_kinematics(joints)[:3, 3])
    lengths = np.linalg.norm(np.diff(outline, axis=0), axis=1)
    expected = [0.089159, 0.13585, 0.425, 0.1197, 0.39225, 0.093, 0.09465, 0.0823]
    np.testing.assert_allclose(lengths, expected, atol=1e-6)


def test_singular_value_is_the_smallest_stretch_of_the_jacobian() -> None:
    for change in ({2: 0.0}, {4: 0.0}):  # elbow stretched; wrist's axes parallel
        joints = HOME_JOINTS.copy()
        for index, angle in change.items():
            joints[index] = angle
        assert ur5.singularity(joints) == pytest.approx(0.0, abs=1e-9)
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
    assert ur5.singularity(HOME_JOINTS) == pytest.approx(expected, rel=1e-5)


def test_links_are_where_the_outline_says_and_go_with_the_tool() -> None:
    joints = np.deg2rad([6.0, -130, 121, 9, 96, 20])
    turn = ur5.BASE_LINK_FROM_DH_BASE[:3, :3]
    outline, links = ur5.link_outline(joints) @ turn.T, ur5.link_surfaces(joints)
    np.testing.assert_allclose(links[1:, :3], outline[1:8], atol=1e-12)
    np.testing.assert_allclose(links[:, 3:6], outline[1:9], atol=1e-12)
    flange = ur5.BASE_LINK_FROM_DH_BASE @ ur5.forward_kinematics(joints)
    for shift, angle, most in (
        ([0.03, 0.0, 0.0], 0.0, 1e-4), ([0.0, 0.05, 0.0], 0.2, 1e-4),
        ([0.06, -0.05, 0.06], 0.5, 1e-3),
    ):  # fmt: skip
        goal = flange.copy()
        goal[:3, :3] = Rotation.from_rotvec([0.0, angle, 0.0]).as_matrix() @ goal[:3, :3]
        goal[:3, 3] += shift
        found = ur5.inverse_kinematics(ur5.BASE_LINK_FROM_DH_BASE @ goal, joints[5])
        after = min(ur5.nearest_turns(found, joints), key=lambda q: np.abs(q - joints).max())
        guess = ur5.joints_toward(joints, goal @ np.linalg.inv(flange))
        off = ur5.link_surfaces(guess) - ur5.link_surfaces(after)
        assert np.abs(off).max() < most


def test_toward_what_is_out_of_reach_the_links_stay_finite() -> None:
    joints = np.deg2rad([6.0, -130, 121, 9, 96, 20])
    away = np.eye(4)
    away[:3, 3] = [1.5, 0, 0]
    links = ur5.link_surfaces(ur5.joints_toward(joints, away))
    assert np.isfinite(links).all()
    straight = np.zeros(6)  # singular: the arm is stretched
    assert np.isfinite(ur5.joints_toward(straight, away)).all()
