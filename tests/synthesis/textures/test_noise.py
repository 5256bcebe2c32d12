import numpy as np

from hadr.synthesis.textures.noise import noise


def test_noise_repeats_and_fills_its_range():
    field = noise(np.random.default_rng(0), (4, 6), 3)
    assert field.min() == 0.0
    assert field.max() == 1.0
    seam = np.abs(field[0] - field[-1]).max()
    assert seam <= np.abs(np.diff(field, axis=0)).max() * 1.2
