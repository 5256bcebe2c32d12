"""A recording as curves beside the hand at three moments."""

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

from hadr.figures.solids.recordings import draw_recording
from hadr.hand import ANGLE_NAMES
from hadr.synthesis.holding.hold import make_hold
from hadr.synthesis.recordings.recording import Recording

mpl.use("Agg")


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
    plt.close(fig)
