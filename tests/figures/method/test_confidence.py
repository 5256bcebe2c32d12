import numpy as np

from hadr.confidence.calibration import reliability, sparsification
from hadr.figures.method.confidence import draw_reliability, draw_sparsification, show_confidence


def test_reliability_dots_stand_where_the_numbers_are_and_empty_bins_draw_nothing(ax) -> None:
    bins = reliability(np.array([0.2, 0.2, 0.9, 0.9]), np.array([True, False, True, True]))
    said = [None if np.isnan(v) else float(v) for v in bins.said]  # as read from JSON
    true = [None if np.isnan(v) else float(v) for v in bins.true]
    draw_reliability(ax, said, true, bins.count.tolist())
    dots = np.asarray(ax.collections[-1].get_offsets())
    np.testing.assert_allclose(dots, [(0.2, 0.5), (0.9, 1.0)])
    assert any("mean gap 0.200" in text.get_text() for text in ax.texts)
    assert "2 cm" in ax.get_ylabel()


def test_sparsification_is_in_centimetres_and_marks_the_tenth(ax) -> None:
    error = np.linspace(0, 0.1, 200)
    curve = sparsification(-error, error)
    draw_sparsification(ax, curve.dropped, curve.rmse_m, curve.oracle_rmse_m)
    drawn = next(line for line in ax.lines if len(line.get_xdata()) == 20)
    np.testing.assert_allclose(drawn.get_ydata(), 100 * curve.rmse_m)
    expected = f"{100 * curve.rmse_m[2]:.1f} cm without"
    assert any(expected in text.get_text() for text in ax.texts)


def test_confidence_outside_of_restored_pixels_is_not_drawn(ax) -> None:
    restored = np.zeros((4, 6), bool)
    restored[1, 2] = True
    image = show_confidence(ax, np.full((4, 6), 0.7), restored, "sure", (0.0, 1.0))
    assert (~np.ma.getmaskarray(image.get_array())).sum() == 1
    assert image.get_clim() == (0, 1)
