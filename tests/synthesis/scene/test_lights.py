import numpy as np
import pytest

from hadr.synthesis.scene.lights import AreaLight, Environment, make_lights


def test_radiance_is_found_where_the_picture_has_it():
    rng = np.random.default_rng(0)
    environment = Environment(rng.random((16, 32, 3), dtype=np.float32))
    directions = environment.directions()
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0)
    found = environment.radiance(directions.reshape(-1, 3)).reshape(16, 32, 3)
    np.testing.assert_allclose(found, environment.image, atol=1e-5)


def test_rows_run_from_the_zenith_and_columns_with_the_azimuth():
    image = np.zeros((90, 180, 3), dtype=np.float32)
    image[:45] = [1, 0, 0]  # above the horizon
    image[45:, :90] = [0, 1, 0]  # below it, y > 0
    image[45:, 90:] = [0, 0, 1]  # below it, y < 0
    seen = Environment(image).radiance(np.array([[0, 0, 1.0], [0.6, 0.7, -0.4], [0.6, -0.7, -0.4]]))
    np.testing.assert_allclose(seen, np.eye(3), atol=1e-6)


def test_irradiance_of_an_even_sky_and_of_half_a_sky():
    """Integral of the cosine: pi over a whole half space, pi/2 where half of it is dark."""
    normals = np.array([[0, 0, 1.0], [1, 0, 0], [0, 0, -1.0]])
    even = Environment(np.full((64, 128, 3), 1.0, dtype=np.float32))
    np.testing.assert_allclose(even.irradiance(normals), np.pi, rtol=0.002)
    half = np.zeros((64, 128, 3), dtype=np.float32)
    half[:32] = 1.0
    found = Environment(half).irradiance(normals)[:, 0]
    np.testing.assert_allclose(found, [np.pi, np.pi / 2, 0.0], atol=0.01)


def panel() -> AreaLight:
    return AreaLight(
        np.array([0, 0, 2.0]), np.array([0.0, 0.3, 0]), np.array([0.2, 0, 0]), np.array([5, 6, 7.0])
    )


def test_a_panel_is_seen_from_its_shining_side_only():
    lamp = panel()
    np.testing.assert_allclose(lamp.normal, [0, 0, -1])
    assert lamp.area == pytest.approx(0.6 * 0.4)
    origins = np.array([[0, 0, 0.0], [0, 0.29, 0], [0, 0.31, 0], [0.21, 0, 0], [0, 0, 3.0]])
    directions = np.array([[0, 0, 1.0]] * 4 + [[0, 0, -1.0]])
    seen = lamp.radiance(origins, directions, np.full(5, np.inf))
    np.testing.assert_allclose(seen[:2], [[5, 6, 7]] * 2)
    np.testing.assert_allclose(seen[2:], 0.0)
    # What is nearer hides it.
    assert not lamp.radiance(origins[:1], directions[:1], np.array([1.9])).any()
    assert lamp.radiance(origins[:1], directions[:1], np.array([2.1])).any()


def test_irradiance_of_a_panel_by_hand():
    lamp = panel()
    found = lamp.irradiance(np.zeros((2, 3)), np.array([[0, 0, 1.0], [0, 0.8, 0.6]]))
    straight = np.array([5, 6, 7]) * 0.24 / 4.0
    np.testing.assert_allclose(found, [straight, 0.6 * straight])


@pytest.mark.parametrize("seed", range(6))
def test_white_paper_that_faces_the_camera_is_about_white(seed):
    rng = np.random.default_rng(seed)
    eye, middle = np.array([0.6, 0.1, 0.3]), np.zeros(3)
    environment, lamps = make_lights(eye, middle, rng)
    back = (eye - middle) / np.linalg.norm(eye - middle)
    up = back + np.array([0, 0, 0.8])
    normals = np.stack([back, up / np.linalg.norm(up)])
    total = environment.irradiance(normals)
    for lamp in lamps:
        total = total + lamp.irradiance(np.zeros((2, 3)), normals)
        # Lamps stand behind the camera or above it, never between it and the hand.
        assert np.linalg.norm(lamp.center) > 1.3
        assert lamp.normal @ lamp.center < 0
    assert 0.94 * np.pi < total.mean() < 1.26 * np.pi
    assert np.isfinite(environment.image).all()
    assert environment.image.min() >= 0
