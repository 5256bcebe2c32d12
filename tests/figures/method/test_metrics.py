import matplotlib.pyplot as plt
import numpy as np
import pytest

from hadr.figures.method.metrics import (
    averages_picture,
    draw_frame_dots,
    draw_scored_errors,
    draw_tolerances,
    wide_window,
)
from hadr.figures.panels import COLORS
from hadr.metrics import DepthMetrics, frame_metrics

SIZES, ERRORS = (100, 400, 1600), (0.03, 0.2)


def metrics(*errors_m: float) -> DepthMetrics:
    truth = np.full((1, len(errors_m)), 0.7)
    return frame_metrics(truth + np.array([errors_m]), truth, np.ones_like(truth, dtype=bool))


def test_error_maps_carry_their_scores():
    fig, axes = plt.subplots(1, 2)
    errors = {"few": np.array([[0.0, 0.02]]), "all": np.array([[-0.01, -0.01]])}
    scores = {name: metrics(*e[0]) for name, e in errors.items()}
    draw_scored_errors(axes, errors, scores)
    assert [ax.get_title() for ax in axes] == ["few", "all"]
    labels = [ax.get_xlabel() for ax in axes]
    assert labels == ["RMSE 1.4 cm\nMAE 1.0 cm", "RMSE 1.0 cm\nMAE 1.0 cm"]
    np.testing.assert_allclose(axes[1].images[0].get_array(), [[-1, -1]])
    assert axes[0].images[0].get_clim() == (-3, 3)
    assert [ax.get_ylabel() for ax in fig.axes[2:]] == ["error (cm)"]


def test_window_is_three_to_two_around_the_mask():
    mask = np.zeros((100, 200), dtype=bool)
    mask[40:61, 95:106] = True  # 20 high, 10 wide, middle (50, 100)
    assert wide_window(mask) == (slice(33, 67), slice(74, 125))
    mask[:, :] = False
    mask[50, 70:131] = True  # 60 wide: half = 1.7 * (60 / 1.5) / 2
    assert wide_window(mask) == (slice(16, 84), slice(49, 151))
    mask[:, :] = False
    mask[:20, :10] = True  # half = 1.7 * 19 / 2, around (9.5, 4.5)
    assert wide_window(mask) == (slice(0, 25), slice(0, 28))


def test_tolerances_are_drawn_in_centimetres_widest_first(ax):
    distance = np.array([0.2, 1.2])
    bands = {t: (distance / t - distance, distance * t - distance) for t in (1.05, 1.25)}
    draw_tolerances(ax, distance, bands, {0.7: "a handover"})
    lines = [line for line in ax.lines if line.get_linestyle() == "-"]
    np.testing.assert_allclose(lines[0].get_ydata(), [5, 30])
    np.testing.assert_allclose(lines[1].get_ydata(), [-4, -24])
    np.testing.assert_allclose(lines[2].get_ydata(), [1, 6])
    assert lines[2].get_color() == COLORS["hadr"]
    labels = {text.get_text(): text.get_position() for text in ax.texts}
    assert labels["δ1.25"] == pytest.approx((1.21, 30))
    assert labels["a handover"][0] == pytest.approx(0.71)
    assert "±1 cm" in labels


def test_a_dot_for_each_frame_and_a_bar_for_each_average(ax):
    frames = {"far": [metrics(0.3), metrics(0.5)], "near": [metrics(0.01)]}
    averages = {
        "mean over frames": {"far": metrics(0.4), "near": metrics(0.01)},
        "pooled": {"far": metrics(0.45), "near": metrics(0.02)},
    }
    draw_frame_dots(ax, frames, averages, np.random.default_rng(0))
    np.testing.assert_allclose(ax.collections[0].get_offsets()[:, 0], [30, 50])
    np.testing.assert_allclose(ax.collections[1].get_offsets()[:, 1], 1, atol=0.12)
    bars = [line.get_xdata()[0] for line in ax.lines]
    np.testing.assert_allclose(bars, [40, 45, 1, 2])
    assert [line.get_color() for line in ax.lines[:2]] == [COLORS["hadr"], COLORS["baseline"]]
    assert [t.get_text() for t in ax.get_legend().get_texts()] == list(averages)
    assert [t.get_text() for t in ax.get_yticklabels()] == ["far", "near"]
    assert ax.get_xscale() == "log"
    assert ax.yaxis_inverted()


def averages(size, error):
    ax = next(ax for ax in averages_picture(SIZES, ERRORS, size, error).axes if ax.get_xlabel())
    return {line.get_label().split(":")[0]: line for line in ax.lines if ":" in line.get_label()}


def test_dots_stand_at_the_size_and_both_averages():
    dots = averages(2, 1)
    assert [float(dot.get_xdata()[0]) for dot in dots.values()] == [1600, 1600]
    assert dots["mean over frames"].get_ydata()[0] == pytest.approx((9 * 1 + 20) / 10)
    assert dots["pooled"].get_ydata()[0] == pytest.approx((3600 * 1 + 1600 * 20) / 5200)
    assert dots["pooled"].get_label() == "pooled: 6.85 cm"
