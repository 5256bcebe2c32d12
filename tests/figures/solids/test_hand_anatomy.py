"""The named skeleton and the sheet of angles."""

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest

from hadr.figures.solids.hand_anatomy import (
    SHOWN_ANGLES,
    draw_angle_sheet,
    draw_named_skeleton,
    open_hand,
)
from hadr.figures.solids.studio import studio_view
from hadr.hand import KEYPOINT_NAMES, SKELETON_NAMES

mpl.use("Agg")


@pytest.fixture(autouse=True)
def _close():
    yield
    plt.close("all")


def test_joints_count_from_one_and_keypoints_from_zero_without_the_virtual_point():
    hand = open_hand()
    fig = draw_named_skeleton(hand, pixels=128)
    left, right = fig.axes
    numbers = [t.get_text() for t in left.texts if t.get_text().isdigit()]
    assert numbers == [str(i + 1) for i in range(22)]
    dropped = [t for t in right.texts if t.get_text().isdigit()]
    assert [t.get_text() for t in dropped] == [str(i) for i in range(21)]
    view = studio_view(hand, radius=0.121, center=(0.014, 0.0, 0.088))
    at = view.pixels_of(hand.joints, 128)
    for text in dropped:
        name = KEYPOINT_NAMES[int(text.get_text())]
        np.testing.assert_allclose(text.get_position(), at[SKELETON_NAMES.index(name)], atol=1e-9)
    assert any("virtual" in t.get_text() for t in left.texts)
    assert not any("virtual" in t.get_text() for t in right.texts)


def test_the_sheet_shows_each_angle_at_its_limits():
    fig = draw_angle_sheet(pixels=32)
    assert len(SHOWN_ANGLES) == 8
    assert len([ax for ax in fig.axes if ax.images]) == 24
    titles = [ax.get_title() for ax in fig.axes if ax.get_title()]
    assert titles[0] == "thumb CMC\nspread"
    assert titles[-1] == "index DIP\nstretch"
    below = [ax.texts[0].get_text() for ax in fig.axes]
    assert below[:8] == ["+40°", "+50°", "+60°", "+80°", "+20°", "+90°", "+110°", "+80°"]
    assert below[8:16] == ["0°"] * 8
    assert below[16:20] == ["-30°", "-25°", "-10°", "-15°"]
    # A finger that bends by 90 degrees at its root ends nearer to the wrist than a straight one.
    bent, straight = fig.axes[5].lines[0], fig.axes[13].lines[0]
    assert bent.get_ydata()[-1] > straight.get_ydata()[-1] + 5
