import matplotlib.pyplot as plt
import numpy as np
import pytest

from hadr.figures.method.hands import (
    on_screen,
    orbit_view,
    show_bones,
    upright_view,
)
from hadr.figures.panels import FINGER_COLORS
from hadr.hand import forward_kinematics, keypoints_from_skeleton


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
    keypoints = keypoints_from_skeleton(forward_kinematics(np.zeros(20)).joints)
    show_bones(ax, keypoints, orbit_view(0, 0))
    coloured = [line for line in ax.lines if line.get_color() != "white"]
    assert len(coloured) == 20
    assert {line.get_color() for line in coloured} == set(FINGER_COLORS.values())
    tips = np.concatenate([line.get_xydata() for line in coloured])
    assert tips[:, 1].max() == pytest.approx(19.1)  # the middle finger's tip, centimetres
    with pytest.raises(ValueError, match="21 keypoints"):
        show_bones(ax, keypoints[:20], orbit_view(0, 0))


def test_orbit_widget_moves_one_feature_and_not_the_other():
    from hadr.figures.widgets import orbit_hand

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
