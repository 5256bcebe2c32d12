"""The depth camera as a whole, on scenes whose depth follows from a formula."""

import hashlib
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from hadr.camera import Intrinsics, ray_directions
from hadr.synthesis.depth_sensor.depth_camera import StereoCamera, capture_depth, infrared_pair
from hadr.synthesis.depth_sensor.infrared import InfraredScene, Projector
from hadr.synthesis.generation.frames import build_scene
from hadr.synthesis.generation.settings import GenerationSettings
from hadr.synthesis.glass.surfaces import Surface
from hadr.synthesis.hand.mesh import HandMesh
from hadr.synthesis.rendering.shading import RayTracer
from hadr.synthesis.scene.contents import Contents, Scene, Surroundings

#: The middle of TransHand-14K's picture at 256 x 144.
COLOR = Intrinsics(227.56, 227.56, 79.5, 47.5, 160, 96)
CAMERA = StereoCamera()
REPOSITORY = Path(__file__).resolve().parents[3]


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
    surface = Surface(*map(np.asarray, (mesh.vertices, mesh.faces, mesh.vertex_normals)))
    count = len(mesh.vertices)
    return HandMesh(surface, np.full((count, 3), 0.5), np.zeros(count))


def box(low, high) -> trimesh.Trimesh:
    mesh = trimesh.creation.box(bounds=[low, high])
    mesh.unmerge_vertices()
    return mesh


def glass_box(low, high) -> Surface:
    mesh = box(low, high)
    normals = np.repeat(np.asarray(mesh.face_normals), 3, axis=0)
    return Surface(np.asarray(mesh.vertices), np.asarray(mesh.faces), normals)


def scene(hand=None, glass=(), around=None) -> Scene:
    contents = Contents(hand, tuple(glass), surroundings=around)
    return Scene(contents, COLOR, np.eye(4))


def pixel_error(z):
    """Depth error of a pixel of disparity at a distance, metres: dz = z^2 / (f b)."""
    return z**2 / (CAMERA.focal * CAMERA.baseline)


@pytest.mark.parametrize("z", [0.5, 0.9])
def test_a_wall_is_measured_to_a_fraction_of_a_pixel_of_disparity(z):
    raw = capture_depth(scene(around=wall(z)), 0)
    assert raw.shape == COLOR.shape
    assert raw.dtype == np.float32
    seen = raw > 0
    assert seen.mean() > 0.95
    error = raw[seen] - z
    assert abs(np.median(error)) < 0.1 * pixel_error(z)
    assert np.percentile(np.abs(error), 90) < 0.35 * pixel_error(z)
    np.testing.assert_allclose(raw * 1000, np.rint(raw * 1000), atol=1e-3)


def test_a_slanted_wall_is_measured_without_steps_of_whole_pixels():
    raw = capture_depth(scene(around=wall(0.7, slope=0.4)), 0)
    d = ray_directions(COLOR)
    exact = 0.7 / (d[..., 2] - 0.4 * d[..., 0]) * d[..., 2]
    seen = raw > 0
    assert seen.mean() > 0.95
    error = (raw - exact)[seen] / pixel_error(exact[seen])
    assert abs(np.median(error)) < 0.1
    # A matcher drawn to whole disparities errs with the fraction of the disparity.
    fraction = (CAMERA.focal * CAMERA.baseline / exact[seen]) % 1
    for low in (0.0, 0.25, 0.5, 0.75):
        part = error[(fraction >= low) & (fraction < low + 0.25)]
        assert abs(np.median(part)) < 0.08


def test_what_only_the_colour_camera_sees_is_missing_on_the_left():
    """The imagers stand to the right of the colour camera: they can't see left behind a thing."""
    near, far = 0.5, 1.0
    thing = opaque(box([-0.05, -0.1, near], [0.05, 0.1, near + 0.02]))
    raw = capture_depth(scene(hand=thing, around=wall(far)), 1)[36:60]
    width = COLOR.fx * (CAMERA.left_imager + CAMERA.baseline) * (1 / near - 1 / far)
    left = COLOR.fx * -0.05 / near + COLOR.cx
    right = COLOR.fx * 0.05 / near + COLOR.cx
    shadow = raw[:, round(left - width) + 3 : round(left) - 1]
    assert shadow.shape[1] > 8
    assert (shadow > 0).mean() < 0.02
    beside = raw[:, round(left - width) - 12 : round(left - width) - 4]
    assert (np.abs(beside - far) < 0.03).mean() > 0.9
    other = raw[:, round(right) + 5 : round(right) + 5 + round(width)]
    assert (np.abs(other - far) < 0.03).mean() > 0.9


