"""The book's interactive figures; each stands beside a static one that tells the same story."""

from __future__ import annotations

from typing import Any

import ipywidgets as widgets
import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from hadr.camera import BoolArray, FloatArray, window_around
from hadr.corruption import see_through
from hadr.figures.depth.corruption_statistics import corruption_statistics
from hadr.figures.handover.rescoring_sphere import candidate_choice
from hadr.figures.method.rays import draw_walk
from hadr.figures.panels import COLORS, equal_axes_3d, show_depth, show_skeleton_3d
from hadr.hand import absolute_hand_feature, check_keypoints
from hadr.handover.grasping.grasps import Grasps
from hadr.handover.grasping.rescoring import Directions, Weights
from hadr.ray_voxels import OccupiedVoxels, RayVoxelPairs, VoxelGrid
from hadr.simulation.trials.rehearsal import HeldGlass


def orbit_hand(keypoints: npt.ArrayLike) -> Any:
    """Turn the camera around a hand and watch both forms of the absolute hand feature."""
    points = check_keypoints(keypoints)
    center = points.mean(axis=0)

    def draw(sideways: float, upwards: float) -> None:
        turn = Rotation.from_euler("yx", [sideways, upwards], degrees=True).as_matrix()
        moved = (points - center) @ turn.T + center
        both = torch.from_numpy(np.stack([points, moved]))
        fig = plt.figure(figsize=(8.0, 3.4))
        view = fig.add_subplot(1, 2, 1, projection="3d")
        show_skeleton_3d(view, moved)
        equal_axes_3d(view, center + 0.12 * np.array([[-1.0, -1, -1], [1, 1, 1]]), margin=0.0)
        view.view_init(elev=-90, azim=-90)
        view.set_title("the hand, seen by the turned camera")
        bars = fig.add_subplot(1, 2, 2)
        for offset, rotation, label in ((-0.2, True, "wrist frame"), (0.2, False, "wrist only")):
            feature = absolute_hand_feature(both, wrist_rotation=rotation)
            change = (feature[1] - feature[0]).reshape(21, 3).norm(dim=1).numpy() * 100
            color = COLORS["hadr" if rotation else "baseline"]
            bars.bar(np.arange(21) + offset, change, 0.4, label=label, color=color)
        bars.set(xlabel="keypoint", ylabel="change of the feature (cm)", ylim=(0, 30))
        bars.legend()
        plt.show()

    slider = {"min": -90.0, "max": 90.0, "step": 5.0, "value": 0.0, "continuous_update": False}
    return widgets.interactive(
        draw,
        sideways=widgets.FloatSlider(description="sideways (°)", **slider),
        upwards=widgets.FloatSlider(description="upwards (°)", **slider),
    )


def walk_along_ray(
    directions: Tensor,
    pairs: RayVoxelPairs,
    occupied: OccupiedVoxels,
    true_distance: Tensor,
    grid: VoxelGrid,
) -> Any:
    """Two sliders that choose a ray and how far to walk along it through its candidate voxels."""
    rays = sorted(set(pairs.ray.tolist()))

    def draw(ray: int, distance: float) -> None:
        mine = (pairs.ray == ray).nonzero().squeeze(1)
        _, ax = plt.subplots(figsize=(8, 3.6))
        draw_walk(
            ax,
            directions[ray],
            occupied.center[pairs.voxel[mine]],
            pairs.t_in[mine],
            pairs.t_out[mine],
            grid.voxel_size,
            reached=distance,
            truth=float(true_distance[ray]),
        )
        ax.set_title(f"ray {ray}, {distance:.2f} m from the camera")
        plt.show()

    ray = widgets.SelectionSlider(options=rays, value=rays[len(rays) // 2], description="ray")
    farthest = float(pairs.t_out.max()) + 0.05
    distance = widgets.FloatSlider(
        value=farthest / 2, min=0.0, max=farthest, step=0.01, description="metres"
    )
    return widgets.interactive(draw, ray=ray, distance=distance)


def corrupt_glass(depth: FloatArray, background_depth: FloatArray, mask: BoolArray) -> Any:
    """Mix missing and background depth inside a glass with two sliders."""
    window = window_around(mask, 14)
    near, far = np.percentile(background_depth[window], 2), np.percentile(depth[window], 98)

    def draw(missing: float, background: float) -> None:
        seen = see_through(
            depth,
            background_depth,
            mask,
            np.random.default_rng(0),
            missing_share=missing,
            background_share=(1 - missing) * background,
        )
        found = corruption_statistics(seen, depth, mask)
        _, ax = plt.subplots(figsize=(5.0, 3.6))
        show_depth(ax, seen[window], vmin=float(near) - 0.1, vmax=float(far))
        ax.set_title(
            f"{found.missing_share:.0%} missing, median error {found.bias_m * 100:+.1f} cm"
        )
        plt.show()

    slider = {"min": 0.0, "max": 1.0, "step": 0.05, "value": 0.5, "continuous_update": False}
    return widgets.interactive(
        draw,
        missing=widgets.FloatSlider(description="missing", **slider),
        background=widgets.FloatSlider(description="background", **slider),
    )


def step_through(pictures: dict[str, FloatArray], truth: FloatArray) -> Any:
    """Step through restored depth images, each beside the truth and with its error."""
    low, high = float(truth[truth > 0].min()), float(np.median(truth[truth > 0])) + 0.15

    def draw(stage: str) -> None:
        fig, axes = plt.subplots(1, 2, figsize=(7, 3))
        show_depth(axes[0], pictures[stage], stage, vmin=low, vmax=high, colorbar=False)
        show_depth(axes[1], truth, "truth", vmin=low, vmax=high)
        plt.show(fig)

    slider = widgets.SelectionSlider(options=list(pictures), description="after")
    return widgets.interactive(draw, stage=slider)


def weigh_wishes(scene: HeldGlass, grasps: Grasps, directions: Directions) -> Any:
    """Two sliders for the weights of the intended score: its sphere and the grasp it chooses."""

    def draw(human: float, down: float) -> None:
        weights = Weights(robot_to_human=human, up_to_down=down)
        candidate_choice(scene, grasps, directions, weights, limit=1.2)
        plt.show()

    slider = {"min": 0.0, "max": 1.0, "step": 0.1, "continuous_update": False}
    return widgets.interactive(
        draw,
        human=widgets.FloatSlider(description="w_r2h", value=0.4, **slider),
        down=widgets.FloatSlider(description="w_u2d", value=0.2, **slider),
    )


def turn_frame(scene: HeldGlass, grasps: Grasps, directions: Directions) -> Any:
    """A slider that turns the frame in which the printed formula's rotation is written."""

    def draw(turn: float) -> None:
        candidate_choice(scene, grasps, directions, Weights(), tilt_deg=turn)
        plt.show()

    slider = {"min": 0.0, "max": 360.0, "step": 5.0, "continuous_update": False}
    return widgets.interactive(
        draw, turn=widgets.FloatSlider(description="turn (°)", value=90.0, **slider)
    )
