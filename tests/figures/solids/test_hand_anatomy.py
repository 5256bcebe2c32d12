"""The named skeleton and the sheet of angles."""

import numpy as np

from hadr.figures.solids.hand_anatomy import (
    SHOWN_ANGLES,
    draw_angle_sheet,
    draw_named_skeleton,
    draw_recording,
    open_hand,
)
from hadr.figures.solids.studio import studio_view
from hadr.hand import ANGLE_NAMES, KEYPOINT_NAMES, SKELETON_NAMES
from hadr.synthesis.holding.hold import make_hold
from hadr.synthesis.recordings.recording import Recording


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


def test_curves_are_the_angles_in_degrees_and_lines_mark_the_moments():
    hold = make_hold("0000", 0, 0)
    time = np.linspace(0.0, 1.0, 5)
    angles = hold.angles + 0.01 * np.arange(5)[:, None] * np.linspace(-1, 1, 20)
    recording = Recording(
        hold.hold_id, hold.object_id, hold.kind, hold.shape, time, angles,
        np.repeat(hold.wrist_from_object[None], 5, axis=0),
    )  # fmt: skip
    fig = draw_recording(recording, pixels=32)
    stills, panels = fig.axes[:3], fig.axes[3:]
    assert [ax.get_title() for ax in stills] == ["0.00 s", "0.50 s", "1.00 s"]
    assert [ax.get_title() for ax in panels] == ["thumb", "index", "middle", "ring", "little"]
    for finger, ax in enumerate(panels):
        curves = [line for line in ax.lines if len(line.get_xdata()) == 5]
        assert len(curves) == 4
        for joint, line in enumerate(curves):
            number = 4 * finger + joint
            assert ANGLE_NAMES[number].startswith(ax.get_title())
            np.testing.assert_allclose(line.get_ydata(), np.rad2deg(angles[:, number]))
        marks = [line.get_xdata()[0] for line in ax.lines if len(line.get_xdata()) == 2]
        np.testing.assert_allclose(marks, [0.0, 0.5, 1.0])
