"""The depth camera's comparison as figure and as text."""

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest

from hadr.plotting.sensor import SENSOR_ROWS, draw_sensor_comparison, sensor_table, show_infrared

mpl.use("Agg")


def row(missing, bias, outside):
    return {"missing_inside": missing, "bias_median_m": bias, "outside_median_abs_m": outside}


COLUMNS = {
    "real_table": {"frames": 2, "each": {"a": row(0.4, 0.01, 0.001), "b": row(0.8, 0.03, 0.002)}},
    "simulated_held": {
        "frames": 3,
        "each": [row(0.5, 0.04, None), row(0.6, float("nan"), 0.003), row(0.9, 2.0, 0.005)],
    },
}


@pytest.fixture(autouse=True)
def _close():
    yield
    plt.close("all")


def test_each_frame_is_a_point_in_its_unit_and_the_bar_is_the_median():
    fig = draw_sensor_comparison(COLUMNS)
    missing, bias, outside = fig.axes
    real, held = missing.lines[:2]
    np.testing.assert_allclose(real.get_ydata(), [40, 80])
    np.testing.assert_allclose(held.get_ydata(), [50, 60, 90])
    np.testing.assert_allclose(bias.lines[1].get_ydata(), [4, 200])
    np.testing.assert_allclose(outside.lines[1].get_ydata(), [3, 5])
    bars = [bar.get_segments()[0][0, 1] for bar in missing.collections]
    assert bars == pytest.approx([60, 60])
    assert [ax.get_ylabel() for ax in fig.axes] == [unit for *_, unit in SENSOR_ROWS]


def test_the_table_tells_median_and_range():
    lines = sensor_table(COLUMNS).splitlines()
    assert "2 frames" in lines[0]
    assert "3 frames" in lines[0]
    assert "60.0 (40.0 to 80.0)" in lines[2]
    assert "60.0 (50.0 to 90.0)" in lines[2]
    assert "102.0 (4.0 to 200.0)" in lines[3]
    assert len({line.count("|") for line in lines}) == 1, "each row has every column"


def test_unknown_groups_are_refused():
    with pytest.raises(ValueError, match="got somebody"):
        draw_sensor_comparison({"somebody": {}})


def test_an_infrared_picture_is_grey():
    _, ax = plt.subplots()
    show_infrared(ax, np.arange(100, dtype=np.uint8).reshape(10, 10), "left")
    image = ax.images[0]
    assert image.get_cmap().name == "gray"
    assert image.get_clim()[1] == pytest.approx(99.7, abs=1.0)
    assert ax.get_title() == "left"
