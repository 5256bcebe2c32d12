import numpy as np
import pytest

from hadr.synthesis.rendering.raycast import GLASS, SURROUNDINGS, RayCaster
from hadr.synthesis.rendering.refraction import GLASS_INDEX, follow, ray_path, reflect, refract
from hadr.synthesis.scene.contents import Contents

MIRRORED = ((1.5 - 1) / (1.5 + 1)) ** 2  # Fresnel at normal incidence: 4 %


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


def straight(x: float = 0.0) -> np.ndarray:
    d = np.array([[x, 0.013, 1.0]])
    return d / np.linalg.norm(d)


@pytest.fixture
def caster(plane):
    """Make clear glass before a wall at 2 m, in light of one colour."""
    return lambda *glass: RayCaster(Contents(None, glass, (1.0,), plane([0, 0, 1], 2.0)))


def test_a_pane_lets_through_what_it_does_not_mirror(caster, pane):
    ends, mirrored = follow(caster(pane(0.5, 0.6)), np.zeros((1, 3)), straight())
    on_wall, weight = ends.hits.mesh >= 0, ends.beams.weight[:, 0]
    assert weight[on_wall].max() == pytest.approx((1 - MIRRORED) ** 2, abs=1e-3)
    assert mirrored.weight[0] == pytest.approx(MIRRORED, abs=1e-3)
    # Both single mirror images leave toward the camera and meet nothing.
    assert (ends.beams.direction[~on_wall, 2] < 0).all()
    images = MIRRORED + MIRRORED * (1 - MIRRORED) ** 2
    assert weight[~on_wall].sum() == pytest.approx(images, abs=2e-3)
    assert 0.99 < weight.sum() <= 1.0 + 1e-9


@pytest.mark.parametrize("x", [0.0, 0.3, 0.8])
def test_a_pane_moves_a_ray_aside_by_snells_law(caster, pane, x):
    thickness = 0.1
    d = straight(x)
    ends, _ = follow(caster(pane(0.5, 0.5 + thickness)), np.zeros((1, 3)), d)
    point = ends.point[np.argmax(ends.beams.weight)]
    slope = np.hypot(*d[0, :2]) / d[0, 2]
    sine = np.hypot(*d[0, :2])
    within = np.tan(np.arcsin(sine / 1.5))
    exact = slope * (2.0 - thickness) + within * thickness
    assert np.hypot(*point[:2]) == pytest.approx(exact, abs=1e-5)


def test_overlapping_panes_are_one(caster, pane):
    rays = np.zeros((1, 3)), straight(0.3)
    one, _ = follow(caster(pane(0.5, 0.6)), *rays)
    two, _ = follow(caster(pane(0.5, 0.57), pane(0.54, 0.6)), *rays)
    brightest = [ends.point[np.argmax(ends.beams.weight)] for ends in (one, two)]
    np.testing.assert_allclose(*brightest, atol=1e-5)


def test_without_glass_a_ray_has_one_end(caster):
    ends, mirrored = follow(caster(), np.zeros((3, 3)), np.repeat(straight(), 3, axis=0))
    np.testing.assert_array_equal(ends.beams.row, [0, 1, 2])
    np.testing.assert_allclose(ends.beams.weight, 1)
    np.testing.assert_allclose(ends.point[:, 2], 2.0, atol=1e-6)
    assert (caster().kind(ends.hits.mesh) == SURROUNDINGS).all()
    assert len(mirrored.row) == 0


def test_an_empty_scene_has_no_surface():
    hits = RayCaster(Contents()).first(np.zeros((2, 3)), np.repeat(straight(), 2, axis=0))
    assert (hits.mesh == -1).all()
    assert np.isinf(hits.distance).all()


def test_total_reflection_keeps_the_light_inside(caster, pane):
    """From inside the pane at 60 degrees to the normal, beyond the critical 41.8 degrees."""
    within = caster(pane(0.5, 0.6))
    d = np.array([[np.sin(np.pi / 3), 0.01, np.cos(np.pi / 3)]])
    d /= np.linalg.norm(d)
    origins = np.array([[0.0, 0, 0.55]])
    assert within.kind(within.first(origins, d).mesh)[0] == GLASS
    ends, mirrored = follow(within, origins, d, surfaces=3)
    assert mirrored.weight[0] == 0.0  # it goes on as the ray itself
    assert not len(ends.crossed)


def test_the_path_through_a_pane_by_hand(caster, pane):
    """At 30 degrees: in at 0.5 m, bent to asin(sin 30 / 1.5), out at 0.52 m as it came."""
    scene = caster(pane(0.5, 0.52))
    sine, cosine = np.sin(np.pi / 6), np.cos(np.pi / 6)
    path = ray_path(scene, np.zeros(3), np.array([sine, 0, cosine]))
    x_in = 0.5 * sine / cosine
    x_out = x_in + 0.02 * np.tan(np.arcsin(sine / 1.5))
    x_wall = x_out + 1.48 * sine / cosine
    expected = [[0, 0, 0], [x_in, 0, 0.5], [x_out, 0, 0.52], [x_wall, 0, 2.0]]
    np.testing.assert_allclose(path, expected, atol=2e-5)
