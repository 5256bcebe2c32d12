import matplotlib.pyplot as plt
import numpy as np
import pytest
import torch
from matplotlib.colors import to_hex

from hadr.camera import back_project
from hadr.data.samples import open_samples
from hadr.figures.method.hands import (
    draw_depth_hint,
    draw_votes,
    draw_voxel_arrows,
    draw_wrist_frame,
    on_screen,
    orbit_hand,
    orbit_view,
    show_bones,
    upright_view,
)
from hadr.figures.panels import COLORS, FINGER_COLORS
from hadr.hand import forward_kinematics, keypoints_from_skeleton
from hadr.models.hand.weighted_regression import maps_of_joints

FLAT = keypoints_from_skeleton(forward_kinematics(np.zeros(20)).joints)
FRONT = orbit_view(0, 0)


def test_view_from_the_front_is_the_frame_itself():
    np.testing.assert_allclose(orbit_view(0, 0), np.eye(3), atol=1e-15)
    np.testing.assert_allclose(on_screen([0.01, 0.02, 0.3], orbit_view(0, 0)), [1.0, 2.0])


def test_view_from_the_side_and_from_above():
    # A viewer on the +x side sees x come toward him and z run to the left.
    np.testing.assert_allclose(orbit_view(90, 0), [[0, 0, -1], [0, 1, 0], [1, 0, 0]], atol=1e-12)
    # A viewer above sees y come toward him and z run down the screen.
    np.testing.assert_allclose(orbit_view(0, 90), [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-12)
    assert np.linalg.det(orbit_view(33, -20)) == pytest.approx(1.0)


def test_an_upright_view_is_a_rotation_that_keeps_z_up():
    # From -y, x runs to the right and z up; -y comes toward the viewer.
    np.testing.assert_allclose(upright_view(-90, 0), [[1, 0, 0], [0, 0, 1], [0, -1, 0]], atol=1e-12)
    raised = upright_view(40, 25)
    np.testing.assert_allclose(raised @ raised.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(raised) == pytest.approx(1.0)
    assert raised[2, 2] == pytest.approx(np.sin(np.deg2rad(25)))
    assert raised[1, 2] > 0


def test_bones_are_where_the_keypoints_are(ax):
    show_bones(ax, FLAT, FRONT)
    coloured = [line for line in ax.lines if line.get_color() != "white"]
    assert len(coloured) == 20
    assert {line.get_color() for line in coloured} == set(FINGER_COLORS.values())
    tips = np.concatenate([line.get_xydata() for line in coloured])
    assert tips[:, 1].max() == pytest.approx(19.1)  # the middle finger's tip, centimetres
    with pytest.raises(ValueError, match="21 keypoints"):
        show_bones(ax, FLAT[:20], FRONT)


def test_orbit_widget_moves_one_feature_and_not_the_other():
    posed = keypoints_from_skeleton(forward_kinematics(np.full(20, 0.2)).joints)
    keypoints = posed + np.array([0.0, 0.0, 0.7])
    sliders = orbit_hand(keypoints)
    assert [child.description for child in sliders.children[:2]] == ["sideways (°)", "upwards (°)"]
    sliders.f(sideways=40.0, upwards=0.0)
    bars = plt.gcf().axes[1]
    heights = [[bar.get_height() for bar in group] for group in bars.containers]
    assert [text.get_text() for text in bars.get_legend().get_texts()] == [
        "wrist frame",
        "wrist only",
    ]
    assert max(heights[0]) < 1e-9
    assert max(heights[1]) > 3.0


@pytest.fixture
def axes():
    fig, row = plt.subplots(1, 2)
    yield row
    fig.canvas.draw()


def test_hint_holds_the_glass_against_hand_and_background(axes):
    draw_depth_hint(axes, [0.5, 0.6, 0.7], [0.48, np.nan, 0.75], [0.8, 2.0, np.nan])
    background, hand = axes[0].collections
    np.testing.assert_allclose(hand.get_offsets()[[0, 2]], [[0.48, 0.5], [0.75, 0.7]])
    border = axes[0].get_xlim()[1] - 0.02  # what is farther than the picture stands there
    np.testing.assert_allclose(background.get_offsets()[:2], [[0.8, 0.5], [border, 0.6]])
    assert 0.8 < border < 1
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
    draw_voxel_arrows(axes[1], FLAT, center, 0.25, FRONT, "from the front", color="#123456")
    ends = np.concatenate([e.get_xydata() for e in axes[1].lines if e.get_color() == "#123456"])
    np.testing.assert_allclose(ends.min(axis=0), [-2.5, -32.5])
    np.testing.assert_allclose(ends.max(axis=0), [22.5, -7.5])


def test_exact_votes_meet_at_the_joint(axes):
    frame = open_samples("test")[0]
    points = np.nan_to_num(back_project(frame.depth, frame.camera)).transpose(2, 0, 1)
    surface = torch.from_numpy(points)[None].float()
    joints = torch.from_numpy(frame.keypoints)[None].float()
    maps = maps_of_joints(joints, surface, torch.from_numpy(frame.hand_mask)[None], 0.15)
    draw_votes(axes, frame, surface, maps, 8, 0.15)
    circle, mean = axes[1].lines
    np.testing.assert_allclose(circle.get_xydata()[0], frame.keypoints_uv[8])
    np.testing.assert_allclose(mean.get_xydata()[0], frame.keypoints_uv[8], atol=0.02)
    (votes,) = axes[1].collections
    off = votes.get_offsets() - frame.keypoints_uv[8]
    assert len(off) > 20
    assert np.abs(off).max() < 0.05
