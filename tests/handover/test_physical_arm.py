"""The arm with mass: it arrives, it keeps its limits, it refuses nonsense, it yields to a hand."""

import numpy as np
import pytest

from hadr.handover.scenes import HeldScene, held_scene
from hadr.handover.world import World


@pytest.fixture(scope="module")
def scene() -> HeldScene:
    return held_scene("0000", 921)


def test_no_number_is_no_target_and_the_arm_does_not_move(scene: HeldScene) -> None:
    world = World(scene)
    before = world.robot.tool_pose()
    target = before.copy()
    target[0, 3] = np.nan
    with pytest.raises(ValueError, match="must be finite"):
        world.robot.servo_to(target, 0.02)
    world.step(0.2)
    np.testing.assert_allclose(world.robot.tool_pose(), before, atol=1e-4)
