import numpy as np
import pytest

from hadr.synthesis.textures.families import FAMILIES, LEVELS, pyramid, sample, texture_number
from hadr.synthesis.textures.noise import SIZE

SEAMLESS = ("boards", "tiles", "marble", "plaid", "wood", "shingles", "carpet")


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.name)
def test_each_family_paints_varied_pictures_that_can_be_lit(family):
    first, second = (family.paint(np.random.default_rng(seed)) for seed in (1, 2))
    again = family.paint(np.random.default_rng(1))
    np.testing.assert_array_equal(first, again)
    assert first.shape[0] == SIZE
    assert first.shape[1] in (SIZE, 3 * SIZE // 2)
    assert first.dtype == np.float32
    assert np.isfinite(first).all()
    assert first.max() < 2.0
    assert np.abs(first - second).mean() > 0.01
    assert first.std() > 0.01
    assert 0.08 < np.clip(first, 0, 1).mean() < 0.97


@pytest.mark.parametrize("name", SEAMLESS)
def test_materials_repeat_without_a_seam(name):
    """The step from the last column to the first is like other steps; rows too."""
    image = pyramid(texture_number(name, 3))[0].astype(float)
    for axis in (0, 1):
        steps = np.abs(np.diff(image, axis=axis)).mean(axis=tuple({0, 1, 2} - {axis}))
        seam = np.abs(np.take(image, 0, axis) - np.take(image, -1, axis)).mean()
        assert seam <= 1.3 * steps.max() + 1.0


def test_numbers_name_family_and_variant():
    assert texture_number(FAMILIES[0].name, 0) == 0
    assert texture_number(FAMILIES[3].name, 2) == 3 + 2 * len(FAMILIES)
    assert len({family.name for family in FAMILIES}) == len(FAMILIES)
    with pytest.raises(ValueError, match="no family of textures 'chrome'; there are wood,"):
        texture_number("chrome", 0)


def test_look_ups_give_the_pixel_and_far_ones_the_mean():
    number = texture_number("garden", 1)
    levels = pyramid(number)
    assert len(levels) == LEVELS
    height, width = levels[0].shape[:2]
    assert (height, width) == (SIZE, 3 * SIZE // 2)
    at = np.array([[0, 0], [10, 200], [511, 767]])
    uv = np.stack([(at[:, 1] + 0.5) / width, (at[:, 0] + 0.5) / height], axis=1)
    expected = (levels[0][at[:, 0], at[:, 1]] / 255.0) ** 2.2
    found = sample(np.full(3, number), uv, np.ones(3))
    np.testing.assert_allclose(found, expected, atol=1e-6)
    # Three repeats on it is the same place.
    np.testing.assert_allclose(sample(np.full(3, number), uv + 3, np.ones(3)), expected, atol=0.02)
    grid = np.random.default_rng(0).random((4000, 2))
    far = sample(np.full(4000, number), grid, np.full(4000, 64.0))
    near = sample(np.full(4000, number), grid, np.ones(4000))
    assert far.std() < 0.8 * near.std()
    np.testing.assert_allclose((far ** (1 / 2.2)).mean(0), levels[0].mean((0, 1)) / 255, atol=0.03)
