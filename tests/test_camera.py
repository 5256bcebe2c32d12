import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hadr.camera import (
    Intrinsics,
    back_project,
    pixel_grid,
    project,
    ray_directions,
    resize_color,
    resize_depth,
    resize_mask,
    transform_points,
    valid_depth,
    window_around,
)

CAMERA = Intrinsics(fx=40.0, fy=50.0, cx=3.0, cy=1.5, width=8, height=4)


def test_project_by_hand():
    uv = project([[0.0, 0.0, 2.0], [0.1, -0.2, 2.0]], CAMERA)
    np.testing.assert_allclose(uv, [[3.0, 1.5], [40 * 0.05 + 3, -50 * 0.1 + 1.5]])


def test_points_at_or_behind_the_camera_have_no_pixel():
    uv = project(np.array([[[0.1, 0.1, 0.0], [0.1, 0.1, -1.0], [0.0, 0.0, 1.0]]]), CAMERA)
    assert uv.shape == (1, 3, 2)
    assert np.isnan(uv[0, :2]).all()
    np.testing.assert_allclose(uv[0, 2], (3.0, 1.5))


def test_back_project_inverts_project():
    rng = np.random.default_rng(1)
    depth = rng.uniform(0.3, 2.0, CAMERA.shape)
    depth[0, 0], depth[1, 2] = 0.0, np.nan
    points = back_project(depth, CAMERA)
    missing = np.isnan(points).all(axis=-1)
    assert np.argwhere(missing).tolist() == [[0, 0], [1, 2]]
    assert not np.isnan(points[~missing]).any()
    uv = project(points, CAMERA)
    np.testing.assert_allclose(uv[~missing], pixel_grid(CAMERA)[~missing], atol=1e-12)
    np.testing.assert_allclose(points[~missing][:, 2], depth[~missing])


def test_rays_are_unit_and_distance_is_not_depth():
    rays = ray_directions(CAMERA)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=-1), 1.0)
    np.testing.assert_allclose(rays[1, 3], np.array([0.0, -0.5 / 50, 1.0]) / np.hypot(1, 0.01))
    depth = np.random.default_rng(2).uniform(0.3, 2.0, CAMERA.shape)
    points = back_project(depth, CAMERA)
    distance = np.linalg.norm(points, axis=-1)
    assert (distance > depth).all()  # no pixel centre lies on the principal point here
    np.testing.assert_allclose(distance[..., None] * rays, points)
    np.testing.assert_allclose(distance * rays[..., 2], depth)


@given(st.integers(1, 40), st.integers(1, 40))
def test_resizing_keeps_the_view(width, height):
    resized = CAMERA.resized(width, height)
    corners = np.array([[-0.5, -0.5], [7.5, 3.5]])  # the outer edges of the image
    rays = (corners - (CAMERA.cx, CAMERA.cy)) / (CAMERA.fx, CAMERA.fy)
    edges = rays * (resized.fx, resized.fy) + (resized.cx, resized.cy)
    np.testing.assert_allclose(edges, [[-0.5, -0.5], [width - 0.5, height - 0.5]], atol=1e-12)
    back = resized.resized(8, 4)
    np.testing.assert_allclose(
        list(back.to_dict().values()), list(CAMERA.to_dict().values()), atol=1e-9
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"fx": 0.0},
            "fx must be a focal length in pixels, for an image of 8 between 0.4 and .*, got 0",
        ),
        ({"fy": float("nan")}, "fy must be a focal length in pixels, .* got nan"),
        ({"fx": 0.9, "width": 640}, "fx must be .* for an image of 640 between 32 and .*, got 0.9"),
        ({"fx": 1e308}, r"fx must be .* got 1e\+308"),
        ({"width": 0}, "width must be a positive whole number of pixels, .*got 0"),
        ({"height": 2.5}, "height must be a positive whole number of pixels, .*got 2.5"),
        ({"width": 10**9}, r"width must be .* at most 67108864, got 1e\+09"),
        ({"width": 10**4, "height": 10**4}, "at most 67108864 pixels, got 10000x10000"),
        ({"cx": 100.0}, "cx must lie near the image of 8 pixels, got 100.0"),
        ({"cy": float("inf")}, "cy must lie near the image of 4 pixels, got inf"),
    ],
)
def test_impossible_intrinsics(changes, message):
    with pytest.raises(ValueError, match=message):
        replace(CAMERA, **changes)


def test_matrix_and_dictionary_round_trip():
    assert Intrinsics.from_matrix(CAMERA.matrix, 8, 4) == CAMERA
    assert Intrinsics.from_dict(CAMERA.to_dict()) == CAMERA
    np.testing.assert_allclose(CAMERA.matrix, [[40, 0, 3], [0, 50, 1.5], [0, 0, 1]])


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (np.eye(4), r"K must have shape \(3, 3\), got \(4, 4\)"),
        ([[40, 1, 3], [0, 50, 1.5], [0, 0, 1]], "without skew"),
        ([[40, 0, 3], [0, 50, 1.5], [0, 0, 2]], "must be a pinhole matrix"),
    ],
)
def test_matrices_that_are_no_pinhole(matrix, message):
    with pytest.raises(ValueError, match=message):
        Intrinsics.from_matrix(matrix, 8, 4)


