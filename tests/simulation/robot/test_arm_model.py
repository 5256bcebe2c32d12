"""The MuJoCo model of the arm against the DH product, the published masses and the gripper."""

import mujoco
import numpy as np
import pytest

from hadr.handover import ur5
from hadr.handover.grasping.gripper import FLANGE_FROM_TOOL
from hadr.handover.simulated_ur5 import HOME_JOINTS, SimulatedUR5
from hadr.simulation.robot import arm_model


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return arm_model.kinematic_model()


def posed(model: mujoco.MjModel, joints: np.ndarray) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:] = joints
    mujoco.mj_kinematics(model, data)
    return data


def test_tool_site_equals_the_dh_product(model: mujoco.MjModel) -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        joints = rng.uniform(ur5.JOINT_LOWER, ur5.JOINT_UPPER)
        site = posed(model, joints).site("tool")
        flange = ur5.BASE_LINK_FROM_DH_BASE @ ur5.forward_kinematics(joints)
        expected = flange @ FLANGE_FROM_TOOL
        np.testing.assert_allclose(site.xpos, expected[:3, 3], atol=1e-5)
        np.testing.assert_allclose(site.xmat.reshape(3, 3), expected[:3, :3], atol=1e-5)


def test_links_run_along_the_outline(model: mujoco.MjModel) -> None:
    joints = np.array([0.4, -1.1, 1.3, -0.5, 0.9, 0.2])
    data = posed(model, joints)
    outline = ur5.link_outline(joints) @ ur5.BASE_LINK_FROM_DH_BASE[:3, :3].T
    # upper arm from point 2 to point 3, forearm's last capsule from point 4 to point 5
    for name, start in (("upper_arm", 2), ("forearm_1", 4)):
        middle = (outline[start] + outline[start + 1]) / 2
        np.testing.assert_allclose(data.geom(name).xpos, middle, atol=1e-9)
        half = np.linalg.norm(outline[start + 1] - outline[start]) / 2
        assert model.geom(name).size[1] == pytest.approx(half, abs=1e-9)
    points = [i for i in range(model.nsite) if "_point_" in model.site(i).name]
    np.testing.assert_allclose(data.site_xpos[points], outline[3:], atol=1e-9)


def test_masses_and_limits_are_the_published_ones(model: mujoco.MjModel) -> None:
    masses = [model.body(name).mass[0] for name in arm_model.LINKS]
    np.testing.assert_allclose(masses, [3.7, 8.393, 2.33, 1.219, 1.219, 0.1879], atol=1e-9)
    np.testing.assert_allclose(model.jnt_range, np.c_[ur5.JOINT_LOWER, ur5.JOINT_UPPER])


def test_fingers_stand_where_the_grasp_checks_expect_them(model: mujoco.MjModel) -> None:
    tool = SimulatedUR5().tool_pose()
    data = posed(model, HOME_JOINTS)
    for name, side in (("left_finger", -1), ("right_finger", 1)):
        place = tool[:3, :3].T @ (data.geom(name).xpos - tool[:3, 3])
        # 85 mm between the pads, 1 cm thick, from the fingertips 6 cm back
        np.testing.assert_allclose(place, [side * (0.0425 + 0.005), 0.0, -0.03], atol=1e-9)
        np.testing.assert_allclose(model.geom(name).size, [0.005, 0.01, 0.03])


def test_gravity_needs_no_torque() -> None:
    spec = mujoco.MjSpec()
    arm_model.add_arm(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:6] = HOME_JOINTS
    mujoco.mj_forward(model, data)
    # what is left of gravity after its compensation, in newton metres
    assert np.abs(data.qfrc_bias[:6] - data.qfrc_passive[:6]).max() < 1e-9
    assert np.abs(data.qfrc_gravcomp[:6]).max() > 10.0
