import numpy as np
import pytest
import trimesh

from hadr.camera import Intrinsics, ray_directions
from hadr.synthesis.glass.surfaces import Surface
from hadr.synthesis.rendering.shading import RayTracer
from hadr.synthesis.scene.contents import Contents

CAMERA = Intrinsics(200.0, 210.0, 60.3, 40.7, 128, 80)


def sphere(center, radius, subdivisions=6) -> Surface:
    mesh = trimesh.creation.icosphere(subdivisions, radius)
    return Surface(mesh.vertices + center, np.asarray(mesh.faces), mesh.vertices / radius)


def test_depth_of_a_glass_sphere_is_exact_and_what_is_behind_it_is_kept(plane):
    center, radius = np.array([0.02, -0.03, 0.7]), 0.08
    scene = RayTracer(
        Contents(None, (sphere(center, radius, 7),), surroundings=plane([0, 0, 1.0], 2.0))
    )
    labels = scene.labels(CAMERA, np.eye(4))
    d = ray_directions(CAMERA)
    b = d @ center
    inside = b**2 - (center @ center - radius**2)
    exact = (b - np.sqrt(np.maximum(inside, 0))) * d[..., 2]
    # Off the silhouette, where a facet's error is not magnified by the grazing view.
    clear = inside > (0.35 * radius) ** 2
    assert clear.sum() > 200
    np.testing.assert_allclose(labels.depth[clear], exact[clear], atol=5e-5)
    assert labels.object_mask[clear].all()
    assert not labels.object_mask[inside < -1e-4].any()
    np.testing.assert_allclose(labels.background_depth, 2.0, atol=5e-5)
    point = exact[..., None] * d / d[..., 2:]
    normal = (point - center) / radius
    np.testing.assert_allclose(labels.normals[clear], normal[clear], atol=2e-3)


def nearest_hit(eye, direction, surface) -> float:
    """Every triangle against one ray, by Cramer's rule in float64."""
    a, b, c = (surface.vertices[surface.faces[:, i]] for i in range(3))
    e1, e2 = b - a, c - a
    p = np.cross(direction, e2)
    det = (e1 * p).sum(1)
    det = np.where(np.abs(det) < 1e-18, np.nan, det)
    s = eye - a
    u = (s * p).sum(1) / det
    q = np.cross(s, e1)
    v = (q @ direction) / det
    t = (e2 * q).sum(1) / det
    hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
    return float(t[hit].min()) if hit.any() else np.inf


def test_depth_of_hand_and_glass_is_that_of_the_nearest_triangle(scene):
    labels = RayTracer(scene.contents).labels(scene.camera, scene.world_from_camera)
    d = ray_directions(scene.camera)
    eye = scene.world_from_camera[:3, 3]
    assert scene.contents.hand is not None
    for mask, surfaces in (
        (labels.hand_mask, (scene.contents.hand.surface,)),
        (labels.object_mask, scene.contents.glass),
    ):
        for row, column in np.argwhere(mask)[:: max(mask.sum() // 25, 1)]:
            world = scene.world_from_camera[:3, :3] @ d[row, column]
            depth = min(nearest_hit(eye, world, s) for s in surfaces) * d[row, column, 2]
            assert labels.depth[row, column] == pytest.approx(depth, abs=2e-5)


def test_depth_is_exact_to_single_precision_at_any_slant(plane):
    """Embree alone is off everywhere by more than rounding to float32 explains."""
    for slant in (0.0, 0.5, 1.2, 1.4):
        normal = np.array([np.sin(slant), 0.1, np.cos(slant)])
        normal /= np.linalg.norm(normal)
        labels = RayTracer(Contents(None, (), surroundings=plane(normal, 0.6, 60.0))).labels(
            CAMERA, np.eye(4)
        )
        d = ray_directions(CAMERA)
        exact = 0.6 / (d @ normal) * d[..., 2]
        seen = labels.depth > 0
        assert seen.mean() > 0.4
        off = np.abs(labels.depth / exact - 1)[seen]
        assert np.quantile(off, 0.99) < 1e-7
        assert off.max() < 2e-6  # where two triangles meet Embree may have found the other one
        np.testing.assert_allclose(labels.normals[seen] + normal, 0, atol=1e-5)
        assert not (labels.hand_mask | labels.object_mask).any()


def grid_of_squares(count) -> Surface:
    """A plane at 1 m of 2 x count^2 triangles, from -1 to 1 m."""
    line = np.linspace(-1, 1, count + 1)
    x, y = np.meshgrid(line, line)
    vertices = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=1)
    i = np.arange(x.size).reshape(x.shape)
    a, b, c, d = i[:-1, :-1].ravel(), i[:-1, 1:].ravel(), i[1:, 1:].ravel(), i[1:, :-1].ravel()
    faces = np.concatenate([np.stack([a, c, b], 1), np.stack([a, d, c], 1)])
    return Surface(vertices, faces, np.tile([0, 0, -1.0], (len(vertices), 1)))


@pytest.mark.parametrize("count", [2, 300, 600])
def test_no_ray_slips_through_where_triangles_meet(count):
    """The pixels' rays run exactly through edges and corners of the triangles."""
    camera = Intrinsics(300.0, 300.0, 160.0, 90.0, 321, 181)
    labels = RayTracer(Contents(None, (grid_of_squares(count),))).labels(camera, np.eye(4))
    assert labels.object_mask.all()
    np.testing.assert_allclose(labels.depth, 1.0, rtol=1e-7)


def test_a_pixel_is_what_its_centre_sees(plane):
    """An edge between columns 60 and 61, a hundredth of a pixel beside the centre of one."""
    wall = plane([0, 0, 1.0], 2.0)
    for edge, first in ((60.01, 61), (59.99, 60)):
        x = (edge - CAMERA.cx) / CAMERA.fx
        corners = np.array([[x, -1, 1], [2, -1, 1], [2, 1, 1], [x, 1, 1.0]])
        pane = Surface(corners, np.array([[0, 2, 1], [0, 3, 2]]), np.tile([0, 0, -1.0], (4, 1)))
        labels = RayTracer(Contents(None, (pane,), surroundings=wall)).labels(CAMERA, np.eye(4))
        np.testing.assert_array_equal(
            labels.object_mask, np.broadcast_to(np.arange(128) >= first, (80, 128))
        )
        np.testing.assert_allclose(labels.background_depth, 2.0, rtol=1e-7)
