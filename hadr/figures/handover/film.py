"""Figures of one recorded handover: a strip of stills, and what happens over time."""

import textwrap
from collections.abc import Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hadr.figures.panels import COLORS
from hadr.handover.stages import Stage, Transition
from hadr.simulation.film.film import STAGE_COLORS, nearest_state, stage_at
from hadr.simulation.film.world_view import FilmSet, View, view_from
from hadr.simulation.world.scenes import HeldScene
from hadr.simulation.world.state import WorldState

_LARGEST_FORCE = 20.0  # newtons on the hand, at which the robot stops


def strip_view(width: int = 420, height: int = 300) -> View:
    """The film's view for stills: less wide, so that hand and gripper are larger."""
    return view_from((0.72, -1.6, 0.80), (0.37, 0.0, 0.30), width=width, height=height, across=1.38)


def film_strip(
    states: Sequence[WorldState],
    times: Sequence[float],
    scene: HeldScene,
    transitions: Sequence[Transition],
    *,
    columns: int,
    names: Sequence[str] = (),
    view: View | None = None,
    width: float = 10.0,
) -> Figure:
    """Draw stills of one run, at times in seconds, with time and stage below.

    States and changes of stage come oldest first. `names` say what happens in each still; the
    figure is `width` inches wide and seen from `strip_view` where nothing else is told.
    """
    drawn = FilmSet(scene, view or strip_view())
    rows_px, columns_px = drawn.view.camera.shape
    rows = -(-len(times) // columns)
    height = rows * (width / columns * rows_px / columns_px + (0.50 if names else 0.34))
    fig: Figure = plt.figure(figsize=(width, height))
    for position, time in enumerate(times):
        ax = fig.add_subplot(rows, columns, position + 1)
        state = nearest_state(states, time)
        stage, _ = stage_at(state.time, transitions)
        name = names[position] if names else stage.value
        ax.imshow(drawn.draw(state), interpolation="antialiased")
        ax.set(xticks=[], yticks=[])
        for side, spine in ax.spines.items():
            spine.set_visible(side == "bottom")
            spine.set(color=STAGE_COLORS[stage], linewidth=5)
        label = textwrap.fill(f"{state.time:.1f} s  {name}", 36)
        label += f"\n{stage.value}" if names else ""
        ax.set_xlabel(label, fontsize=9.5, labelpad=5)
    return fig


def decisive_state(states: Sequence[WorldState], row: dict[str, Any]) -> WorldState:
    """The state that decided a recorded attempt: where it was taken, or that of the failure."""
    taken = (s for s in states if row["verdict"] == "success" and s.holder == "gripper")
    return next(taken, nearest_state(states, row["decided_at"]))


def show_run(states: Sequence[WorldState], transitions: Sequence[Transition]) -> Figure:
    """Draw one run over time: distance, opening of the gripper, forces on the hand."""
    time = np.array([state.time for state in states])
    distance = 100 * np.array([state.hand_distance for state in states])
    opening = 1000 * np.array([state.gripper_width for state in states])
    force, through = np.array([[s.hand_force, s.through_force] for s in states]).T
    fig: Figure
    fig, axes = plt.subplots(3, 1, figsize=(9, 4.6), sharex=True, height_ratios=(1.7, 1, 1))
    top, middle, low = axes
    top.plot(time, distance, color=COLORS["hand"], ls="--", label="robot to hand")
    top.set(ylabel="distance (cm)", ylim=(0, None))
    top.legend(loc="best")
    middle.plot(time, opening, color=COLORS["hadr"])
    middle.set(ylabel="opening (mm)", ylim=(0, 90))
    low.plot(time, force, color=COLORS["hand"], label="by a touch")
    low.plot(time, through, color=COLORS["glass"], label="through the glass")
    low.legend(loc="upper left", bbox_to_anchor=(0, 0.75), fontsize=9)
    low.axhline(_LARGEST_FORCE, color=COLORS["truth"], lw=1, ls=":")
    low.text(time[0], _LARGEST_FORCE, f" limit {_LARGEST_FORCE:g} N", va="bottom", fontsize=9)
    largest = max(_LARGEST_FORCE, float(force.max()), float(through.max()))
    low.set(ylabel="force (N)", ylim=(0, 1.5 * largest))
    taken = np.array([state.holder == "gripper" for state in states])
    if taken.any():
        first = int(np.argmax(taken))
        left = time[first] > (time[0] + time[-1]) / 2
        for ax in axes:
            ax.axvline(time[first], color=COLORS["truth"], lw=1, ls=":")
        low.annotate(
            "the hand lets go", (time[first], _LARGEST_FORCE / 2), xytext=(-5 if left else 5, 0),
            textcoords="offset points", ha="right" if left else "left", va="center", fontsize=9,
        )  # fmt: skip
    low.set_xlabel("time (s)")
    span = (float(time[0]), float(time[-1]))
    for ax in axes:
        stage_bands(ax, transitions, span, named=ax is top)
    low.set_xlim(span[0], max(span[1], span[0] + 1e-3))
    fig.align_ylabels(axes)
    return fig


def stage_bands(
    ax: Axes, transitions: Sequence[Transition], span: tuple[float, float], *, named: bool
) -> None:
    """Tint the time of each stage within a span of seconds, and perhaps write its name above.

    A name without room stands at the end.
    """
    edges = [span[0], *(change.time for change in transitions), span[1]]
    stages = [stage_at(span[0] - 1, transitions)[0], *(change.after for change in transitions)]
    length = max(span[1] - span[0], 1e-9)
    for left, right, stage in zip(edges[:-1], edges[1:], stages, strict=True):
        over = stage in (Stage.FINISHED, Stage.STOPPED)
        if right - left > 0:
            ax.axvspan(left, right, color=STAGE_COLORS[stage], alpha=0.13, lw=0, zorder=0)
        if over:
            ax.axvline(left, color=STAGE_COLORS[stage], lw=2.5)
        if named and (over or right - left > 0.07 * length):
            at, align = ((left + right) / 2, "center")
            if over and right - left < 0.07 * length:
                at, align = right, "right"
            words = stage.value.replace(" ", "\n", 1 if right - left < 0.14 * length else 0)
            ax.text(at, 1.02, words, transform=ax.get_xaxis_transform(), ha=align, va="bottom",
                    color=STAGE_COLORS[stage], fontsize=9.5, fontweight="bold")  # fmt: skip
