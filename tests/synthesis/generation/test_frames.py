"""One frame: what it depends on, and its labels."""

from dataclasses import replace

import numpy as np

from hadr.camera import back_project, transform_points
from hadr.synthesis.generation.frames import render_frame
from hadr.synthesis.generation.settings import GenerationSettings
from hadr.synthesis.glass.distance import signed_distance
from hadr.synthesis.glass.objects import glass_object

SIZE = GenerationSettings(width=64, height=36, quality="fast")


def test_another_seed_gives_other_frames():
    recipe = SIZE.recipe(0)
    first, other = (render_frame(recipe, replace(SIZE, seed=s)) for s in (0, 1))
    assert np.abs(first.depth - other.depth).mean() > 0.01


def test_two_frames_of_a_hold_share_the_hand_in_the_wrist_frame_only():
    one = replace(SIZE, objects=("0000",))
    a, b = (render_frame(one.recipe(i), one) for i in (0, 1))
    assert a.hold_id == b.hold_id
    lengths = [np.linalg.norm(f.keypoints - f.keypoints[0], axis=1) for f in (a, b)]
    np.testing.assert_allclose(lengths[0], lengths[1], atol=1e-9)
    assert np.abs(a.keypoints - b.keypoints).max() > 0.02


def test_size_changes_pixels_not_geometry():
    small = render_frame(SIZE.recipe(3), SIZE)
    large = render_frame(SIZE.recipe(3), replace(SIZE, width=128, height=72))
    np.testing.assert_allclose(small.keypoints, large.keypoints, atol=1e-12)
    np.testing.assert_array_equal(small.world_from_camera, large.world_from_camera)


def test_the_labels_of_a_frame_agree_with_each_other():
    frame = render_frame(SIZE.recipe(2), replace(SIZE, width=128, height=72))
    depth = np.where(frame.depth > 0, frame.depth, np.nan)
    points = back_project(depth, frame.camera)
    # Normals of unit length that face the camera.
    known = frame.normals.any(-1)
    assert known.all()
    np.testing.assert_allclose(np.linalg.norm(frame.normals[known], axis=-1), 1, atol=1e-5)
    assert ((frame.normals * points).sum(-1)[known] <= 1e-6).all()
    # The glass's points lie where the object's pose puts the object.
    camera_from_object = frame.camera_from_world @ frame.world_from_object
    local = transform_points(np.linalg.inv(camera_from_object), points[frame.object_mask])
    item = glass_object(frame.object_id)
    assert np.abs(signed_distance(item, local)).max() < 1e-3
