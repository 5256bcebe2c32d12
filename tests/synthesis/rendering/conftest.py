import numpy as np
import pytest
import trimesh

from hadr.synthesis.generation.frames import build_scene
from hadr.synthesis.generation.settings import GenerationSettings
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


@pytest.fixture(scope="session")
def pane():
    """Make a pane of glass six metres wide between two depths, metres."""

    def make(near, far) -> Surface:
        mesh = trimesh.creation.box(bounds=[[-3, -3, near], [3, 3, far]])
        mesh.unmerge_vertices()
        normals = np.repeat(np.asarray(mesh.face_normals), 3, axis=0)
        return Surface(np.asarray(mesh.vertices), np.asarray(mesh.faces), normals)

    return make


@pytest.fixture(scope="session")
def scene():
    """A hold that is made from the seed, before the camera, 160 x 90 pixels."""
    settings = GenerationSettings(width=160, height=90, quality="fast")
    return build_scene(settings.recipe(0), settings)
