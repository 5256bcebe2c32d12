"""The physics: weights, grips, what the hand feels, and that nothing is left to chance."""

import numpy as np
import pytest

from hadr.handover.object_parts import mass_properties
from hadr.handover.scenes import HeldScene, held_scene
from hadr.handover.world import World
from hadr.handover.world_state import WorldState


@pytest.fixture(scope="module")
def tumbler() -> HeldScene:
    return held_scene("0000", 921)


def drive(world: World, pose: np.ndarray, seconds: float) -> list[WorldState]:
    states = []
    for _ in range(round(seconds / 0.02)):
        world.robot.servo_to(pose, 0.02)
        world.step(0.02)
        states.append(world.state())
    return states


def test_the_hand_carries_the_object_at_rest(tumbler: HeldScene) -> None:
    world = World(tumbler)
    world.step(0.5)
    state = world.state()
    assert state.holder == "hand"
    np.testing.assert_allclose(state.base_from_wrist, tumbler.base_from_wrist, atol=2e-4)
    np.testing.assert_allclose(state.base_from_object, tumbler.base_from_object, atol=3e-3)
    np.testing.assert_allclose(world.keypoints(), tumbler.keypoints, atol=5e-4)


def test_the_grip_bears_the_weight_of_the_glass(tumbler: HeldScene) -> None:
    world = World(tumbler)
    world.step(0.6)
    free = world._model.joint("object").dofadr[0]
    # nothing else touches the object: the weld's force is mass times gravity, upward
    expected = [0.0, 0.0, 9.81 * mass_properties(tumbler.item).mass]
    np.testing.assert_allclose(world._data.qfrc_constraint[free : free + 3], expected, atol=0.01)


def test_same_commands_give_bitwise_equal_states(tumbler: HeldScene) -> None:
    runs = []
    for _ in range(2):
        world = World(tumbler)
        target = world.robot.tool_pose()
        target[0, 3] += 0.08
        runs.append(drive(world, target, 0.6)[-1])
    for name in ("joints", "base_from_wrist", "base_from_object"):
        np.testing.assert_array_equal(getattr(runs[0], name), getattr(runs[1], name))


def test_time_passes_in_whole_steps(tumbler: HeldScene) -> None:
    world = World(tumbler)
    world.step(0.02)
    assert world.time == pytest.approx(0.02)
    for dt in (0.0, -0.02, 0.003, np.nan):
        with pytest.raises(ValueError, match=r"multiple of 0\.002 seconds"):
            world.step(dt)
