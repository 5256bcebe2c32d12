"""The state of a scene with the robot at home, for all tests of what is seen of it."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from hadr.handover.simulated_ur5 import HOME_JOINTS
from hadr.simulation.world.scenes import HeldScene
from hadr.simulation.world.state import WorldState


@pytest.fixture(scope="session")
def at() -> Callable[..., WorldState]:
    """Builds the state of a scene, with the robot at home, at a time; further values by name."""

    def at(scene: HeldScene, time: float, **changed: Any) -> WorldState:
        held = scene.base_from_wrist, scene.base_from_object, "hand"
        return replace(WorldState(time, HOME_JOINTS, 0.085, *held, 0.0, 0.3), **changed)

    return at
