from dataclasses import replace

import numpy as np

from hadr.camera import Intrinsics, ray_directions
from hadr.synthesis.rendering.shading import RayTracer
from hadr.synthesis.scene.contents import Contents

CAMERA = Intrinsics(200.0, 210.0, 60.3, 40.7, 128, 80)


def test_a_flat_pane_shifts_rays_but_does_not_bend_them(plane, pane):
    """Through a pane of glass a ray goes on in its old direction: the picture stays, but dimmer."""
    wall = plane([0, 0, 1.0], 1.0)
    with_pane = RayTracer(Contents(None, (pane(0.5, 0.52),), (1.0, 1.0, 1.0), wall))
    bare = RayTracer(Contents(None, (), surroundings=wall))
    d = ray_directions(CAMERA).reshape(-1, 3)
    eye = np.zeros_like(d)
    seen, direct = with_pane.radiance(eye, d, 0.005), bare.radiance(eye, d, 0.005)
    ratio = np.median(seen / np.maximum(direct, 1e-6))
    assert 0.85 < ratio < 1.1
    assert np.corrcoef(seen.ravel(), direct.ravel())[0, 1] > 0.97


def test_a_picture_shows_glass_hand_and_surroundings(scene):
    view = scene.camera, scene.world_from_camera
    picture = RayTracer(scene.contents).picture(*view)
    assert picture.shape == (90, 160, 3)
    assert picture.dtype == np.uint8
    assert 40 < picture.mean() < 220
    assert picture.std() > 10
    labels = RayTracer(scene.contents).labels(*view)
    bare = RayTracer(replace(scene.contents, glass=())).picture(*view)
    np.testing.assert_array_equal(picture[~labels.object_mask], bare[~labels.object_mask])
    changed = np.abs(picture.astype(int) - bare.astype(int)).sum(-1)[labels.object_mask]
    assert (changed > 12).mean() > 0.5
