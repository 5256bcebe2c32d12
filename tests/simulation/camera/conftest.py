"""One scene before the robot's camera, for all tests of what the camera sees."""

import pytest

from hadr.simulation.camera.robot_camera import RobotCamera
from hadr.simulation.world.scenes import HeldScene, held_scene


@pytest.fixture(scope="module")
def scene() -> HeldScene:
    return held_scene("0000", 921)


@pytest.fixture(scope="module")
def camera() -> RobotCamera:
    return RobotCamera()
