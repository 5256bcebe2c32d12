import numpy as np
import pytest

from hadr.data import augmentation
from hadr.data.augmentation import (
    augment_color,
    blur_or_noise,
    bright_patches,
    coarse_dropout,
    color_jitter,
)

PICTURE = np.random.default_rng(0).integers(20, 236, (36, 64, 3), dtype=np.uint8)


def test_the_same_seed_gives_the_same_picture_and_leaves_the_input_alone(monkeypatch):
    monkeypatch.setattr(augmentation, "CHANGES", [(1.0, c) for _, c in augmentation.CHANGES])
    before = PICTURE.copy()
    first = augment_color(PICTURE, np.random.default_rng(3))
    np.testing.assert_array_equal(first, augment_color(PICTURE, np.random.default_rng(3)))
    np.testing.assert_array_equal(PICTURE, before)
    assert first.shape == PICTURE.shape
    assert first.dtype == np.uint8
    assert (first != PICTURE).mean() > 0.2


def test_how_often_a_picture_is_left_alone():
    """0.9 * 0.7 * 0.8 * 0.8 = 0.4032 of the pictures pass unchanged."""
    rng = np.random.default_rng(0)
    same = np.mean([np.array_equal(augment_color(PICTURE, rng), PICTURE) for _ in range(600)])
    assert same == pytest.approx(0.4032, abs=0.06)


def test_each_change_does_what_it_says():
    color = (PICTURE / 255.0).astype(np.float32)
    rng = np.random.default_rng(5)
    brighter = bright_patches(color, rng)
    assert (brighter >= color - 1e-6).all()
    dropped = coarse_dropout(color, rng)
    black = (dropped == 0).all(-1)
    assert 0 < black.mean() < 0.2
    np.testing.assert_array_equal(dropped[~black], color[~black])
    assert color_jitter(color, rng).min() >= 0.0
    assert color_jitter(color, rng).max() <= 1.0
    noisy = [blur_or_noise(color, np.random.default_rng(i)) for i in range(12)]
    assert any(n.std() < 0.9 * color.std() for n in noisy)  # blurred
    assert any(abs(n.std() / color.std() - 1) < 0.05 for n in noisy)  # noise


def test_gray_stays_gray_under_hue():
    gray = np.full((4, 4, 3), 0.5, np.float32)
    changed = color_jitter(gray, np.random.default_rng(0))
    np.testing.assert_allclose(changed, changed[..., :1].repeat(3, -1), atol=1e-6)


def test_errors():
    with pytest.raises(ValueError, match=r"\(H, W, 3\) uint8, got \(36, 64, 3\) float64"):
        augment_color(PICTURE / 255.0, np.random.default_rng(0))
