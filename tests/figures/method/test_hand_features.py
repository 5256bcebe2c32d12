import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.colors import to_hex

from hadr.figures.method.hand_features import (
    draw_depth_hint,
    draw_voxel_arrows,
    draw_wrist_frame,
)
from hadr.figures.method.hands import on_screen, orbit_view
from hadr.figures.panels import COLORS
from hadr.hand import forward_kinematics, keypoints_from_skeleton

FLAT = keypoints_from_skeleton(forward_kinematics(np.zeros(20)).joints)
FRONT = orbit_view(0, 0)


@pytest.fixture
def axes():
    fig, row = plt.subplots(1, 2)
    yield row
    fig.canvas.draw()


def test_hint_holds_the_glass_against_hand_and_background(axes):
    draw_depth_hint(axes, [0.5, 0.6, 0.7], [0.48, np.nan, 0.75], [1.5, 2.0, np.nan])
    hand, background = axes[0].collections
    np.testing.assert_allclose(hand.get_offsets()[[0, 2]], [[0.48, 0.5], [0.75, 0.7]])
    np.testing.assert_allclose(background.get_offsets()[:2], [[1.5, 0.5], [2.0, 0.6]])
    assert to_hex(hand.get_facecolor()[0]).upper() == COLORS["hand"]
    bars = [bar for bar in axes[1].patches if bar.get_height()]
    assert sum(bar.get_height() for bar in bars) == 2  # the frame without a hand is left out
    assert bars[0].get_x() == pytest.approx(-5.0)  # 0.70 m of glass, 0.75 m of hand
    assert bars[-1].get_x() + bars[-1].get_width() == pytest.approx(2.0)


def test_wrist_frame_shows_the_asked_axes_and_the_palm_with_z(axes):
    turned = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])  # columns x = up, y = left, z
    draw_wrist_frame(axes[0], FLAT + 0.4, turned, "y", FRONT, "first")
    draw_wrist_frame(axes[1], FLAT + 0.4, turned, "yzx", FRONT, "second")
    assert axes[0].get_title() == "first"
    assert not axes[0].patches
    names = [{t.get_text(): t.get_position() for t in ax.texts if t.get_text()} for ax in axes]
    assert set(names[0]) == {"y"}
    assert set(names[1]) == {"x", "y", "z"}
    assert names[1]["y"] == pytest.approx((-7.32, 0), abs=1e-9)
    assert names[1]["x"] == pytest.approx((0, 7.32), abs=1e-9)
    (palm,) = axes[1].patches
    np.testing.assert_allclose(palm.get_xy()[:3], 100 * FLAT[[0, 5, 17], :2], atol=1e-9)


def test_arrows_run_from_the_voxels_centre_to_the_keypoints(axes):
    center = np.array([0.1, -0.2, 0.3])
    view = orbit_view(30, 20)
    draw_voxel_arrows(axes[0], FLAT, center, 0.25, view, "a voxel", color="#123456")
    arrows = axes[0].texts
    np.testing.assert_allclose([a.xyann for a in arrows], [on_screen(center, view)] * 21)
    np.testing.assert_allclose([a.xy for a in arrows], on_screen(FLAT, view))
    edges = [line for line in axes[0].lines if line.get_color() == "#123456"]
    assert len(edges) == 12
    straight = orbit_view(0, 0)
    draw_voxel_arrows(axes[1], FLAT, center, 0.25, straight, "from the front", color="#123456")
    ends = np.concatenate([e.get_xydata() for e in axes[1].lines if e.get_color() == "#123456"])
    np.testing.assert_allclose(ends.min(axis=0), [-2.5, -32.5])
    np.testing.assert_allclose(ends.max(axis=0), [22.5, -7.5])
