"""The physics: weights, grips, and what the hand feels."""

from itertools import groupby

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hadr.camera import transform_points
from hadr.handover.grasping.grasps import forward_of
from hadr.handover.poses import pose_distance
from hadr.handover.simulated_ur5 import SimulatedUR5
from hadr.simulation.world.model import hand_capsules
from hadr.simulation.world.object_parts import mass_properties
from hadr.simulation.world.physics import HAND_STIFFNESS, World
from hadr.simulation.world.scenes import HeldScene, held_scene
from hadr.simulation.world.state import WorldState


def drive(world: World, pose: np.ndarray, seconds: float) -> list[WorldState]:
    states = []
    for _ in range(round(seconds / 0.02)):
        world.robot.servo_to(pose, 0.02)
        world.step(0.02)
        states.append(world.state())
    return states


def test_the_hand_carries_the_object_at_rest(scene: HeldScene) -> None:
    world = World(scene)
    world.step(0.5)
    state = world.state()
    assert state.holder == "hand"
    np.testing.assert_allclose(state.base_from_wrist, scene.base_from_wrist, atol=2e-4)
    np.testing.assert_allclose(state.base_from_object, scene.base_from_object, atol=3e-3)
    np.testing.assert_allclose(world.keypoints(), scene.keypoints, atol=5e-4)


def test_the_grip_bears_the_weight_of_the_glass(scene: HeldScene) -> None:
    world = World(scene)
    world.step(0.6)
    free = world._model.joint("object").dofadr[0]
    # nothing else touches the object: the weld's force is mass times gravity, upward
    expected = [0.0, 0.0, 9.81 * mass_properties(scene.item).mass]
    np.testing.assert_allclose(world._data.qfrc_constraint[free : free + 3], expected, atol=0.01)


