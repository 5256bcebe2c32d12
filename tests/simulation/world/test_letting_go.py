"""Letting go: fingers that open, a hand that touches the glass, a hold that is torn."""

import mujoco
import numpy as np
import pytest

from hadr.hand import ANGLE_NAMES
from hadr.simulation.robot.arm_model import HAND, OBJECT
from hadr.simulation.world.letting_go import (
    DIRECTIONS,
    IN_THE_HOLLOW,
    pose_hand,
    touch_object,
    way_off,
)
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
        kinds = np.array(world._kinds)[data.contact.geom].reshape(-1, 2)
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


def gripper_at(scene: HeldScene, place: np.ndarray) -> World:
    """A world whose tool has gone to a place (3,), base frame, and whose hand may touch."""
    world = World(scene)
    target = world.robot.tool_pose()
    target[:3, 3] = place
    for _ in range(150):
        world.robot.servo_to(target, 0.02)
        world.step(0.02)
    touch_object(*world.physics)
    return world


def gap(world: World, shapes: list[int], others: list[int]) -> float:
    model, data = world.physics
    mujoco.mj_kinematics(model, data)
    pairs = [(int(a), int(b)) for a in shapes for b in others]
    return min(mujoco.mj_geomDistance(model, data, *pair, 0.1, None) for pair in pairs)


def test_a_finger_stops_before_the_gripper_and_the_others_do_not() -> None:
    scene = held_scene("0012", 905)  # a coupe's stem in a fist
    world = gripper_at(scene, scene.opened(np.full(5, 1.0)).keypoints[8])  # the index's way
    model, data = world.physics
    before = model.geom_pos.copy(), model.geom_quat.copy(), data.qpos.copy()
    shares, direction = way_off(model, data, scene, world._near)
    after = model.geom_pos, model.geom_quat, data.qpos
    for was, now in zip(before, after, strict=True):  # it looks at copies
        np.testing.assert_array_equal(was, now)
    finger = int(shares.argmin())
    assert sorted(shares)[0] < sorted(shares)[1] == shares.max()
    assert np.linalg.norm(direction) == pytest.approx(1)
    first, steps = 4 * finger + 1, round(10 * shares[finger])
    bones = [model.geom(f"bone_{a}_{a + 1}").id for a in range(first, first + 3)]
    gaps = []
    for step in range(1, steps + 2):
        pose_hand(model, scene.opened(np.full(5, step / 10)))
        gaps.append(gap(world, bones, world._near))
    assert min(gaps[:-1]) > 0.002
    assert gaps[-1] < 0.004


@pytest.mark.parametrize(("object_id", "hold"), [("0004", 901), ("0000", 902)])
def test_the_hand_goes_where_it_touches_least(object_id: str, hold: int) -> None:
    scene = held_scene(object_id, hold)
    world = World(scene)
    model, data = world.physics
    touch_object(model, data)
    shares, chosen = way_off(model, data, scene, world._near)
    parts = np.flatnonzero(model.geom_bodyid == world._object)
    start = model.joint("hand").qposadr[0]
    place, rotation = data.qpos[start : start + 3].copy(), scene.base_from_wrist[:3, :3]
    pose_hand(model, scene.opened(shares))

    def clear(direction: np.ndarray) -> float:
        least = np.inf
        for back in np.linspace(0.01, 0.15, 15):
            data.qpos[start : start + 3] = place + back * direction
            least = min(least, gap(world, world._skin, parts))
        return least

    best = max(clear(rotation @ way) for way in DIRECTIONS)
    assert min(clear(chosen), 0.003) > min(best, 0.003) - 0.002  # it looks at fewer places
    assert clear(rotation[:, 1]) < clear(chosen) - 0.005  # on along the forearm, into the glass


def test_a_finger_that_has_left_the_box_in_which_it_was_compiled_collides() -> None:
    scene = held_scene("0004", 901)
    world = World(scene)
    model, data = world.physics
    opened = scene.opened(np.full(5, 1.0))
    pose_hand(model, opened)
    world.step(0.002)
    # the middle between the pads to where the index finger's tip is now
    target = world.robot.tool_pose()
    target[:3, 3] = opened.keypoints[8] - 0.03 * target[:3, 2]
    for _ in range(100):
        world.robot.servo_to(target, 0.02)
        world.step(0.02)
    shape = model.geom("bone_7_8").id
    met = data.contact.geom[: data.ncon]
    assert gap(world, [shape], world._near) < 0.06
    target[:3, 3] = opened.keypoints[8]
    target[:3, 3] += (0.0425 + 0.005) * target[:3, 0] + 0.01 * target[:3, 2]
    forces = []
    for _ in range(100):
        world.robot.servo_to(target, 0.02)
        world.step(0.02)
        met = data.contact.geom[: data.ncon]
        forces.append(bool((met == shape).any()))
    assert any(forces)


def test_what_a_hold_bears_is_about_the_middle_of_the_fingertips() -> None:
    scene = held_scene("0001", 904)  # by the stem
    world = World(scene)
    model, data = world.physics
    data.xfrc_applied[world._object, :3] = [0.0, 2.0, 0.0]  # at the glass's centre of mass
    for _ in range(50):
        world.step(0.02)
    weight = 9.81 * model.body("object").mass[0]
    force = np.array([0.0, 2.0, -weight])
    tips = world.keypoints()[[4, 8, 12, 16, 20]].mean(axis=0)
    torque = np.cross(data.xipos[world._object] - tips, force)
    assert np.linalg.norm(torque) > 0.1  # a lever of centimetres
    expected = pytest.approx((np.linalg.norm(force), np.linalg.norm(torque)), rel=0.03)
    assert world._hold_bears() == expected
