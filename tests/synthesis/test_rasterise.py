"""The OpenGL preview agrees with the ray caster, or says what it lacks."""

import numpy as np
import pytest
from scipy.ndimage import maximum_filter, minimum_filter

from hadr.synthesis.generate import build_scene, frame_recipe
from hadr.synthesis.rasterise import rasterise


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
    # The depth is that of a point within the pixel: between the neighbours' depths.
    low = minimum_filter(exact.depth, 3) - 1e-3
    high = maximum_filter(exact.depth, 3) + 1e-3
    assert ((depth >= low) & (depth <= high)).mean() > 0.985
    assert np.median(np.abs(depth - exact.depth)) < 0.006
