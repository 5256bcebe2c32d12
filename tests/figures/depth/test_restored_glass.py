"""The restored glass: which frames, what of them, and the errors that are written down."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from hadr.camera import Intrinsics
from hadr.figures.depth.restored_glass import (
    draw_clouds,
    draw_restored,
    frames_at,
    restored_clouds,
    square_window,
)
from hadr.frame_io import read_color

CAMERA = Intrinsics(100.0, 100.0, 29.5, 19.5, 60, 40)


@pytest.fixture
def glass(frame_of):
    """A flat glass of 10 x 20 pixels, half a metre away, before a wall at two metres."""
    mask = np.zeros(CAMERA.shape, bool)
    mask[10:20, 30:50] = True
    depth = np.where(mask, 0.5, 2.0).astype(np.float32)
    hand = np.zeros_like(mask)
    return frame_of(camera=CAMERA, depth=depth, object_mask=mask, hand_mask=hand)


def test_frames_are_chosen_by_the_share_of_smaller_errors():
    assert frames_at([0.3, 0.1, 0.5, 0.2, 0.4], (0, 0.25, 0.5, 1)) == [1, 3, 0, 2]


def test_the_window_is_a_square_around_the_mask_and_inside_of_the_image():
    mask = np.zeros((40, 60), bool)
    mask[0:10, 44:60] = True
    rows, columns = square_window(mask, margin=1.25)
    assert (rows, columns) == (slice(0, 20), slice(40, 60))
    assert mask[rows, columns].sum() == mask.sum()


def test_a_method_has_its_depth_and_its_error_of_the_glass_alone(glass):
    off = glass.depth + np.float32(0.02)
    off[10:15] = 0
    fig = draw_restored([glass], {"theirs": [off]}, ["a frame"])
    color, theirs, truth, below = fig.axes[:4]
    assert [ax.get_title() for ax in (color, theirs)] == ["colour and\ntruth", "theirs"]
    error = below.images[0].get_array()
    assert error.count() == 100  # neither the wall nor what is missing
    np.testing.assert_allclose(error.compressed(), 2, rtol=1e-4)
    assert below.texts[0].get_text() == "50 % missing\n2.0 cm"
    np.testing.assert_allclose(theirs.images[1].get_array().compressed(), 2, rtol=1e-4)
    np.testing.assert_allclose(truth.images[1].get_array().compressed(), 0, atol=1e-4)


def test_clouds_have_what_is_near_the_glass_and_mark_it(glass):
    hole = np.where(glass.object_mask, 0, glass.depth)
    hole[10, 29] = 0.5  # a neighbour that is as near
    depths = {"hole": hole, "ours": glass.depth - np.float32(0.01), "truth": glass.depth}
    clouds = restored_clouds(glass, depths)
    assert [len(cloud.points) for cloud in clouds] == [1, 200, 200]
    assert clouds[0].note == "hole, on the glass: all missing"
    assert clouds[1].note == "ours, on the glass: 1.0 cm"
    assert (clouds[0].colors == glass.color[10, 29]).all()
    assert (clouds[2].colors != glass.color[glass.object_mask]).any()
    for cloud in clouds:
        np.testing.assert_allclose(cloud.center, clouds[2].center)
    drawn = draw_clouds(clouds).axes
    assert [len(ax.collections[0].get_offsets()) for ax in drawn] == [1, 200, 200]


def test_the_picture_of_the_first_page_is_drawn(tmp_path, monkeypatch):
    script = Path(__file__).parents[3] / "book" / "restored_frame.py"
    monkeypatch.setattr("sys.argv", [str(script), "--out", str(tmp_path / "drawn.png")])
    runpy.run_path(str(script), run_name="__main__")
    assert read_color(tmp_path / "drawn.png").shape[1] > 1000
