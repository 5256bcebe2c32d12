import numpy as np
import pytest

from hadr.figures.method.error_kinds import Source, error_kinds_picture


@pytest.fixture
def source():
    """A glass of 16 pixels' side before a wall; the 12 inner ones count as in the glass."""
    truth = np.full((60, 80), 0.8, np.float32)
    mask = np.zeros(truth.shape, bool)
    mask[20:36, 30:46] = True
    truth[mask] = 0.7
    truth[22:24, 32:44] = 0.0  # unknown: a sixth of the inner pixels
    measured = np.where(mask, 0.8, 0.801).astype(np.float32)  # 10 cm behind
    measured[24:29, 30:46] = 0.0  # half of the known ones
    return Source("made up", measured, truth, mask)


def test_shares_errors_and_what_is_unknown(source):
    np.testing.assert_allclose(source.shares("in the glass"), [0.5, 0, 0, 0, 0.5, 0])
    np.testing.assert_allclose(source.errors_m("in the glass"), 0.1, atol=1e-6)
    assert source.errors_m("in the glass").size == 5 * 12
    np.testing.assert_allclose(source.shares("elsewhere"), [0, 0, 1, 0, 0, 0])
    np.testing.assert_allclose(source.errors_m("elsewhere"), 0.001, atol=1e-6)


def test_without_a_picture_nothing_is_counted(source):
    empty = Source("none", None, source.truth, source.mask, note="not to be had")
    assert np.isnan(empty.shares("in the glass")).all()
    assert empty.errors_m("in the glass").size == 0
    figure = error_kinds_picture([empty, source], "in the glass")
    assert "not to be had" in [text.get_text() for ax in figure.axes for text in ax.texts]


def bars(figure):
    ax = next(ax for ax in figure.axes if ax.get_xlabel() == "cm behind the truth")
    return ax, [bar.get_height() for bar in ax.patches]


def test_the_picture_shows_the_shares_of_its_place(source):
    ax, heights = bars(error_kinds_picture([source], "in the glass"))
    assert heights == pytest.approx([50, 0, 0, 0, 50, 0])
    assert ax.texts[-1].get_text() == "median +10.00 cm, size 10.00 cm\ntruth unknown: 17%"
    _, heights = bars(error_kinds_picture([source], "elsewhere"))
    assert heights == pytest.approx([0, 0, 100, 0, 0, 0])
    sizes = {tuple(error_kinds_picture([source], p).get_size_inches()) for p in source.places}
    assert len(sizes) == 1
