"""Pictures of frames: what stands where, and in which colours."""

from dataclasses import replace

import numpy as np
import pytest

from hadr.camera import Intrinsics, back_project
from hadr.figures.depth.frames import (
    contact_sheet,
    draw_angles,
    draw_labels,
    draw_statistics,
    normal_colors,
    normals_from_depth,
)
from hadr.synthesis.generation.statistics import FrameStatistics

CAMERA = Intrinsics(50.0, 50.0, 19.5, 9.5, 40, 20)


def images_of(fig, title):
    return [ax.images[0] for ax in fig.axes if ax.get_title() == title]


def test_a_sheet_has_a_place_for_each_picture_and_empty_ones_at_the_end():
    pictures = [np.full((9, 16, 3), 10 * k, np.uint8) for k in range(5)]
    fig = contact_sheet(pictures, [f"p{k}" for k in range(5)], columns=3)
    shown = [ax for ax in fig.axes if ax.images]
    assert [ax.get_title() for ax in shown] == ["p0", "p1", "p2", "p3", "p4"]
    assert [int(ax.images[0].get_array()[0, 0, 0]) for ax in shown] == [0, 10, 20, 30, 40]
    assert len(fig.axes) == 6


def test_a_sheet_of_nothing_or_with_other_titles_is_refused():
    with pytest.raises(ValueError, match="needs pictures"):
        contact_sheet([], columns=1)
    with pytest.raises(ValueError, match="1 pictures, but 2 titles"):
        contact_sheet([np.zeros((2, 2, 3), np.uint8)], ["a", "b"], columns=1)


def test_labels_show_raw_error_in_centimetres_and_grey_where_missing(frame_of):
    raw = np.full((40, 60), 0.52, np.float32)
    raw[0, 0] = 0.0
    fig = draw_labels(frame_of(raw_depth=raw), np.zeros((40, 60, 3)))
    error = images_of(fig, "sensor minus true")[0].get_array()
    assert error.mask[0, 0]
    assert float(error[15, 25]) == pytest.approx(2.0, abs=1e-4)
    behind = images_of(fig, "without the glass minus true")[0].get_array()
    assert float(behind[15, 25]) == pytest.approx(30.0, abs=1e-4)
    assert behind.mask[0, 0]


def test_a_frame_without_raw_depth_is_refused(frame_of):
    with pytest.raises(ValueError, match="000007 lacks raw depth"):
        draw_labels(frame_of(raw_depth=None), np.zeros((*CAMERA.shape, 3)))


def test_normals_of_a_wall_and_of_a_slope():
    wall = back_project(np.full(CAMERA.shape, 0.7, np.float32), CAMERA)
    np.testing.assert_allclose(
        normals_from_depth(wall)[:-1, :-1], np.broadcast_to([0, 0, -1.0], (19, 39, 3)), atol=1e-5
    )
    # A floor y = 0.2 m: its normal toward the camera above it is -y.
    v = np.arange(12, 20, dtype=np.float32)[:, None]
    depth = np.zeros(CAMERA.shape, np.float32)
    depth[12:] = 0.2 * CAMERA.fy / (v - CAMERA.cy)
    floor = normals_from_depth(back_project(depth, CAMERA))
    assert floor.shape == (*CAMERA.shape, 3)
    np.testing.assert_allclose(
        floor[12:-1, :-1], np.broadcast_to([0, -1.0, 0], (7, 39, 3)), atol=1e-5
    )
    np.testing.assert_array_equal(floor[:11], 0)


def test_normals_have_the_colours_that_the_text_names():
    toward, up, right = [0, 0, -1.0], [0, -1.0, 0], [1.0, 0, 0]
    colors = normal_colors(np.array([[toward, up, right, [0, 0, 0]]]))
    np.testing.assert_allclose(colors[0, 0], [0.5, 0.5, 1.0])
    np.testing.assert_allclose(colors[0, 1], [0.5, 1.0, 0.5])
    np.testing.assert_allclose(colors[0, 2], [1.0, 0.5, 0.5])
    np.testing.assert_allclose(colors[0, 3], 0.85)


def test_histograms_count_every_frame_and_tell_the_median():
    rng = np.random.default_rng(0)
    views = ("distance_m", "glass_depth_m", "glass_share", "hand_share", "visible_share")
    columns = {name: rng.random(50) for name in views}
    raw = {name: rng.random(50) for name in ("missing_share", "bias_m", "hand_error_m")}
    names = ("0000",) * 50
    table = FrameStatistics(
        names, names, names, **columns, **raw, world_error_m=np.full(50, np.nan)
    )
    fig = draw_statistics(table)
    for ax in fig.axes:
        assert sum(bar.get_height() for bar in ax.patches) == 50
    assert fig.axes[0].texts[0].get_text() == f" {np.median(columns['distance_m']):.3g}"
    empty = FrameStatistics(names, names, names, **columns, **{k: np.full(50, np.nan) for k in raw},
                            world_error_m=np.full(50, np.nan))  # fmt: skip
    fig = draw_statistics(empty)
    assert [ax.texts[0].get_text() for ax in fig.axes[3:]] == ["not stored"] * 3
    for values, bars in ((np.full(50, 0.001), 24), (np.arange(50) % 5 * 0.0001, 5)):
        same = replace(table, hand_error_m=values)  # all alike, or stored in steps
        tall = [bar.get_height() for bar in draw_statistics(same).axes[5].patches]
        assert (sum(tall), len(tall)) == (50, bars)


def test_angles_stand_beside_what_is_allowed():
    angles = np.deg2rad(np.stack([np.linspace(-10, 10, 21), np.linspace(20, 40, 21)], axis=1))
    fig = draw_angles(angles, np.deg2rad([[-30, 40], [0, 90]]), ["a_b", "c_d"])
    bars = fig.axes[0].patches
    assert [(bar.get_x(), bar.get_width()) for bar in bars] == [
        (pytest.approx(-30), pytest.approx(70)),
        (pytest.approx(0), pytest.approx(90)),
    ]
    np.testing.assert_allclose(fig.axes[0].lines[-1].get_xdata(), [0, 30], atol=1e-9)
    with pytest.raises(ValueError, match="belong together"):
        draw_angles(angles, np.zeros((3, 2)), ["a", "b"])