@pytest.mark.parametrize("name", ["camera1", "camera2"])
@pytest.mark.parametrize("sensor", ["rgb", "ir1", "ir2"])
def test_realsense_projection_matrix(realdata: Path, name, sensor):
    """The recorded P = K [R t] and our transform and projection agree on random points."""
    path = realdata / "realsense_calib" / "corsmal_demo_calib.json"
    calibration = json.loads(path.read_text())[name]
    camera = Intrinsics.from_matrix(calibration["K"][sensor], 1280, 720)
    extrinsics = calibration["extrinsics_world_to_camera"][sensor]
    camera_from_world = np.eye(4)
    camera_from_world[:3, :3] = extrinsics["R"]
    camera_from_world[:3, 3] = np.ravel(extrinsics["t"])
    world = np.random.default_rng(3).uniform(-0.4, 0.4, (100, 3))
    homogeneous = np.c_[world, np.ones(100)] @ np.asarray(extrinsics["P"]).T
    expected = homogeneous[:, :2] / homogeneous[:, 2:]
    in_camera = transform_points(camera_from_world, world)
    np.testing.assert_allclose(project(in_camera, camera), expected, atol=1e-6)


def test_transform_points_by_hand_and_back():
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    turn[:3, 3] = (1.0, 2.0, 3.0)
    np.testing.assert_allclose(transform_points(turn, [1.0, 0.0, 0.0]), [1.0, 3.0, 3.0], atol=1e-12)
    points = np.random.default_rng(4).normal(size=(2, 5, 3))
    back = transform_points(np.linalg.inv(turn), transform_points(turn, points))
    np.testing.assert_allclose(back, points, atol=1e-12)


def test_wrong_shapes():
    with pytest.raises(ValueError, match=r"transform must have shape \(4, 4\), got \(3, 3\)"):
        transform_points(np.eye(3), np.zeros(3))
    with pytest.raises(ValueError, match=r"points must have shape \(\.\.\., 3\), got \(4, 2\)"):
        transform_points(np.eye(4), np.zeros((4, 2)))
    with pytest.raises(ValueError, match=r"points must have shape \(\.\.\., 3\), got \(2,\)"):
        project(np.zeros(2), CAMERA)
    with pytest.raises(ValueError, match=r"depth has shape \(8, 4\), but the intrinsics are of"):
        back_project(np.ones((8, 4)), CAMERA)
    with pytest.raises(ValueError, match=r"depth must be \(H, W\) float metres, got \(4, 8, 3\)"):
        back_project(np.ones((4, 8, 3)), CAMERA)


def test_valid_depth():
    depth = np.array([[1.0, 0.0, -0.1], [np.nan, np.inf, 1e-6]])
    assert valid_depth(depth).tolist() == [[True, False, False], [False, False, True]]


@pytest.mark.parametrize("kind", [np.uint16, np.int64, bool])
def test_millimetres_are_no_depth(kind):
    with pytest.raises(ValueError, match=f"depth must be float metres, got {np.dtype(kind)}"):
        back_project(np.full((4, 8), 1, kind), CAMERA)


def test_resize_depth_takes_pixels_and_invents_none():
    depth = np.array([[1.0, 2.0, 3.0, 4.0]])
    # Twice as wide: new centres -0.25, 0.25, 0.75, ... fall nearest to 0, 0, 1, 1, ...
    assert resize_depth(depth, 8, 1)[0].tolist() == [1, 1, 2, 2, 3, 3, 4, 4]
    # A third as wide: new centre 0 looks at old 1, 4, 7.
    nine = np.arange(9.0)[None]
    assert resize_depth(nine, 3, 1)[0].tolist() == [1.0, 4.0, 7.0]
    edge = np.random.default_rng(5).choice([0.0, 0.7, 1.4], (36, 64))
    assert set(np.unique(resize_depth(edge, 17, 11))) <= {0.0, 0.7, 1.4}


@given(st.integers(1, 30), st.integers(1, 30))
def test_resized_depth_stays_on_its_ray(width, height):
    u = np.tile(np.arange(24.0), (12, 1))  # an image that holds its own column
    resized = resize_depth(u, width, height)
    expected = (np.arange(width) + 0.5) * 24 / width - 0.5
    assert resized.shape == (height, width)
    assert np.abs(resized[0] - expected).max() <= 0.5


def test_resize_color_averages_when_it_shrinks():
    color = np.zeros((2, 4, 3), dtype=np.uint8)
    color[:, 0] = 200
    small = resize_color(color, 2, 1)
    assert small.dtype == np.uint8
    assert small[0, :, 0].tolist() == [100, 0]
    assert resize_color(color, 8, 4).shape == (4, 8, 3)


def test_resize_to_nothing():
    for resize, image in (
        (resize_depth, np.ones((2, 2))),
        (resize_mask, np.ones((2, 2), bool)),
        (resize_color, np.ones((2, 2, 3), np.uint8)),
    ):
        with pytest.raises(ValueError, match="target size must be positive, got 0x3"):
            resize(image, 0, 3)


def test_window_around_a_mask_ends_at_the_border() -> None:
    mask = np.zeros((20, 30), bool)
    mask[3:6, 10:12] = True
    assert window_around(mask, 2) == (slice(1, 8), slice(8, 14))
    assert window_around(mask, 12) == (slice(0, 18), slice(0, 24))
    assert window_around(mask, 99) == (slice(0, 20), slice(0, 30))
    with pytest.raises(ValueError, match="none of its 600 pixels is set"):
        window_around(np.zeros((20, 30), bool), 2)
