import numpy as np
import pytest
import trimesh

from hadr.camera import Intrinsics, project, ray_directions
from hadr.synthesis.generation.frames import build_scene
from hadr.synthesis.generation.settings import GenerationSettings
from hadr.synthesis.glass.surfaces import Surface
from hadr.synthesis.rendering.optics import GLASS_INDEX, reflect, refract
from hadr.synthesis.rendering.raycast import GLASS, HAND, SURROUNDINGS
from hadr.synthesis.rendering.refraction import ray_path
from hadr.synthesis.rendering.shading import RayTracer
from hadr.synthesis.scene.contents import Contents, Surroundings

CAMERA = Intrinsics(200.0, 210.0, 60.3, 40.7, 128, 80)


def plane(normal, distance, reach=20.0) -> Surroundings:
    normal = np.asarray(normal, dtype=float) / np.linalg.norm(normal)
    x = np.cross([0, 1.0, 0], normal)
    x /= np.linalg.norm(x)
    y = np.cross(normal, x)
    corners = distance * normal + reach * np.array([-x - y, x - y, x + y, -x + y])
    surface = Surface(corners, np.array([[0, 1, 2], [0, 2, 3]]), np.tile(-normal, (4, 1)))
    return Surroundings(surface, corners[:, :2], np.zeros(2, int), np.ones((2, 3)), np.ones(2))


def sphere(center, radius, subdivisions=6) -> Surface:
    mesh = trimesh.creation.icosphere(subdivisions, radius)
    return Surface(mesh.vertices + center, np.asarray(mesh.faces), mesh.vertices / radius)


def test_depth_of_a_slanted_plane_is_exact():
    normal, distance = np.array([0.3, -0.2, 0.93]), 1.1
    normal /= np.linalg.norm(normal)
    labels = RayTracer(Contents(None, (), surroundings=plane(normal, distance))).labels(
        CAMERA, np.eye(4)
    )
    d = ray_directions(CAMERA)
    exact = distance / (d @ normal) * d[..., 2]
    np.testing.assert_allclose(labels.depth, exact, atol=5e-5)
    assert not labels.hand_mask.any()
    assert not labels.object_mask.any()
    np.testing.assert_allclose(labels.normals, np.broadcast_to(-normal, (80, 128, 3)), atol=1e-5)


def test_depth_of_a_glass_sphere_is_exact_and_what_is_behind_it_is_kept():
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


def test_a_moved_camera_sees_the_plane_where_it_is():
    pose = np.eye(4)
    pose[:3, 3] = (0.3, -0.2, -0.5)
    scene = RayTracer(Contents(None, (), surroundings=plane([0, 0, 1.0], 1.0)))
    np.testing.assert_allclose(scene.labels(CAMERA, pose).depth, 1.5, atol=5e-5)


def test_snell_and_fresnel_by_hand():
    angle = np.deg2rad(40.0)
    direction = np.array([[np.sin(angle), 0, np.cos(angle)]])
    normal = np.array([[0, 0, -1.0]])
    bent, share = refract(direction, normal, np.array([1 / 1.5]))
    assert bent[0, 0] == pytest.approx(np.sin(angle) / 1.5)
    straight, normal_share = refract(np.array([[0, 0, 1.0]]), normal, np.array([1 / 1.5]))
    np.testing.assert_allclose(straight, [[0, 0, 1.0]])
    assert normal_share[0] == pytest.approx(0.04)  # ((1.5 - 1) / (1.5 + 1))^2
    # s: -sin(i - t)/sin(i + t), p: tan(i - t)/tan(i + t)
    out = np.arcsin(np.sin(angle) / 1.5)
    s = np.sin(angle - out) / np.sin(angle + out)
    p = np.tan(angle - out) / np.tan(angle + out)
    assert share[0] == pytest.approx((s**2 + p**2) / 2)


def test_total_reflection_begins_at_the_critical_angle():
    critical = np.arcsin(1 / GLASS_INDEX)
    for angle, total in ((critical - 0.01, False), (critical + 0.01, True)):
        direction = np.array([[np.sin(angle), 0, np.cos(angle)]])
        _, share = refract(direction, np.array([[0, 0, -1.0]]), np.array([GLASS_INDEX]))
        assert bool(share[0] == 1.0) == total
    np.testing.assert_allclose(
        reflect(np.array([[0.6, 0, 0.8]]), np.array([[0, 0, -1.0]])), [[0.6, 0, -0.8]]
    )


