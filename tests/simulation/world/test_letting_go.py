"""Letting go: fingers that open, a hand that touches the glass, a hold that is torn."""

import mujoco
import numpy as np
import pytest

from hadr.hand import ANGLE_NAMES
from hadr.simulation.robot.arm_model import HAND, OBJECT
from hadr.simulation.world.letting_go import IN_THE_HOLLOW, pose_hand, touch_object, way_off
from hadr.simulation.world.model import hand_capsules
from hadr.simulation.world.physics import HOLD_FORCE, HOLD_TORQUE, World
from hadr.simulation.world.scenes import HeldScene, held_scene

STRETCHED = np.array(["stretch" in name for name in ANGLE_NAMES])


def test_a_finger_opens_alone_and_bones_keep_their_lengths(scene: HeldScene) -> None:
    assert scene.opened(np.zeros(5)) is scene
    index = scene.opened(np.array([0, 1, 0, 0, 0.0]))
    held, angles = scene.hold.angles, index.hold.angles
    np.testing.assert_array_equal(np.delete(angles, range(4, 8)), np.delete(held, range(4, 8)))
    assert (angles[5:8] <= 0).all()
    half = scene.opened(np.full(5, 0.5)).hold.angles[STRETCHED]
    bent = held[STRETCHED] > 0
    np.testing.assert_allclose(half[bent], held[STRETCHED][bent] / 2)
    for (_, a, b, _), (_, c, d, _) in zip(hand_capsules(scene), hand_capsules(index), strict=True):
        assert np.linalg.norm(b - a) == pytest.approx(np.linalg.norm(d - c))


def test_shapes_of_the_model_go_where_the_fingers_are(scene: HeldScene) -> None:
    world, opened = World(scene), scene.opened(np.full(5, 1.0))
    model, data = world.physics
    pose_hand(model, opened)
    mujoco.mj_kinematics(model, data)
    for name, start, end, _ in hand_capsules(opened):
        geom = data.geom(name)
        axis = geom.xmat.reshape(3, 3)[:, 2]
        middle = scene.base_from_wrist @ [*(start + end) / 2, 1]
        np.testing.assert_allclose(geom.xpos, middle[:3], atol=1e-6)
        assert abs(axis @ scene.base_from_wrist[:3, :3] @ (end - start)) == pytest.approx(
            np.linalg.norm(end - start)
        )


def torn_by(scene: HeldScene, force: np.ndarray) -> tuple[World, str]:
    """Pull at the glass for half a second; the hand's own arm does not give way."""
    world = World(scene)
    _, data = world.physics
    world.step(0.1)
    rest = world.state().base_from_object[:3, 3]
    data.xfrc_applied[world._object] = force
    for _ in range(25):
        world.step(0.02)
        if world.torn:
            data.xfrc_applied[world._object] = 0
    data.xfrc_applied[world._object] = 0
    world.step(0.2)
    fallen = rest[2] - world.state().base_from_object[2, 3]
    return world, "fallen" if fallen > 0.02 else "held"


def test_a_hold_is_torn_by_more_than_it_bears_and_the_glass_falls() -> None:
    scene = held_scene("0001", 904)  # by the stem, from aside
    up = np.array([0, 0, 1.0, 0, 0, 0])
    weight = 9.81 * World(scene).physics[0].body("object").mass[0]
    world, end = torn_by(scene, up * (0.8 * HOLD_FORCE + weight))
    assert (world.torn, end, world.holder()) == (False, "held", "hand")
    world, end = torn_by(scene, up * (1.5 * HOLD_FORCE + weight))
    assert (world.torn, end, world.holder()) == (True, "fallen", "nobody")
    assert world.state().opened.any()
    turn = np.array([0, 0, 0, 0, 0, 1.0])
    assert not torn_by(scene, 0.7 * HOLD_TORQUE * turn)[0].torn
    assert torn_by(scene, 1.5 * HOLD_TORQUE * turn)[0].torn


def test_hand_and_glass_touch_only_once_it_has_let_go() -> None:
    def touches(world: World) -> int:
        _, data = world.physics
        kinds = world._kinds[data.contact.geom].reshape(-1, 2)
        return int(((kinds[:, 0] | kinds[:, 1]) == HAND | OBJECT).sum())

    scene = held_scene("0004", 901)  # a fist
    world = World(scene)
    world.step(0.02)
    assert touches(world) == 0
    model, data = world.physics
    touch_object(model, data)
    mujoco.mj_step(model, data)
    assert touches(world) > 0


def test_fingers_in_a_hollow_do_not_meet_its_solid_stand_in() -> None:
    scene = held_scene("0012", 901)  # fingers in a coupe
    world = World(scene)
    model, data = world.physics
    touch_object(model, data)
    parts = np.flatnonzero(model.geom_bodyid == world._object)
    depths = {
        int(shape): min(mujoco.mj_geomDistance(model, data, shape, p, 0.1, None) for p in parts)
        for shape in world._skin
    }
    inside = {shape for shape, depth in depths.items() if depth < -IN_THE_HOLLOW}
    assert inside
    free = {shape for shape in depths if not model.geom_conaffinity[shape] & OBJECT}
    assert free == inside


def test_a_finger_stops_before_the_gripper_and_the_others_do_not() -> None:
    scene = held_scene("0012", 905)  # a coupe's stem in a fist
    world = World(scene)
    model, data = world.physics
    target = world.robot.tool_pose()  # two centimetres before where the index finger would end
    target[:3, 3] = scene.opened(np.full(5, 1.0)).keypoints[8] - 0.02 * target[:3, 2]
    for _ in range(150):
        world.robot.servo_to(target, 0.02)
        world.step(0.02)
    touch_object(model, data)
    shares, direction = way_off(model, data, scene, world._near)
    finger = int(shares.argmin())
    assert sorted(shares)[0] < sorted(shares)[1] == 1.0
    assert np.linalg.norm(direction) == pytest.approx(1)
    # on copies: nothing has moved
    np.testing.assert_allclose(world.state().base_from_wrist, scene.base_from_wrist, atol=5e-3)
    first = 4 * finger + 1
    bones = [model.geom(f"bone_{a}_{a + 1}").id for a in range(first, first + 3)]

    def gap(share: float) -> float:
        pose_hand(model, scene.opened(np.full(5, share)))
        mujoco.mj_kinematics(model, data)
        pairs = [(int(a), int(b)) for a in bones for b in world._near]
        return min(mujoco.mj_geomDistance(model, data, *pair, 0.1, None) for pair in pairs)

    steps = round(10 * shares[finger])
    assert all(gap(step / 10) > 0.002 for step in range(1, steps + 1))
    assert gap((steps + 1) / 10) < 0.004
