"""What a robot had before it when it chose its first grasp: the cloud of points and the gripper."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from hadr.camera import Array, project, transform_points
from hadr.figures.panels import COLORS, bare_axes
from hadr.hand import BONES
from hadr.handover.grasping.gripper import fork
from hadr.handover.observation import Observation
from hadr.simulation.camera.sight import Look
from hadr.simulation.film.world_view import Picture, view_from
from hadr.simulation.world.state import WorldState
from hadr.synthesis.glass.surfaces import Surface, merged

if TYPE_CHECKING:
    from hadr.simulation.trials.trial import Trial

_REST = "#9c8f7d"  # table and forearm


@dataclass(frozen=True)
class FirstChoice:
    """The picture in which a robot chose its first grasp, base frame, metres.

    The points that it takes for the glass, (n, 3), and those of anything else, (m, 3), its hand,
    (21, 3), the chosen tool pose, (4, 4), with the fingers' opening, and where the glass was.
    """

    glass: Array
    rest: Array
    keypoints: Array
    pose: Array
    width: float
    truth: Surface

    @property
    def off(self) -> float:
        """Median distance of the glass's points from the true glass's nearest vertex."""
        return float(np.median(cKDTree(self.truth.vertices).query(self.glass)[0]))


def first_choice(trial: Trial, chosen_at: float) -> FirstChoice:
    """Make an attempt up to its first grasp, whose time in seconds is known of an earlier run.

    Raises:
        ValueError: No grasp is chosen until then.
    """
    from hadr.simulation.trials.trial import run_trial  # needs the physics

    notes: dict[float, tuple[Observation, WorldState]] = {}

    def noted(look: Look) -> Look:
        def noting(state: WorldState, with_points: bool) -> Observation:
            seen = look(state, with_points)
            notes[seen.taken] = seen, state
            return seen

        return noting

    run = run_trial(replace(trial, time_limit=chosen_at + 0.1), spoil=noted)
    grasps = [e for e in run.log.header["events"] if e[1] == "chose" and e[2] is not None]
    if not grasps:
        raise ValueError(f"no grasp is chosen in the first {chosen_at:.2f} s of {trial.name}")
    step, _, pose, width, *_ = grasps[0]
    seen, state = notes[float(run.log.arrays["taken"][step])]
    camera = np.array(run.log.header["base_from_camera"])
    clouds = (seen.object_points, seen.scene_points, seen.keypoints)
    glass, rest, hand = (transform_points(camera, c) for c in clouds if c is not None)
    truth = merged(run.scene.glass()).moved(state.base_from_object)
    return FirstChoice(glass, rest, hand, np.array(pose), float(width), truth)


def draw_choices(
    choices: Mapping[str, FirstChoice], ends: Mapping[str, tuple[Picture, str]]
) -> Figure:
    """Draw a titled column a kind of depth: what the robot had when it chose, and its end below.

    An end is a picture, and the words below it.
    """
    fig: Figure
    fig, axes = plt.subplots(2, len(choices), figsize=(9, 5.4), height_ratios=(1.1, 1))
    for (above, below), (title, choice) in zip(axes.T, choices.items(), strict=True):
        draw_choice(above, choice)
        above.set(title=title, xlabel=f"glass off by {100 * choice.off:.1f} cm")
        picture, words = ends[title]
        below.imshow(picture, interpolation="antialiased")
        bare_axes(below)
        below.set_xlabel(words)
    drawn = axes[0, 0].get_legend_handles_labels()
    fig.legend(*drawn, loc="outside lower center", ncols=5, markerscale=1.5, fontsize=9)
    return fig


def draw_choice(ax: Axes, choice: FirstChoice) -> None:
    """Draw the points, the hand and the gripper over the faint true glass, the camera at the left.

    The view is across the camera's line of sight, where errors along it can be seen.
    """
    middle = (choice.truth.vertices.min(axis=0) + choice.truth.vertices.max(axis=0)) / 2
    x, y, z = middle
    view = view_from(
        (x - 0.8, y - 0.5, z + 0.35), (x, y, z - 0.01), width=300, height=320, across=0.3
    )
    camera_from_base = np.linalg.inv(view.base_from_camera)

    def uv(points: Array) -> Array:
        return project(transform_points(camera_from_base, points), view.camera)

    pose, bones = choice.pose, choice.keypoints[np.array(BONES)]
    corners = uv(choice.truth.vertices)[choice.truth.faces]
    ax.add_collection(PolyCollection(list(corners), facecolors="#60758a", alpha=0.06, lw=0))
    for points, name, color, size in (
        (choice.glass, "taken for the glass", COLORS["hadr"], 5),
        (choice.rest, "measured besides", _REST, 14),
    ):
        u, v = uv(points).T
        ax.scatter(u, v, s=size, color=color, lw=0, alpha=0.7, label=name)
    for lines, name, color, width in (
        (bones, "the hand's keypoints", COLORS["hand"], 2.5),
        (fork(choice.width) @ pose[:3, :3].T + pose[:3, 3], "chosen grasp", COLORS["robot"], 4.5),
    ):
        ends = list(uv(lines))
        ax.add_collection(LineCollection(ends, colors="white", lw=width + 2, capstyle="round"))
        ax.add_collection(
            LineCollection(ends, colors=color, lw=width, capstyle="round", label=name)
        )
    ax.scatter([], [], s=60, c="#c3ccd6", label="the true glass")
    ax.set(xlim=(0, view.camera.width), ylim=(view.camera.height, 0), aspect="equal")
    bare_axes(ax)
