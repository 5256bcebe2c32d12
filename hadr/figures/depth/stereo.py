"""The drawing of an active stereo camera before an opaque wall and before a glass."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from hadr.figures.panels import COLORS

_WALL_Y = 1.0
_GLASS_Y = 0.55
_IMAGERS = (-0.18, 0.18)


def draw_stereo_camera(ax: Axes, glass: bool, title: str) -> None:
    """Draw the camera from above, its projector's ray and what both imagers see of the dot."""
    ax.plot([-0.75, 0.75], [_WALL_Y, _WALL_Y], color=COLORS["background"], lw=7)
    ax.text(-0.74, _WALL_Y - 0.03, "wall", va="top")
    dot = np.array([0.12, _WALL_Y])
    if glass:
        across = np.linspace(-0.45, 0.45, 60)
        side = _GLASS_Y + 0.9 * across**2
        ax.plot(across, side, color=COLORS["glass"], lw=9, alpha=0.55, solid_capstyle="butt")
        ax.text(0.5, float(side[-1]) - 0.06, "glass", va="center")
    _ray(ax, np.zeros(2), dot, 0.0, COLORS["baseline"])
    for x, name, bend in zip(_IMAGERS, ("left", "right"), (0.035, -0.05), strict=True):
        _ray(ax, np.array([x, 0.0]), dot, bend if glass else 0.0, COLORS["hadr"])
        ax.plot(x, 0, "s", ms=11, color=COLORS["truth"])
        ax.text(x, -0.06, name, ha="center", va="top")
    ax.plot(0, 0, "^", ms=11, color=COLORS["baseline"])
    ax.text(0, -0.06, "dots", ha="center", va="top", color="#9a6a00")
    ax.plot(*dot, "o", ms=7, color=COLORS["hand"], zorder=4)
    if glass:
        _ghosts(ax)
    ax.annotate(
        "", (_IMAGERS[0], -0.2), (_IMAGERS[1], -0.2), arrowprops={"arrowstyle": "<->", "lw": 1}
    )
    ax.text(0, -0.22, "baseline b", ha="center", va="top")
    ax.set(xlim=(-0.8, 0.8), ylim=(-0.32, 1.1), title=title, xticks=[], yticks=[])
    ax.set_aspect("equal")
    for spine in ax.spines.values():
        spine.set_visible(False)


def _ray(ax: Axes, start: np.ndarray, end: np.ndarray, bend: float, color: str) -> None:
    """Draw a ray that is shifted sideways by `bend` where it crosses the glass."""
    share = _GLASS_Y / _WALL_Y
    knee = start + share * (end - start) + np.array([bend, 0.0])
    points = np.array([start, knee, end])
    ax.plot(*points.T, color=color, lw=1.6)


def _ghosts(ax: Axes) -> None:
    """Where each imager, taking its ray for straight, believes the dot to be."""
    share = _GLASS_Y / _WALL_Y
    dot = np.array([0.12, _WALL_Y])
    ends = []
    for x, bend in zip(_IMAGERS, (0.035, -0.05), strict=True):
        start = np.array([x, 0.0])
        knee = start + share * (dot - start) + np.array([bend, 0.0])
        ends.append((start, knee))
    (a, p), (b, q) = ends
    lengths = np.linalg.solve(np.stack([p - a, b - q], axis=1), b - a)
    ghost = a + lengths[0] * (p - a)
    for _, knee in ends:
        ax.plot(*np.array([knee, ghost]).T, "--", color=COLORS["hadr"], lw=1)
    ax.plot(*ghost, "x", ms=10, mew=2.5, color=COLORS["hand"], zorder=4)
    aside = (0.3, float(ghost[1]) + 0.16)  # between glass and wall
    line = {"arrowstyle": "-", "color": COLORS["hand"], "shrinkB": 6}
    ax.annotate("measured", ghost, aside, va="center", color=COLORS["hand"], arrowprops=line)
