import pytest

from hadr.figures.method.averaging import averages_picture, both_averages

SIZES, ERRORS = (100, 400, 1600), (0.03, 0.2)


def test_both_averages_of_the_chapters_example():
    mean, pot = both_averages([100, 900], [0.03, 0.01])
    assert (mean.mae_m, pot.mae_m) == pytest.approx((0.02, 0.012))


def averages(size, error):
    ax = next(ax for ax in averages_picture(SIZES, ERRORS, size, error).axes if ax.get_xlabel())
    return {line.get_label().split(":")[0]: line for line in ax.lines if ":" in line.get_label()}


def test_dots_stand_at_the_size_and_both_averages():
    dots = averages(2, 1)
    assert [float(dot.get_xdata()[0]) for dot in dots.values()] == [1600, 1600]
    assert dots["mean over frames"].get_ydata()[0] == pytest.approx((9 * 1 + 20) / 10)
    assert dots["pooled"].get_ydata()[0] == pytest.approx((3600 * 1 + 1600 * 20) / 5200)
    assert dots["pooled"].get_label() == "pooled: 6.85 cm"
