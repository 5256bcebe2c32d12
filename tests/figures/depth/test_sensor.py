"""The depth camera's comparison as figure and as text."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from hadr.figures.depth.sensor import (
    SENSOR_ROWS,
    corrupt_glass,
    draw_sensor_comparison,
    draw_stereo_camera,
    see_through_picture,
    sensor_table,
)


def row(missing, bias, outside):
    return {"missing_inside": missing, "bias_median_m": bias, "outside_median_abs_m": outside}


COLUMNS = {
    "real_table": {"frames": 2, "each": {"a": row(0.4, 0.01, 0.001), "b": row(0.8, 0.03, 0.002)}},
    "simulated_held": {
        "frames": 3,
        "each": [row(0.5, 0.04, None), row(0.6, float("nan"), 0.003), row(0.9, 2.0, 0.005)],
    },
}


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
    assert "102.0 (4.0 to 200.0; 2 frames)" in lines[3]
    assert len({line.count("|") for line in lines}) == 1, "each row has every column"


def test_a_glass_seen_through_shows_the_chosen_shares(frame_of):
    figure = see_through_picture(frame_of(), 0.25, 1.0, 0)
    titles = [ax.get_title() for ax in figure.axes[:3]]
    assert titles == ["colour", "25% of the glass missing", "median error +30.0 cm"]
    error = figure.axes[2].images[0].get_array()
    inside = error[error.shape[0] // 2 - 10 :][:20, error.shape[1] // 2 - 10 :][:, :20]
    assert inside.mask.sum() == 100
    np.testing.assert_allclose(inside.compressed(), 30, rtol=1e-5)
    missing = see_through_picture(frame_of(), 1.0, 0.5, 0)
    assert missing.axes[2].get_title() == "median error none"
    assert tuple(missing.get_size_inches()) == tuple(figure.get_size_inches())


@pytest.mark.parametrize("glass", [False, True])
def test_the_camera_measures_the_wall_but_not_through_glass(glass: bool, ax) -> None:
    """Without glass the imagers' rays are straight; with it their continuations meet before."""
    draw_stereo_camera(ax, glass, "title")
    lines = [line.get_xydata() for line in ax.lines if len(line.get_xdata()) == 3]
    assert len(lines) == 3, "the projector's ray and one for each imager"
    for points in lines:
        np.testing.assert_allclose(points[-1], (0.12, 1.0))
    turns = [np.linalg.det(np.diff(points, axis=0)) for points in lines]
    assert turns[0] == pytest.approx(0, abs=1e-12)
    assert all(abs(turn) > 1e-3 for turn in turns[1:]) == glass
    ghosts = [line.get_xydata()[0] for line in ax.lines if line.get_marker() == "x"]
    assert len(ghosts) == int(glass)
    if glass:
        assert 0.55 < ghosts[0][1] < 1.0, "between glass and wall"


def test_the_sliders_mix_missing_and_background() -> None:
    depth, background = np.full((40, 40), 0.6, np.float32), np.full((40, 40), 0.9, np.float32)
    mask = np.zeros((40, 40), bool)
    mask[10:30, 10:30] = True
    sliders = corrupt_glass(depth, background, mask)
    assert [child.description for child in sliders.children[:2]] == ["missing", "background"]
    sliders.f(missing=0.25, background=1.0)
    assert plt.gca().get_title() == "25% missing, median error +30.0 cm"
    sliders.f(missing=0.5, background=0.0)
    assert plt.gca().get_title() == "50% missing, median error +0.0 cm"
