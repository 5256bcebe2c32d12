import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.colors import to_hex

from hadr.figures.method.metrics import (
    draw_error_rows,
    draw_frame_dots,
    draw_intervals,
    draw_object_dots,
    draw_scored_errors,
    draw_tolerances,
    wide_window,
)
from hadr.figures.panels import COLORS
from hadr.metrics import DepthMetrics, frame_metrics


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


def test_each_row_is_a_frame_and_each_column_a_method():
    _, axes = plt.subplots(2, 3)
    colors = [np.full((4, 6, 3), shade, dtype=np.uint8) for shade in (10, 20)]
    errors = [{m: np.full((4, 6), 0.01 * (i + k)) for k, m in enumerate("ab")} for i in (1, 5)]
    draw_error_rows(axes, colors, errors)
    assert [ax.get_title() for ax in axes[0]] == ["colour", "a", "b"]
    assert axes[1, 0].images[0].get_array()[0, 0, 0] == 20
    shown = [[ax.images[0].get_array()[0, 0] for ax in row[1:]] for row in axes]
    np.testing.assert_allclose(shown, [[1, 2], [5, 6]])


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


def test_objects_stand_in_columns_with_their_mean(ax):
    errors = {
        "guess": {"0000 mug": [0.02, 0.04], "0001 wine glass": [0.05]},
        "ruler": {"0000 mug": [0.01, 0.01], "0001 wine glass": [0.02]},
    }
    draw_object_dots(ax, errors, {"guess": "hand", "ruler": "raw"})
    np.testing.assert_allclose(ax.collections[0].get_offsets(), [[-0.15, 2], [-0.15, 4]])
    np.testing.assert_allclose(ax.collections[3].get_offsets(), [[1.15, 2]])
    np.testing.assert_allclose([line.get_ydata()[0] for line in ax.lines], [3, 5, 1, 2])
    assert [line.get_color() for line in ax.lines[1:3]] == [COLORS["hand"], COLORS["raw"]]
    assert [t.get_text() for t in ax.get_xticklabels()] == ["0000\nmug", "0001\nwine\nglass"]
    assert [t.get_text() for t in ax.get_legend().get_texts()] == ["guess", "ruler"]


def test_intervals_lie_below_each_other(ax):
    intervals = {"a": (0.3, 0.35), "b": (0.6, 0.7)}
    draw_intervals(ax, intervals, {"a": "hadr", "b": "raw"}, "distance (m)", ["b"])
    full, hollow = ax.patches
    assert (hollow.get_x(), hollow.get_width()) == pytest.approx((0.6, 0.1))
    assert to_hex(hollow.get_edgecolor()) == COLORS["raw"]
    assert [to_hex(bar.get_facecolor()) for bar in (full, hollow)] == ["#0072b2", "#ffffff"]
