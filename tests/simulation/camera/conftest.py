"""One scene before the robot's camera, for all tests of what the camera sees."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from hadr.handover.simulated_ur5 import HOME_JOINTS
from hadr.simulation.camera.robot_camera import RobotCamera
from hadr.simulation.world.scenes import HeldScene, held_scene
from hadr.simulation.world.state import WorldState


@pytest.fixture(scope="module")
def scene() -> HeldScene:
    return held_scene("0000", 921)


@pytest.fixture(scope="module")
def camera() -> RobotCamera:
    return RobotCamera()


def _at(scene: HeldScene, time: float, **changed: Any) -> WorldState:
    state = WorldState(
        time=time,
        joints=HOME_JOINTS,
        gripper_width=0.085,
        base_from_wrist=scene.base_from_wrist,
        base_from_object=scene.base_from_object,
        holder="hand",
        hand_force=0.0,
        hand_distance=0.3,
    )
    return replace(state, **changed)


@pytest.fixture(scope="session")
def at() -> Callable[..., WorldState]:
    """Builds the state of a scene, with the robot at home, at a time; further values by name."""
    return _at