def fork(tool: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Centre and half size, tool frame, of fingers at 85 mm and of the bar between them."""
    x = 0.0425 + 0.005
    return [
        (np.array([-x, 0, -0.03]), np.array([0.005, 0.01, 0.03])),
        (np.array([x, 0, -0.03]), np.array([0.005, 0.01, 0.03])),
        (np.array([0, 0, -0.07]), np.array([0.0525, 0.0125, 0.01])),
    ]


def test_distance_to_the_hand_against_points_on_its_bones(scene: HeldScene) -> None:
    world = World(scene)
    target = world.robot.tool_pose()
    target[:3, 3] = scene.keypoints[9] - [0.16, 0.0, 0.0]
    state = drive(world, target, 2.0)[-1]
    tool = world.robot.tool_pose()
    nearest = np.inf
    for _, start, end, radius in hand_capsules(scene):
        along = np.linspace(0, 1, 400)[:, None]
        points = transform_points(state.base_from_wrist, (1 - along) * start + along * end)
        local = transform_points(np.linalg.inv(tool), points)
        for middle, half in fork(tool):
            outside = np.maximum(np.abs(local - middle) - half, 0.0)
            nearest = min(nearest, np.linalg.norm(outside, axis=1).min() - radius)
    assert 0.02 < nearest < 0.2
    assert state.hand_distance == pytest.approx(nearest, abs=5e-4)


def swing(time: float) -> np.ndarray:
    """Five centimetres to the side and back in three seconds, and a turn about the vertical."""
    phase = (1 - np.cos(2 * np.pi * time / 3)) / 2
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("z", 0.1 * phase).as_matrix()
    pose[1, 3] = 0.05 * phase
    return pose


def test_the_hand_follows_its_path(scene: HeldScene) -> None:
    world = World(scene, swing)
    for _ in range(75):
        world.step(0.02)
        wanted = swing(world.time) @ scene.base_from_wrist
        distance, angle = pose_distance(world.state().base_from_wrist, wanted)
        assert distance < 0.004
        assert angle < np.deg2rad(2.0)
        wanted_points = transform_points(swing(world.time), scene.keypoints)
        np.testing.assert_allclose(world.keypoints(), wanted_points, atol=0.006)


def upper_part(scene: HeldScene) -> np.ndarray:
    """A tool pose around a tumbler's upper part, 20 degrees beside the way from the robot to it."""
    axis = scene.base_from_object[:3, 2]
    center = transform_points(scene.base_from_object, np.array([[0, 0, 0.85 * 0.106]]))[0]
    approach = center * [1, 1, 0]
    approach -= approach @ axis * axis
    approach = Rotation.from_rotvec(np.deg2rad(20) * axis).apply(approach)
    approach /= np.linalg.norm(approach)
    closing = np.cross(axis, approach)
    grasp = np.eye(4)
    grasp[:3, :3] = np.stack([closing, np.cross(approach, closing), approach], axis=1)
    grasp[:3, 3] = center
    return grasp


@pytest.mark.parametrize("aside", [0.0475, 0.0], ids=["one finger", "palm"])
def test_the_force_through_the_glass_is_what_the_hands_spring_bears(aside: float) -> None:
    """The gripper pushes the glass that the hand holds: the hand's way tells how hard."""
    scene = held_scene("0000", 925)
    world, grasp = World(scene), upper_part(scene)
    grasp[:3, 3] += aside * grasp[:3, 0]
    assert max(s.through_force for s in drive(world, forward_of(grasp, -0.1), 2.5)) == 0
    rest = world.keypoints().mean(axis=0)
    ahead = -0.1
    while drive(world, forward_of(grasp, ahead), 0.02)[-1].through_force < 2.0:
        ahead += 0.002
        assert ahead < 0.05
    for further, least in ((0.0, 0.5), (0.012, 2.5)):
        state = drive(world, forward_of(grasp, ahead + further), 1.0)[-1]
        assert (state.holder, state.hand_force) == ("hand", 0.0)
        borne = HAND_STIFFNESS * float(np.linalg.norm(world.keypoints().mean(axis=0) - rest))
        assert borne > least
        assert state.through_force == pytest.approx(borne, rel=0.01)


def test_the_hand_keeps_what_both_fingers_push_at_from_one_side() -> None:
    """Fingers 2 cm apart meet the front of a tumbler that is four times as wide."""
    scene = held_scene("0000", 925)
    world, grasp = World(scene), upper_part(scene)
    world.robot.set_gripper(0.02, 7.0)
    drive(world, forward_of(grasp, -0.1), 2.5)
    ahead = -0.1
    while drive(world, forward_of(grasp, ahead), 0.02)[-1].holder != "both":
        ahead += 0.002
        assert ahead < 0.05
    states = drive(world, forward_of(grasp, ahead + 0.01), 0.6)
    assert {state.holder for state in states[-15:]} == {"both"}


@pytest.fixture(scope="module")
def handed_over() -> tuple[World, list[WorldState], np.ndarray]:
    """A tumbler taken at its upper part, 20 degrees beside the way from the robot to it."""
    scene = held_scene("0000", 925)
    world, grasp = World(scene), upper_part(scene)
    states = drive(world, forward_of(grasp, -0.1), 2.5)
    for step in range(60):
        states += drive(world, forward_of(grasp, -0.1 + 0.002 * (step + 1)), 0.02)
    world.robot.set_gripper(0.055, 7.0)
    states += drive(world, forward_of(grasp, 0.02), 1.0)
    lifted = forward_of(grasp, 0.02)
    lifted[2, 3] += 0.1
    states += drive(world, lifted, 2.0)
    return world, states, lifted


Handed = tuple[World, list[WorldState], np.ndarray]


def test_the_hand_lets_go_after_a_tenth_of_a_second_of_both(handed_over: Handed) -> None:
    _, states, _ = handed_over
    holders = [state.holder for state in states]
    order = [key for key, _ in groupby(holders)]
    assert order == ["hand", "both", "gripper"]
    assert 5 <= holders.count("both") <= 7  # of 0.02 s each
    assert max(state.hand_force for state in states) < 9.0
    assert handed_over[0].robot.protective_stop == ""


def test_the_gripper_alone_carries_the_glass(handed_over: Handed) -> None:
    world, states, lifted = handed_over
    first = next(state for state in states if state.holder == "gripper")
    rise = states[-1].base_from_object[2, 3] - first.base_from_object[2, 3]
    assert rise == pytest.approx(0.1, abs=0.006)
    assert pose_distance(world.robot.tool_pose(), lifted)[0] < 0.002
    # it has not slipped within the last second
    before = states[-50].base_from_object
    assert pose_distance(before, states[-1].base_from_object)[0] < 0.001
    away = states[-1].base_from_wrist[:3, 3] - world.scene.base_from_wrist[:3, 3]
    assert np.linalg.norm(away) > 0.05  # the hand has opened and drawn back
    assert states[-1].opened.max() > 0
    after = [state for state in states if state.opened.any()]
    assert max(state.hand_force for state in after) == 0
    assert 0 < max(state.through_force for state in after) < 10  # the glass leaves the fingers


def test_open_fingers_drop_it_and_the_ground_bears_it(handed_over: Handed) -> None:
    world = handed_over[0]
    back = SimulatedUR5().tool_pose()  # over the robot's own table
    back[2, 3] = 0.2
    drive(world, back, 2.5)
    world.robot.set_gripper(0.085, 7.0)
    world.step(1.5)
    state = world.state()
    assert state.holder == "nobody"
    assert -0.001 < state.base_from_object[2, 3] < 0.05
    free = world._model.joint("object").dofadr[0]
    weight = 9.81 * mass_properties(world.scene.item).mass
    borne = []
    for _ in range(50):
        world.step(0.01)
        borne.append(world._data.qfrc_constraint[free + 2])
    assert np.mean(borne) == pytest.approx(weight, rel=0.05)


def test_time_passes_in_whole_steps(scene: HeldScene) -> None:
    world = World(scene)
    world.step(0.02)
    assert world.time == pytest.approx(0.02)
    for dt in (0.0, -0.02, 0.003, np.nan):
        with pytest.raises(ValueError, match=r"multiple of 0\.002 seconds"):
            world.step(dt)
