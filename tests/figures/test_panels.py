import matplotlib as mpl
import numpy as np
import pytest

from hadr.figures.panels import (
    FINGER_COLORS,
    frame_strip,
    show_color,
    show_depth,
    show_error,
    show_keypoints,
    show_mask,
    use_style,
)


@pytest.fixture(autouse=True)
def _style():
    with mpl.rc_context():
        use_style()
        yield


@pytest.fixture
def depth():
    image = np.linspace(0.5, 0.9, 24).reshape(4, 6)
    image[0, 0], image[1, 1] = 0.0, np.nan
    return image


def test_depth_has_a_labelled_bar_and_robust_limits(ax, depth):
    image = show_depth(ax, depth, "truth")
    valid = depth[np.isfinite(depth) & (depth > 0)]
    assert image.get_clim() == pytest.approx(tuple(np.percentile(valid, (1, 99))))
    assert np.ma.getmaskarray(image.get_array()).sum() == 2
    assert [a.get_ylabel() for a in ax.figure.axes[1:]] == ["depth (m)"]
    assert ax.get_title() == "truth"


def test_depth_that_is_missing_everywhere_still_draws(ax):
    show_depth(ax, np.zeros((3, 3)))


def test_missing_depth_is_drawn_apart_from_every_depth(depth, ax):
    image = show_depth(ax, depth, colorbar=False)
    missing = image.cmap(np.ma.masked_all(1))[0, :3]
    colours = image.cmap(np.linspace(0, 1, 256))[:, :3]
    assert np.abs(colours - missing).sum(axis=1).min() > 0.3


def test_error_is_symmetric_and_in_centimetres(ax):
    error = np.array([[0.01, -0.02], [np.nan, 0.0]])
    image = show_error(ax, error, "error", limit=0.03)
    assert image.get_clim() == pytest.approx((-3.0, 3.0))
    np.testing.assert_allclose(image.get_array().compressed(), [1.0, -2.0, 0.0])
    assert ax.figure.axes[1].get_ylabel() == "error (cm)"
    # Behind is red, in front is blue, and none is (nearly) white.
    red, blue, white = (image.cmap(v)[:3] for v in (0.9, 0.1, 0.5))
    assert red[0] > red[2]
    assert blue[2] > blue[0]
    assert min(white) > 0.9


def test_mask_is_laid_over_the_image_only_where_it_is_set(ax):
    show_color(ax, np.zeros((4, 6, 3), np.uint8))
    mask = np.zeros((4, 6), bool)
    mask[1, 2] = True
    overlay = show_mask(ax, mask, "#ff0000", 0.5).get_array()
    assert overlay[1, 2].tolist() == [1.0, 0.0, 0.0, 0.5]
    assert overlay[..., 3].sum() == 0.5


def test_keypoints_draw_twenty_bones_in_finger_colours(ax):
    uv = np.random.default_rng(0).uniform(0, 100, (21, 2))
    show_keypoints(ax, uv)
    coloured = [line for line in ax.lines if line.get_color() != "white"]
    assert len(coloured) == 20
    assert {line.get_color() for line in coloured} == set(FINGER_COLORS.values())
    index_root = coloured[4].get_xydata()
    np.testing.assert_allclose(index_root, uv[[0, 5]])


def test_strip_shares_one_depth_scale_and_one_bar(depth):
    color = np.zeros((4, 6, 3), np.uint8)
    fig = frame_strip([color, depth, depth * 2, depth > 0.7], ["a", "b", "c", "d"])
    pictures = [a for a in fig.axes if a.get_title()]
    assert [a.get_title() for a in pictures] == ["a", "b", "c", "d"]
    assert pictures[1].images[0].get_clim() == pictures[2].images[0].get_clim()
    bars = [a for a in fig.axes if a.get_ylabel() == "depth (m)"]
    assert len(bars) == 1
    assert fig.get_size_inches()[0] <= 9
    fig.canvas.draw()


def test_strip_with_wrong_titles():
    with pytest.raises(ValueError, match="2 images, but 1 titles"):
        frame_strip([np.zeros((4, 6, 3), np.uint8)] * 2, ["a"])
