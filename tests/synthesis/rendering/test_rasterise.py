"""The OpenGL preview agrees with the ray caster, or says what it lacks."""

import numpy as np
import pytest

from hadr.camera import Intrinsics, ray_directions
from hadr.synthesis.generation.generate import build_scene, frame_recipe
from hadr.synthesis.glass.surfaces import Surface
from hadr.synthesis.rendering.rasterise import rasterise
from hadr.synthesis.rendering.raycast import RayCaster


def test_the_preview_agrees_with_the_ray_caster_or_says_what_is_missing():
    scene = build_scene(frame_recipe(0), 0, 96, 54, "fast")
    try:
        color, depth = rasterise(scene.rays, scene.camera, scene.world_from_camera)
    except RuntimeError as error:
        assert "No OpenGL here: install" in str(error)  # noqa: PT017
        assert "hadr generate" in str(error)  # noqa: PT017
        pytest.skip("no OpenGL: the preview's picture can't be compared with the ray caster's")
    exact = scene.rays.labels(scene.camera, scene.world_from_camera)
    assert color.shape == (54, 96, 3)
    assert (np.abs(depth - exact.depth) < 5e-4).mean() > 0.98  # outlines aside
    assert np.median(np.abs(depth - exact.depth)) < 5e-5


def test_the_depth_of_a_steep_plane_is_that_of_the_pixel_centres():
    """80 degrees of slant: a fifth of a pixel beside the centre would be off by millimetres."""
    camera = Intrinsics(100.0, 100.0, 31.5, 23.5, 64, 48)
    slant = np.deg2rad(80.0)
    normal = np.array([np.sin(slant), 0.0, np.cos(slant)])
    along = np.array([np.cos(slant), 0.0, -np.sin(slant)])
    up = np.array([0.0, 1.0, 0.0])
    corners = [0.2 * normal + a * along + b * up for a, b in ((-3, -3), (3, -3), (3, 3), (-3, 3))]
    # One of the triangles looks away.
    face = Surface(np.array(corners), np.array([[0, 1, 2], [0, 3, 2]]), np.tile(-normal, (4, 1)))
    try:
        _, depth = rasterise(RayCaster(None, (face,)), camera, np.eye(4))
    except RuntimeError as error:
        pytest.skip(f"{error}; on Debian: apt install libegl1 libgl1-mesa-dri")
    d = ray_directions(camera)
    exact = 0.2 / (d @ normal) * d[..., 2]
    seen = (exact > 0.06) & (exact < 1.5)
    assert seen.mean() > 0.4
    # By one pixel the plane recedes by this much:
    step = np.abs(np.diff(exact, axis=1))[seen[:, 1:] & seen[:, :-1]]
    assert np.median(step) > 0.002
    np.testing.assert_allclose(depth[seen], exact[seen], rtol=1e-5)
