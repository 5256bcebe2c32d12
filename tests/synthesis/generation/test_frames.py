"""One frame: what it depends on, and its labels."""

import importlib.util
import os
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from hadr.camera import back_project, transform_points
from hadr.synthesis.generation.frames import live_picture, render_frame
from hadr.synthesis.generation.settings import GenerationSettings
from hadr.synthesis.glass.distance import signed_distance
from hadr.synthesis.glass.objects import glass_object
from hadr.synthesis.rendering.child_process import call_in_child

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


def test_a_live_picture_is_made_in_a_child_process(monkeypatch):
    pytest.importorskip("mitsuba", reason="path-traced pictures need hadr[generate]")
    traced = replace(SIZE, engine="photo")
    recipe, stored, fresh = traced.recipe(5), np.zeros((2, 2, 3), np.uint8), np.ones((2, 2, 3))

    def child(function, *args, timeout):
        assert (function, args) == (render_frame, (recipe, traced))
        return SimpleNamespace(color=fresh, hold_id="0007-rim-0000")

    monkeypatch.setattr("hadr.synthesis.generation.frames.call_in_child", child)
    color, title, sentence = live_picture(recipe, traced, stored)
    assert color is fresh
    assert (title, sentence) == ("traced just now: 0007-rim-0000", "")


def test_a_stored_picture_stands_where_none_can_be_made(monkeypatch):
    def child(*args, **options):
        return call_in_child(os.abort, timeout=60)

    find, stored = importlib.util.find_spec, np.zeros((2, 2, 3), np.uint8)
    for missing in (set(), {"mitsuba"}):
        with monkeypatch.context() as patch:
            patch.setattr("hadr.synthesis.generation.frames.call_in_child", child)
            patch.setattr(
                importlib.util,
                "find_spec",
                lambda name, *a, missing=missing: None if name in missing else find(name, *a),
            )
            made = live_picture(SIZE.recipe(5), replace(SIZE, engine="photo"), stored)
        assert made[0] is stored
        if missing or not find("mitsuba"):
            assert made[1:] == ("a stored picture (Mitsuba is not installed here)", "")
        else:
            why = "No picture could be traced here: its process was ended by SIGABRT"
            assert made[1] == "a stored picture"
            assert made[2].startswith(why)
