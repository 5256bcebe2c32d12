import numpy as np
import pytest

from hadr.synthesis.scene.contents import Surroundings
from hadr.synthesis.scene.stage import Stage


def corner_colours(around: Surroundings, point):
    """Texture coordinates at a point on a quad, by the triangle that holds it."""
    for face in around.surface.faces:
        a, b, c = around.surface.vertices[face]
        weights = np.linalg.lstsq(
            np.stack([a, b, c]).T.copy(), np.asarray(point, dtype=float), rcond=None
        )[0]
        if abs(weights.sum() - 1) < 1e-9 and (weights > -1e-9).all():
            return weights @ around.uv[face]
    raise AssertionError(f"no face holds {point}")


def test_a_quads_picture_runs_right_and_down():
    stage = Stage()
    right, down = np.array([2.0, 0, 0]), np.array([0, 0, -1.0])
    stage.quad(np.array([-1, 2, 3.0]), right, down, 0, 0.5, np.zeros(2))
    around = stage.surroundings()
    np.testing.assert_allclose(corner_colours(around, [-1, 2, 3]), [0, 0], atol=1e-9)
    # Half a metre is one repeat: two metres to the right are four, one metre down is two.
    np.testing.assert_allclose(corner_colours(around, [1, 2, 2]), [4, 2], atol=1e-9)
    np.testing.assert_allclose(around.surface.normals[0], [0, -1, 0], atol=1e-12)


def test_each_second_repeat_is_mirrored():
    stage = Stage()
    right, down = np.array([3.0, 0, 0]), np.array([0, 0, -1.0])
    stage.mirrored(np.array([0, 2, 1.0]), right, down, 0, 1.0, 0.0)
    around = stage.surroundings()
    assert len(around.surface.faces) == 6
    for x, u in ((0.25, 0.25), (0.75, 0.75), (1.25, 0.75), (1.75, 0.25), (2.25, 0.25)):
        found = corner_colours(around, [x, 2, 0.4])
        np.testing.assert_allclose(found, [u, 0.6], atol=0.005)


def test_a_box_is_closed_and_faces_outward():
    stage = Stage()
    pose = np.eye(4)
    pose[:3, 3] = (0.2, 0.1, 2.0)
    stage.box(pose, np.array([0.1, 0.2, 0.3]), 0, 0.5, np.zeros(2))
    surface = stage.surroundings().surface
    a, b, c = (surface.vertices[surface.faces[:, i]] for i in range(3))
    volume = np.einsum("ij,ij->i", a - pose[:3, 3], np.cross(b - pose[:3, 3], c - pose[:3, 3]))
    assert volume.sum() / 6 == pytest.approx(8 * 0.1 * 0.2 * 0.3)
    assert (volume > 0).all()
    np.testing.assert_allclose(np.abs(surface.vertices - pose[:3, 3]).max(0), [0.1, 0.2, 0.3])
    outward = ((surface.vertices - pose[:3, 3]) * surface.normals).sum(1)
    assert (outward > 0).all()
