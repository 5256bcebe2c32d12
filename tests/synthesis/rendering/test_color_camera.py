from dataclasses import replace

import numpy as np
import pytest

from hadr.synthesis.rendering.color_camera import ColorCamera, develop, exposure, film

CLEAN = ColorCamera(brightness=0.3, vignetting=0.0, blur=0.0, full_well=1e12, read_noise=0.0)


def test_film_is_linear_below_its_knee_and_never_falls():
    light = np.linspace(0, 6, 200)
    shown = film(light)
    np.testing.assert_allclose(shown[light <= 0.6], light[light <= 0.6])
    assert (np.diff(shown) > 0).all()
    assert shown.max() < 1.0
    # The slope has no step at the knee.
    assert (film(np.array([0.601])) - 0.6)[0] == pytest.approx(0.001, rel=0.01)


def test_a_grey_card_has_the_grey_of_the_formula():
    picture = develop(np.full((20, 30, 3), 0.3), np.random.default_rng(0), CLEAN)
    assert (picture == round(255 * 0.3 ** (1 / 2.2))).all()


def test_automatic_exposure_reaches_its_brightness_within_its_limits():
    camera = ColorCamera(brightness=0.4, exposures=(0.5, 2.0))
    assert exposure(np.full((9, 9, 3), 0.25), camera) == pytest.approx(1.6)
    assert exposure(np.full((9, 9, 3), 0.01), camera) == 2.0
    assert exposure(np.full((9, 9, 3), 50.0), camera) == 0.5
    # One pixel in ten is bright: it may not burn out, so the rest stays darker.
    light = np.full((10, 10, 3), 0.2)
    light[0] = 1.0
    assert exposure(light, camera) == pytest.approx(0.85)


def test_noise_is_that_of_electrons():
    camera = replace(CLEAN, full_well=5000.0, read_noise=20.0)
    picture = develop(np.full((300, 300, 3), 0.3), np.random.default_rng(1), camera)
    light = (picture / 255.0) ** 2.2
    assert light.mean() == pytest.approx(0.3, rel=0.01)
    expected = np.sqrt(0.3 * 5000 + 20.0**2) / 5000
    assert light.std() == pytest.approx(expected, rel=0.05)


def test_corners_lose_their_share_of_light():
    camera = replace(CLEAN, vignetting=0.2)
    light = (develop(np.full((90, 160, 3), 0.3), np.random.default_rng(0), camera) / 255.0) ** 2.2
    assert light[45, 80, 0] == pytest.approx(0.3, rel=0.02)
    assert light[0, 0, 0] == pytest.approx(0.3 * 0.8, rel=0.03)
