"""A recorded hold: its joint angles over time, and the hand at three moments."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from hadr.figures.panels import FINGER_COLORS
from hadr.figures.solids.studio import StudioView, studio_picture, studio_view
from hadr.figures.solids.turntable import held_glass
from hadr.hand import ANGLE_NAMES, FINGERS
from hadr.synthesis.recordings.recording import Recording

_STYLES = {
    "spread at the root": ":",
    "stretch at the root": "-",
    "middle joint": "--",
    "last joint": "-.",
}
_MOMENT = "0.35"


def draw_recording(recording: Recording, *, pixels: int = 300, width: float = 9.0) -> Figure:
    """Draw a recording: the hand at its beginning, middle and end over the curves of its angles."""
    rows = [0, len(recording.time) // 2, len(recording.time) - 1]
    fig: Figure = plt.figure(figsize=(width, 0.69 * width), layout="constrained")
    parts: Any = fig.subfigures(2, 1, height_ratios=(1.25, 1))
    above, below = parts
    view: StudioView | None = None
    for ax, row in zip(above.subplots(1, 3), rows, strict=True):
        scene = held_glass(recording.at(row))
        view = view or studio_view(scene)
        ax.imshow(studio_picture(scene, view, pixels=pixels), interpolation="bilinear")
        ax.set(title=f"{recording.time[row]:.2f} s", xticks=[], yticks=[])
        ax.spines[:].set_visible(False)
    panels = below.subplots(1, 5, sharey=True)
    for finger, ax in zip(FINGERS, panels, strict=True):
        _draw_finger(ax, recording, finger)
        for row in rows:
            ax.axvline(recording.time[row], color=_MOMENT, lw=0.8, ls=(0, (4, 4)), zorder=0)
    panels[0].set_ylabel("angle (degrees)")
    handles = [
        Line2D([], [], color="0.25", ls=style, label=name) for name, style in _STYLES.items()
    ]
    below.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=8.5)
    return fig


def _draw_finger(ax: Axes, recording: Recording, finger: str) -> None:
    names = [name for name in ANGLE_NAMES if name.startswith(finger)]
    for name, style in zip(names, _STYLES.values(), strict=True):
        degrees = np.rad2deg(recording.angles[:, ANGLE_NAMES.index(name)])
        ax.plot(recording.time, degrees, ls=style, color=FINGER_COLORS[finger], lw=1.6)
    ax.set_title(finger, color=FINGER_COLORS[finger], fontsize=10)
    ax.set_xlabel("time (s)")
