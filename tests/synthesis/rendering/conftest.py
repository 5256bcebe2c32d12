import numpy as np
import pytest

from hadr.synthesis.glass.surfaces import Surface
from hadr.synthesis.scene.contents import Surroundings


@pytest.fixture(scope="session")
def plane():
    """Make a white wall: its normal, how far it is along that in metres, and its half width."""

    def make(normal, distance, reach=20.0) -> Surroundings:
        normal = np.asarray(normal, dtype=float) / np.linalg.norm(normal)
        x = np.cross([0, 1.0, 0], normal)
        x /= np.linalg.norm(x)
        y = np.cross(normal, x)
        corners = distance * normal + reach * np.array([-x - y, x - y, x + y, -x + y])
        surface = Surface(corners, np.array([[0, 1, 2], [0, 2, 3]]), np.tile(-normal, (4, 1)))
        return Surroundings(surface, corners[:, :2], np.zeros(2, int), np.ones((2, 3)), np.ones(2))

    return make
