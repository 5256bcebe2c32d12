"""A hand that moves with its glass, and grippers carried along by what is known of the motion."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hadr.figures.handover.scene import bare_axes_3d, show_glass, show_grippers, show_hand
from hadr.handover.grasping.grasps import Array, forward_of
from hadr.synthesis.glass.shape import GlassObject


@dataclass(frozen=True)
class Carried:
    """One way to carry a grasp along: base_from_tool at each moment, shape (t, 4, 4), metres."""

    name: str
    color: str
    poses: Array


@dataclass(frozen=True)
class HandFilm:
    """What happens: the hand, its glass and where the grasp belongs at each moment, base frame.

    Times are seconds, ascending, (t,), keypoints metres, (t, 21, 3), and poses (t, 4, 4).
    """

    times: Array
    keypoints: Array
    glass: GlassObject
    base_from_glass: Array
    true_poses: Array

    def off_mm(self, poses: Array) -> Array:
        """How far carried grippers are from where they belong, shape (t,), millimetres."""
        off: Array = 1000 * np.linalg.norm(poses[:, :3, 3] - self.true_poses[:, :3, 3], axis=1)
        return off


def moment_picture(
    film: HandFilm, carried: Sequence[Carried], at: int, *, limit_mm: float
) -> Figure:
    """One picture of a film: the scene on the left, how far off the grasps are on the right."""
    fig: Figure = plt.figure(figsize=(7.4, 3.6), layout="none")
    scene = fig.add_axes((-0.03, -0.04, 0.56, 1.06), projection="3d")
    _show_moment(scene, film, carried, at)
    chart = fig.add_axes((0.60, 0.16, 0.38, 0.60))
    show_errors(chart, film, carried, limit_mm=limit_mm, at=at)
    return fig


def _show_moment(ax: Any, film: HandFilm, carried: Sequence[Carried], at: int) -> None:
    """Draw the scene at one moment, with the way that each gripper has come so far."""
    show_hand(ax, film.keypoints[at])
    show_glass(ax, film.glass, film.base_from_glass[at])
    for one in carried:
        ax.plot(*one.poses[: at + 1, :3, 3].T, color=one.color, lw=1.4, alpha=0.55)
        shown = forward_of(one.poses[at], -0.02)
        show_grippers(ax, [shown], [0.075], [one.color], lw=4)
    middle = (film.keypoints.min(axis=(0, 1)) + film.keypoints.max(axis=(0, 1))) / 2
    middle += np.array([-0.03, 0.0, 0.03])
    bare_axes_3d(ax, middle - 0.18, middle + 0.18, zoom=1.5)
    ax.view_init(12, -100)  # from the camera's side, the human on the right


def show_errors(
    ax: Axes,
    film: HandFilm,
    carried: Sequence[Carried],
    *,
    limit_mm: float,
    at: int | None = None,
) -> None:
    """Draw how far off each gripper is over time; what is still to come stays pale."""
    reached = len(film.times) - 1 if at is None else at
    for one in carried:
        off = film.off_mm(one.poses)
        ax.plot(film.times, off, color=one.color, lw=1.2, alpha=0.25)
        ax.plot(film.times[: reached + 1], off[: reached + 1], color=one.color, label=one.name)
        if off[reached] <= limit_mm:
            ax.plot(film.times[reached], off[reached], "o", color=one.color, clip_on=False, ms=5)
    ax.set(xlim=(film.times[0], film.times[-1]), ylim=(0, limit_mm))
    ax.set(xlabel="time (s)", ylabel="grasp off (mm)")
    ax.legend(loc="lower left", bbox_to_anchor=(-0.02, 1.0), borderaxespad=0.2, fontsize=9)