def test_a_flat_pane_shifts_rays_but_does_not_bend_them():
    """Through a pane of glass a ray goes on in its old direction: the picture stays, but dimmer."""
    low, high = np.array([-3, -3, 0.5]), np.array([3, 3, 0.52])
    mesh = trimesh.creation.box(bounds=[low, high])
    mesh = mesh.copy()
    mesh.unmerge_vertices()
    pane = Surface(mesh.vertices, np.asarray(mesh.faces), np.asarray(mesh.vertex_normals))
    wall = plane([0, 0, 1.0], 1.0)
    with_pane = RayTracer(Contents(None, (pane,), (1.0, 1.0, 1.0), wall))
    bare = RayTracer(Contents(None, (), surroundings=wall))
    d = ray_directions(CAMERA).reshape(-1, 3)
    eye = np.zeros_like(d)
    seen, direct = with_pane.radiance(eye, d, 0.005), bare.radiance(eye, d, 0.005)
    ratio = np.median(seen / np.maximum(direct, 1e-6))
    assert 0.85 < ratio < 1.1
    assert np.corrcoef(seen.ravel(), direct.ravel())[0, 1] > 0.97


def test_the_path_through_a_pane_by_hand():
    """At 30 degrees: in at 0.5 m, bent to asin(sin 30 / 1.5), out at 0.52 m as it came."""
    mesh = trimesh.creation.box(bounds=[[-3, -3, 0.5], [3, 3, 0.52]])
    mesh.unmerge_vertices()
    pane = Surface(mesh.vertices, np.asarray(mesh.faces), np.asarray(mesh.vertex_normals))
    scene = RayTracer(Contents(None, (pane,), surroundings=plane([0, 0, 1.0], 1.0)))
    sine, cosine = np.sin(np.pi / 6), np.cos(np.pi / 6)
    path = ray_path(scene, np.zeros(3), np.array([sine, 0, cosine]))
    x_in = 0.5 * sine / cosine
    x_out = x_in + 0.02 * np.tan(np.arcsin(sine / 1.5))
    x_wall = x_out + 0.48 * sine / cosine
    expected = [[0, 0, 0], [x_in, 0, 0.5], [x_out, 0, 0.52], [x_wall, 0, 1.0]]
    np.testing.assert_allclose(path, expected, atol=2e-5)


def test_overlapping_bodies_count_as_one():
    """Two boxes of glass that share a slab look like the one box that they make up."""

    def box(low, high):
        mesh = trimesh.creation.box(bounds=[low, high])
        mesh.unmerge_vertices()
        return Surface(mesh.vertices, np.asarray(mesh.faces), np.asarray(mesh.vertex_normals))

    wall = plane([0, 0, 1.0], 1.0)
    one = RayTracer(Contents(None, (box([-3, -3, 0.4], [3, 3, 0.6]),), surroundings=wall))
    two = RayTracer(
        Contents(
            None,
            (box([-3, -3, 0.4], [3, 3, 0.52]), box([-3, -3, 0.45], [3, 3, 0.6])),
            surroundings=wall,
        )
    )
    d = ray_directions(CAMERA).reshape(-1, 3)
    eye = np.zeros_like(d)
    off = np.abs(one.radiance(eye, d, 0.005) - two.radiance(eye, d, 0.005))
    assert off.max() < 0.02  # where rounding takes a ray to the next texel
    assert np.quantile(off, 0.99) < 2e-3


@pytest.fixture(scope="module")
def scene():
    settings = GenerationSettings(width=160, height=90, quality="fast")
    return build_scene(settings.recipe(0), settings)


def test_masks_are_disjoint_and_both_are_seen(scene):
    labels = RayTracer(scene.contents).labels(scene.camera, scene.world_from_camera)
    assert labels.object_mask.sum() > 50
    assert labels.hand_mask.sum() > 50
    assert not (labels.object_mask & labels.hand_mask).any()
    assert (labels.depth > 0).all()
    # Without the glass every pixel looks as far or farther.
    assert (labels.background_depth >= labels.depth - 1e-6).all()
    off = ~labels.object_mask
    np.testing.assert_array_equal(labels.depth[off], labels.background_depth[off])
    assert (labels.background_depth - labels.depth)[labels.object_mask].max() > 0.02


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


