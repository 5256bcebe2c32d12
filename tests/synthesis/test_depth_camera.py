import numpy as np
import pytest
import trimesh

from hadr.camera import Intrinsics
from hadr.synthesis.depth_camera import StereoCamera, capture_depth
from hadr.synthesis.hand_mesh import HandMesh
from hadr.synthesis.raycast import Surroundings
from hadr.synthesis.scene import Scene
from hadr.synthesis.shading import RayScene
from hadr.synthesis.surfaces import Surface

COLOR = Intrinsics(285.0, 285.0, 127.5, 71.5, 256, 144)
CAMERA = StereoCamera()


def rectangle(corner, along, down) -> Surroundings:
    corners = np.array([corner, corner + along, corner + along + down, corner + down])
    normal = np.cross(down, along)
    normal /= np.linalg.norm(normal)
    surface = Surface(corners, np.array([[0, 1, 2], [0, 2, 3]]), np.tile(normal, (4, 1)))
    uv = np.array([[0, 0], [1.0, 0], [1, 1], [0, 1]])
    return Surroundings(surface, uv, np.full(2, 3), np.ones((2, 3)), np.ones(2))


def wall(z: float, slope: float = 0.0) -> Surroundings:
    return rectangle(
        np.array([-2.0, -2.0, z - 2 * slope]), np.array([4.0, 0, 4 * slope]), np.array([0, 4.0, 0])
    )


def opaque(mesh: trimesh.Trimesh) -> HandMesh:
    surface = Surface(
        np.asarray(mesh.vertices), np.asarray(mesh.faces), np.asarray(mesh.vertex_normals)
    )
    count = len(mesh.vertices)
    return HandMesh(surface, np.full((count, 3), 0.5), np.zeros(count))


def box(low, high) -> trimesh.Trimesh:
    low, high = np.asarray(low, float), np.asarray(high, float)
    mesh = trimesh.creation.box(high - low)
    mesh.apply_translation((low + high) / 2)
    mesh.unmerge_vertices()
    return mesh


def glass_box(low, high) -> Surface:
    mesh = box(low, high)
    normals = np.repeat(np.asarray(mesh.face_normals), 3, axis=0)
    return Surface(np.asarray(mesh.vertices), np.asarray(mesh.faces), normals)


def scene(hand=None, glass=(), around=None) -> Scene:
    rays = RayScene(hand, tuple(glass), surroundings=around)
    nothing = np.zeros((21, 3))
    return Scene(rays, COLOR, np.eye(4), nothing, np.zeros((22, 3)), np.eye(4), None)


def sigma_z(z: float) -> float:
    """Depth error of a tenth of a pixel of disparity, metres."""
    return z**2 / (CAMERA.focal * CAMERA.baseline) * 0.1


@pytest.mark.parametrize("z", [0.5, 0.9])
def test_a_wall_is_measured_to_a_fraction_of_a_pixel_of_disparity(z):
    raw = capture_depth(scene(around=wall(z)), 0)
    assert raw.shape == COLOR.shape
    assert raw.dtype == np.float32
    seen = raw > 0
    assert seen.mean() > 0.85
    error = raw[seen] - z
    assert abs(np.median(error)) < sigma_z(z)
    assert np.median(np.abs(error)) < 2 * sigma_z(z)
    np.testing.assert_allclose(raw * 1000, np.rint(raw * 1000), atol=1e-3)
