"""A scene, the robot's camera, and states of a scene with the robot at home."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from hadr.handover.simulated_ur5 import HOME_JOINTS
from hadr.simulation.camera.robot_camera import RobotCamera
from hadr.simulation.world.scenes import HeldScene, held_scene
from hadr.simulation.world.state import WorldState


@pytest.fixture(scope="session")
def scene() -> HeldScene:
    """A tumbler that is held out."""
    return held_scene("0000", 921)


@pytest.fixture(scope="session")
def camera() -> RobotCamera:
    return RobotCamera()


@pytest.fixture(scope="session")
def at() -> Callable[..., WorldState]:
    """Builds the state of a scene, with the robot at home, at a time; further values by name."""

    def at(scene: HeldScene, time: float, **changed: Any) -> WorldState:
        held = scene.base_from_wrist, scene.base_from_object, "hand"
        return replace(WorldState(time, HOME_JOINTS, 0.085, *held, 0.0, 0.3), **changed)

    return at