def test_depth_is_exact_to_single_precision_at_any_slant():
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


def test_a_facet_of_a_coarse_sphere_is_met_in_its_plane():
    """80 triangles, not the sphere that they stand for: the distance of the plane of each."""
    ball = sphere(np.array([0.0, 0, 0.6]), 0.15, 1)
    labels = RayTracer(Contents(None, (ball,))).labels(CAMERA, np.eye(4))
    d = ray_directions(CAMERA)
    for row, column in np.argwhere(labels.object_mask)[::40]:
        depth = nearest_hit(np.zeros(3), d[row, column], ball) * d[row, column, 2]
        assert labels.depth[row, column] == pytest.approx(depth, rel=1e-7)


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


def test_a_pixel_is_what_its_centre_sees():
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


def test_normals_have_length_1_and_look_at_the_camera(scene):
    labels = RayTracer(scene.contents).labels(scene.camera, scene.world_from_camera)
    np.testing.assert_allclose(np.linalg.norm(labels.normals, axis=-1), 1.0, atol=1e-5)
    toward = (labels.normals * ray_directions(scene.camera)).sum(-1)
    assert (toward <= 1e-6).all()
    # On the glass they agree with the slope of the depth, away from edges.
    z = labels.depth.astype(float)
    points = z[..., None] * ray_directions(scene.camera) / ray_directions(scene.camera)[..., 2:]
    across, down = np.gradient(points, axis=1), np.gradient(points, axis=0)
    slope = np.cross(down, across)
    slope /= np.linalg.norm(slope, axis=-1, keepdims=True)
    agreement = np.abs((slope * labels.normals).sum(-1))[labels.object_mask]
    assert np.median(agreement) > 0.99


def test_masks_hand_glass_and_the_rest_share_out_the_picture(scene):
    labels = RayTracer(scene.contents).labels(scene.camera, scene.world_from_camera)
    rays = ray_directions(scene.camera).reshape(-1, 3) @ scene.world_from_camera[:3, :3].T
    eye = np.broadcast_to(scene.world_from_camera[:3, 3], rays.shape)
    tracer = RayTracer(scene.contents)
    kind = tracer.kind(tracer.first(eye, rays).mesh).reshape(labels.depth.shape)
    np.testing.assert_array_equal(labels.hand_mask, kind == HAND)
    np.testing.assert_array_equal(labels.object_mask, kind == GLASS)
    assert ((kind == HAND) | (kind == GLASS) | (kind == SURROUNDINGS)).all()


def test_keypoints_project_into_or_next_to_the_hand(scene):
    labels = RayTracer(scene.contents).labels(scene.camera, scene.world_from_camera)
    camera_from_world = np.linalg.inv(scene.world_from_camera)
    keypoints = scene.keypoints @ camera_from_world[:3, :3].T + camera_from_world[:3, 3]
    uv = project(keypoints, scene.camera)
    held = np.argwhere(labels.hand_mask | labels.object_mask)[:, ::-1]
    inside = (uv > 0).all(1) & (uv < [159, 89]).all(1)
    assert inside.sum() >= 15
    nearest = np.linalg.norm(uv[inside, None] - held[None], axis=-1).min(1)
    assert nearest.max() < 2.0


def test_a_picture_shows_glass_hand_and_surroundings(scene):
    picture = RayTracer(scene.contents).picture(scene.camera, scene.world_from_camera)
    assert picture.shape == (90, 160, 3)
    assert picture.dtype == np.uint8
    assert 40 < picture.mean() < 220
    assert picture.std() > 10
    labels = RayTracer(scene.contents).labels(scene.camera, scene.world_from_camera)
    bare = RayTracer(
        Contents(
            scene.contents.hand,
            (),
            surroundings=scene.contents.surroundings,
            lamps=scene.contents.lamps,
            environment=scene.contents.environment,
        )
    ).picture(scene.camera, scene.world_from_camera)
    np.testing.assert_array_equal(picture[~labels.object_mask], bare[~labels.object_mask])
    changed = np.abs(picture.astype(int) - bare.astype(int)).sum(-1)[labels.object_mask]
    assert (changed > 12).mean() > 0.5


def test_supersampling_is_checked(scene):
    with pytest.raises(ValueError, match="supersample must be 1, 2, 3 or 4 rays per axis, got 0"):
        RayTracer(scene.contents).picture(scene.camera, scene.world_from_camera, supersample=0)
