"""Figures of features: they show what they are given."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
import torch

from hadr.figures.method.features import box_picture, false_color, influence_figure, show_box

PICTURE = np.zeros((32, 64, 3))


def test_false_color_gives_the_strongest_variation_the_red_channel() -> None:
    ramps = torch.linspace(-1, 1, 64).expand(8, 64)
    across = torch.cos(torch.arange(8) * torch.pi)[:, None].expand(8, 64)  # +1, -1 by row
    features = torch.stack((10 * ramps, across, 0.1 * torch.rand(8, 64), 0 * ramps))
    image = false_color(features)
    assert image.shape == (8, 64, 3)
    assert image.min() >= 0
    assert image.max() <= 1
    assert abs(np.corrcoef(image[..., 0].ravel(), ramps.ravel())[0, 1]) > 0.99
    assert abs(np.corrcoef(image[..., 1].ravel(), across.ravel())[0, 1]) > 0.99


def test_aligned_samples_fall_on_pixel_centres() -> None:
    for aligned, first in ((True, 26.0), (False, 26.5)):
        _, ax = plt.subplots()
        show_box(ax, PICTURE, 20, 30, aligned=aligned)
        samples = ax.lines[0].get_xydata()
        assert samples.shape == (64, 2)
        assert samples[:, 0].min() == first
        assert samples[:, 1].min() == first - 10
        left = min(patch.get_x() for patch in ax.patches)
        assert left == first - 0.5
        assert max(patch.get_x() + patch.get_width() for patch in ax.patches) == left + 8


def test_the_box_is_drawn_around_its_pixel_and_its_bins_are_averaged() -> None:
    picture = np.zeros((32, 64, 3))
    picture[6:10, 20:24] = 1.0  # the upper right bin of row 10, column 20
    figure = box_picture(picture, 10, 20)
    whole, enlarged, means = figure.axes
    (square,) = whole.patches
    assert (square.get_x(), square.get_y()) == (15.5, 5.5)
    assert (square.get_width(), square.get_height()) == (8, 8)
    assert len(enlarged.patches) == 4
    np.testing.assert_allclose(means.images[0].get_array()[..., 0], [[0, 1], [0, 0]])


def test_influence_is_relative_to_the_strongest_pixel_of_its_own_map() -> None:
    mask = np.zeros((4, 4), dtype=bool)
    mask[1:3, 1:3] = True
    influence = np.full((4, 4), 0.5)
    influence[0, 0] = 50.0
    fig = influence_figure({"one": influence, "two": 7 * influence}, mask)
    for ax, title in zip(fig.axes, ("one", "two"), strict=False):
        shown = np.asarray(ax.images[0].get_array())
        assert shown[0, 0] == pytest.approx(0, abs=1e-4)
        assert shown[3, 3] == pytest.approx(-2, abs=1e-2)
        assert ax.get_title() == title
