from pathlib import Path

import cv2
import numpy as np
import pytest

from hadr.camera import project, transform_points
from hadr.synthesis.hand.signed_distance import FOREARM_LENGTH
from hadr.synthesis.recordings.recording import find_recordings, read_recording
from hadr.synthesis.rendering.shading import RayTracer
from hadr.synthesis.scene.contents import Contents
from hadr.synthesis.scene.scene import make_scene
from hadr.synthesis.scene.surroundings import make_surroundings

RECORDINGS = Path(__file__).resolve().parents[3] / "data_samples" / "recordings"
WIDTH, HEIGHT = 128, 72


def hold(number):
    return read_recording(find_recordings(RECORDINGS)[number]).at(0)


@pytest.fixture(scope="module", params=[3, 41, 77, 120, 161, 199, 233])
def scene(request):
    rng = np.random.default_rng([7, request.param])
    return make_scene(hold(request.param), rng, WIDTH, HEIGHT, hand_step=0.004)


def test_the_camera_is_as_far_as_the_published_one(scene):
    eye = scene.world_from_camera[:3, 3]
    assert 0.22 <= np.linalg.norm(scene.keypoints.mean(0) - eye) <= 0.70
    assert scene.camera.fx / scene.camera.width == pytest.approx(1137.7778 / 1280, rel=1e-4)


def test_the_glass_is_in_the_picture_and_seen(scene):
    camera_from_world = np.linalg.inv(scene.world_from_camera)
    points = np.concatenate([body.vertices for body in scene.contents.glass])
    uv = project(transform_points(camera_from_world, points), scene.camera)
    inside = ((uv > -0.5) & (uv < [WIDTH - 0.5, HEIGHT - 0.5])).all(1)
    assert inside.mean() > 0.97
    labels = RayTracer(scene.contents).labels(scene.camera, scene.world_from_camera)
    assert labels.object_mask.sum() > 40
    assert labels.hand_mask.sum() > 150


def test_every_ray_ends_within_what_16_bits_hold(scene):
    labels = RayTracer(scene.contents).labels(scene.camera, scene.world_from_camera)
    assert (labels.depth > 0.15).all()
    assert (labels.background_depth > 0.15).all()
    assert labels.background_depth.max() < 6.5


def test_no_severed_arm_is_seen(scene):
    shape = scene.hold.shape
    world_from_wrist = scene.world_from_object @ np.linalg.inv(scene.hold.wrist_from_object)
    elbow = world_from_wrist @ [0, -FOREARM_LENGTH * shape.scale, 0, 1]
    local = np.linalg.inv(scene.world_from_camera) @ elbow
    if local[2] > 0:
        u, v = project(local[:3], scene.camera)
        assert not (0 <= u <= WIDTH - 1 and 0 <= v <= HEIGHT - 1)


def test_nothing_of_the_surroundings_stands_in_the_way(scene):
    """Between the camera and each keypoint there is only hand and glass."""
    around = RayTracer(Contents(None, (), surroundings=scene.contents.surroundings))
    eye = scene.world_from_camera[:3, 3]
    away = scene.keypoints - eye
    distance = np.linalg.norm(away, axis=1)
    directions = away / distance[:, None]
    pose = np.eye(4)
    pose[:3, 3] = eye
    hits = around._trace(around._all, np.broadcast_to(eye, directions.shape), directions)
    assert (hits.distance > distance).all()


def test_the_same_generator_gives_the_same_scene():
    first, second, other = (
        make_scene(hold(9), np.random.default_rng(s), WIDTH, HEIGHT, hand_step=0.004)
        for s in (4, 4, 5)
    )
    np.testing.assert_array_equal(first.world_from_camera, second.world_from_camera)
    meshes = [RayTracer(scene.contents).meshes for scene in (first, second)]
    for a, b in zip(*meshes, strict=True):
        np.testing.assert_array_equal(a[1].vertices, b[1].vertices)
    skies = [scene.contents.environment.image for scene in (first, second)]
    np.testing.assert_array_equal(*skies)
    assert not np.allclose(first.world_from_camera, other.world_from_camera)


def test_a_users_photographs_stand_around(tmp_path):
    rng = np.random.default_rng(0)
    for name in ("a.png", "b.png"):
        cv2.imwrite(str(tmp_path / name), rng.integers(0, 255, (60, 80, 3), dtype=np.uint8))
    paths = (tmp_path / "a.png", tmp_path / "b.png")
    made = make_scene(hold(9), np.random.default_rng(2), 64, 36, hand_step=0.004, backgrounds=paths)
    around = made.contents.surroundings
    assert around.photographs == paths
    assert set(np.unique(around.texture[around.texture < 0])) <= {-1, -2}
    assert (around.texture < 0).any()
    RayTracer(made.contents).picture(made.camera, made.world_from_camera)
    (tmp_path / "b.png").unlink()
    with pytest.raises(ValueError, match=r"can't read the photograph .*[bc]\.png"):
        make_surroundings(np.array([0.6, 0, 0.3]), np.zeros(3), -0.1, rng, (tmp_path / "c.png",))
