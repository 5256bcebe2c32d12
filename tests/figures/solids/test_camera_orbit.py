from dataclasses import replace

import numpy as np
import pytest
import trimesh

from hadr.camera import project, transform_points
from hadr.figures.solids.camera_orbit import (
    BEHIND_GLASS,
    FEATURES,
    HIDDEN,
    IN_VIEW,
    change_of,
    keypoints_seen,
    orbit,
    orbit_features,
    orbit_picture,
    point_on_glass,
)
from hadr.figures.solids.turntable import HandOnGlass
from hadr.hand import FINGERS, forward_kinematics
from hadr.ray_voxels import VoxelGrid
from hadr.synthesis.glass.surfaces import Surface

TURNS = [0.0, 60.0, 90.0]


def box(low, high):
    """A closed box; its normals are of no interest here."""
    made = trimesh.creation.box(bounds=[low, high])
    return Surface(made.vertices, made.faces, made.vertex_normals)


@pytest.fixture(scope="module")
def scene():
    """A flat hand in the plane x = 0, its flesh a plate of 2 cm; a glass beside it at x > 0.

    The first camera stands on the x axis, in front of the glass.
    """
    joints = forward_kinematics(np.zeros(20)).joints
    joints = joints[:, [2, 0, 1]] * [0.0, 1.0, 1.0]  # flat, fingers along z
    hand = box([-0.01, -0.12, -0.02], [0.01, 0.12, 0.22])
    glass = box([0.03, -0.03, 0.10], [0.05, 0.03, 0.20])
    colors = np.full((8, 3), 200, np.uint8)
    return HandOnGlass("test", "", glass, hand, colors, joints, azimuth_deg=0.0, elevation_deg=0.0)


@pytest.fixture(scope="module")
def track(scene):
    return orbit(scene, TURNS, pixels=64)


def test_the_camera_projects_as_the_studio_does(scene, track):
    points = np.concatenate([scene.glass.vertices, scene.joints])
    for view, pose in zip(track.views, track.camera_from_object, strict=True):
        there = project(transform_points(pose, points), track.camera)
        np.testing.assert_allclose(there, view.pixels_of(points, 64), atol=1e-9)
        np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
        middle = transform_points(pose, view.center[None])[0]
        np.testing.assert_allclose(middle, [0, 0, track.views[0].distance], atol=1e-12)


def test_turning_goes_around_the_glasss_axis(track):
    eyes = [np.linalg.inv(pose)[:3, 3] - track.views[0].center for pose in track.camera_from_object]
    angles = np.rad2deg([np.arctan2(eye[1], eye[0]) for eye in eyes])
    np.testing.assert_allclose(angles, TURNS, atol=1e-9)


def test_the_point_is_the_nearest_of_the_upper_glass(track):
    point = point_on_glass(track)
    assert point[2] == pytest.approx(0.20)
    np.testing.assert_allclose(point[:2], [0.05, 0.03])  # for the camera at 60 degrees


def test_which_features_move(track):
    found = orbit_features(track, point_on_glass(track), VoxelGrid())
    assert {name: values.shape for name, values in found.items()} == {
        "absolute": (3, 63),
        "lengths": (3, 21),
        "relative": (3, 63),
        "image": (3, 42),
    }
    changes = {name: change_of(values, 0) for name, values in found.items()}
    for name in ("absolute", "lengths"):
        assert changes[name].max() < 1e-12
    for name in ("relative", "image"):
        assert changes[name][0] == 0
        assert (changes[name][1:] > 0.2).all()
    wrist_to_point = point_on_glass(track) - track.scene.joints[0]
    assert found["lengths"][1, 0] == pytest.approx(np.linalg.norm(wrist_to_point))


def test_the_2d_feature_is_a_share_of_the_picture(track):
    """As the network has it: the pixel's centre, so half a pixel more, over the picture's size."""
    found = orbit_features(track, point_on_glass(track), VoxelGrid())["image"][1].reshape(21, 2)
    uv = project(track.keypoints[1], track.camera)
    np.testing.assert_allclose(found, (uv + 0.5) / 64)


def test_change_of_a_case_made_by_hand():
    rows = np.zeros((2, 42))
    rows[:, 0::2] = np.where(np.arange(21) < 10, 1.0, np.where(np.arange(21) < 20, -1.0, 0.0))
    rows[1] += 1.0  # all points move by (1, 1): rms sqrt(2); their rms distance is sqrt(20 / 21)
    np.testing.assert_allclose(change_of(rows, 0), [0, np.sqrt(2) / np.sqrt(20 / 21)])


def test_what_is_seen_behind_glass_and_behind_flesh(track):
    seen = keypoints_seen(track)
    tips = [FINGERS[name][3] for name in ("index", "middle", "ring")]
    assert set(seen[0, tips]) == {BEHIND_GLASS}, "the glass stands before the fingers"
    thumb = FINGERS["thumb"][3]
    assert seen[0, thumb] == IN_VIEW
    # From the side the plate shows its edge: only the keypoints at that edge are near the skin.
    edge_on = seen[2] == HIDDEN
    depth = track.keypoints[2, :, 2]
    assert edge_on[depth > depth.min() + 0.05].all()
    assert seen[0].min() > HIDDEN
    keypoints = track.keypoints.copy()
    keypoints[0, 20, 0] += 5.0
    assert keypoints_seen(replace(track, keypoints=keypoints))[0, 20] == HIDDEN, "outside"


def test_the_picture_says_what_changed(track):
    found = orbit_features(track, point_on_glass(track), VoxelGrid())
    pictures = [np.zeros((64, 64, 3), np.uint8)] * 3
    figure = orbit_picture(track, pictures, found, point_on_glass(track), 1, 0)
    titles = {ax.get_title("left").split(":")[0]: ax for ax in figure.axes}
    assert titles["absolute"].get_title("left").endswith("unchanged")
    share = change_of(found["relative"], 0)[1]
    assert titles["relative"].get_title("left").endswith(f"changed by {share:.0%}")
    assert "camera at 60°" in [ax.get_title() for ax in figure.axes]
    bars, marks = titles["2D"].collections
    tops = [segment[1, 1] for segment in bars.get_segments()]
    np.testing.assert_allclose(tops, found["image"][1])
    np.testing.assert_allclose([s[0, 1] for s in marks.get_segments()], found["image"][0])
    assert len(FEATURES) == 4