def test_a_glass_pane_shows_the_wall_behind_it_a_third_of_its_thickness_nearer():
    """Seen through a parallel pane of index n, everything is nearer by t (1 - 1/n)."""
    thickness = 0.045
    pane = glass_box([-0.12, -0.08, 0.5], [0.12, 0.08, 0.5 + thickness])
    raw = capture_depth(scene(glass=[pane], around=wall(0.7)), 0)
    window = raw[38:58, 64:94]
    assert (window > 0).mean() > 0.8
    assert np.median(window[window > 0]) == pytest.approx(0.7 - thickness / 3, abs=0.003)
    v, u = np.indices(COLOR.shape)
    x, y = ((u - COLOR.cx) / COLOR.fx * 0.5, (v - COLOR.cy) / COLOR.fy * 0.5)
    on_pane = (np.abs(x) < 0.11) & (np.abs(y) < 0.07)
    assert (raw[on_pane] > 0).any()
    assert not ((raw[on_pane] > 0) & (raw[on_pane] < 0.6)).any()


def test_dots_fall_through_glass_with_the_light_that_passes_it():
    """Two clean surfaces let through (1 - 4 %)^2 of the light, and light between them comes too."""
    pane = glass_box([-1, -1, 0.5], [1, 1, 0.51])
    grid = np.mgrid[-0.15:0.15:100j, -0.12:0.12:80j].reshape(2, -1).T
    points = np.column_stack([grid, np.full(len(grid), 0.8)])
    normals = np.tile([0.0, 0, -1], (len(points), 1))
    light = []
    for glass in ((), (pane,)):
        seen = Contents(None, glass, surroundings=wall(0.8))
        drawn = InfraredScene(seen, Projector(), np.zeros(3), np.eye(3))
        light.append(drawn.dots(points, normals))
    share = light[1].mean() / light[0].mean()
    assert share == pytest.approx((1 - 0.04) / (1 + 0.04), abs=0.05)


def test_the_projector_makes_a_bare_wall_visible():
    bare = wall(0.7)
    bare = replace(bare, repeat=np.full(2, 1e-6))  # so fine that only its mean colour is left
    dark = replace(CAMERA, projector=Projector(strength=1e-9))
    assert (capture_depth(scene(around=bare), 0, dark) > 0).mean() < 0.05
    assert (capture_depth(scene(around=bare), 0) > 0).mean() > 0.95


def test_nothing_beyond_the_range_is_reported():
    camera = replace(CAMERA, farthest=0.8)
    raw = capture_depth(scene(around=wall(0.7, slope=1.0)), 0, camera)
    assert 0.7 < raw.max() <= 0.8
    assert not capture_depth(scene(around=wall(12.0)), 0).any()
    assert not capture_depth(scene(), 0).any()


def test_a_hand_is_measured_and_its_glass_is_not():
    settings = GenerationSettings(seed=9, width=256, height=144, quality="fast")
    frame = build_scene(settings.recipe(2), settings)
    labels = RayTracer(frame.contents).labels(frame.camera, frame.world_from_camera)
    raw = capture_depth(frame, 5)
    hand, glass = (mask & (raw > 0) for mask in (labels.hand_mask, labels.object_mask))
    assert hand.sum() > 0.6 * labels.hand_mask.sum()
    assert np.median(np.abs(raw - labels.depth)[hand]) < 0.005
    assert glass.sum() < 0.8 * labels.object_mask.sum()
    close = np.abs(raw - labels.depth)[glass] < 0.005
    assert close.sum() < 0.3 * labels.object_mask.sum()


def fingerprint(seed: int) -> str:
    """The measured depth of a ball behind a pane, as a hash."""
    ball = trimesh.creation.icosphere(3, 0.08)
    ball.apply_translation((0.0, 0.0, 0.65))
    pane = glass_box([-0.1, -0.05, 0.5], [0.02, 0.05, 0.51])
    raw = capture_depth(scene(opaque(ball), [pane], wall(0.9)), seed)
    return hashlib.sha256(raw.tobytes()).hexdigest()


def test_the_same_seed_gives_the_same_bytes_in_another_process():
    script = (
        "import sys; sys.path[:0] = sys.argv[1:]\n"
        "from test_depth_camera import fingerprint\n"
        "print(fingerprint(6))\n"
    )
    paths = [str(REPOSITORY), str(Path(__file__).parent)]
    answer = subprocess.run(
        [sys.executable, "-c", script, *paths], capture_output=True, text=True, check=True
    )
    here = fingerprint(6)
    assert answer.stdout.strip() == here
    assert fingerprint(5) != here


def test_the_imagers_pictures_are_rectified_and_cover_the_colour_view():
    pair = infrared_pair(scene(around=wall(0.6)), 0)
    assert pair.left.shape == pair.right.shape == pair.imager.shape
    assert pair.left.dtype == np.uint8
    assert not pair.left[:, : pair.margin].any()
    edge = (0 - pair.imager.cx + pair.margin) / pair.imager.fx  # first drawn column, a tangent
    leftmost = (-0.5 - COLOR.cx) / COLOR.fx - CAMERA.left_imager / CAMERA.closest
    assert edge < leftmost
