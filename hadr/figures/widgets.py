"""The book's interactive figures; each stands beside a static one that tells the same story.

Lengths are metres, depth images (H, W), keypoints (21, 3) and rays (R, 3) in the camera frame.
Each function returns a widget: show it as a cell's last value.
"""

from collections.abc import Callable
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
from hadr.figures.depth.corruption_examples import corruption_statistics
from hadr.figures.handover.rescoring_sphere import candidate_choice
from hadr.figures.method.hands import frame_hand_axes, show_bones
from hadr.figures.method.rays import draw_walk
from hadr.figures.panels import COLORS, show_depth
from hadr.hand import absolute_hand_feature, check_keypoints
from hadr.handover.grasping.grasps import Grasps
from hadr.handover.grasping.rescoring import Directions, Weights
from hadr.ray_voxels import OccupiedVoxels, RayVoxelPairs, VoxelGrid
from hadr.simulation.world.scenes import HeldScene


def _live(draw: Callable[..., object], **sliders: Any) -> Any:
    """Sliders for draw's arguments, each (label, start, least, most, step) or a widget."""

    def show(**values: Any) -> None:
        draw(**values)
        plt.show()

    made = {}
    for name, given in sliders.items():
        if isinstance(given, tuple):
            options = dict(zip(("description", "value", "min", "max", "step"), given, strict=True))
            given = widgets.FloatSlider(continuous_update=False, **options)
        made[name] = given
    return widgets.interactive(show, **made)


def orbit_hand(keypoints: npt.ArrayLike) -> Any:
    """Turn the camera around a hand and watch both forms of the absolute hand feature."""
    points = check_keypoints(keypoints)
    center = points.mean(axis=0)

    def draw(sideways: float, upwards: float) -> None:
        turn = Rotation.from_euler("yx", [sideways, upwards], degrees=True).as_matrix()
        moved = (points - center) @ turn.T + center
        both = torch.from_numpy(np.stack([points, moved]))
        _, (view, bars) = plt.subplots(1, 2, figsize=(8.0, 3.4))
        show_bones(view, moved - center, np.diag([1.0, -1.0, -1.0]))  # y of the camera points down
        frame_hand_axes(view, "the hand, seen by the turned camera")
        view.set(xlim=(-12, 12), ylim=(-12, 12))
        for offset, rotation, label in ((-0.2, True, "wrist frame"), (0.2, False, "wrist only")):
            feature = absolute_hand_feature(both, wrist_rotation=rotation)
            change = (feature[1] - feature[0]).reshape(21, 3).norm(dim=1).numpy() * 100
            color = COLORS["hadr" if rotation else "baseline"]
            bars.bar(np.arange(21) + offset, change, 0.4, label=label, color=color)
        bars.set(xlabel="keypoint", ylabel="change of the feature (cm)", ylim=(0, 30))
        bars.legend()

    degrees = (0.0, -90.0, 90.0, 5.0)
    return _live(draw, sideways=("sideways (°)", *degrees), upwards=("upwards (°)", *degrees))


def walk_along_ray(
    directions: Tensor,
    pairs: RayVoxelPairs,
    occupied: OccupiedVoxels,
    true_distance: Tensor,
    grid: VoxelGrid,
) -> Any:
    """Choose a ray and how far to walk along it through its candidate voxels."""
    rays = sorted(set(pairs.ray.tolist()))

    def draw(ray: int, distance: float) -> None:
        mine = (pairs.ray == ray).nonzero().squeeze(1)
        cells = occupied.center[pairs.voxel[mine]]
        _, ax = plt.subplots(figsize=(8, 3.6))
        draw_walk(ax, directions[ray], cells, pairs.t_in[mine], pairs.t_out[mine],
                  grid.voxel_size, reached=distance, truth=float(true_distance[ray]))  # fmt: skip
        ax.set_title(f"ray {ray}, {distance:.2f} m from the camera")

    ray = widgets.SelectionSlider(options=rays, value=rays[len(rays) // 2], description="ray")
    farthest = float(pairs.t_out.max()) + 0.05
    return _live(draw, ray=ray, distance=("metres", farthest / 2, 0.0, farthest, 0.01))


def corrupt_glass(depth: FloatArray, background_depth: FloatArray, mask: BoolArray) -> Any:
    """Mix missing and background depth inside a glass."""
    window = window_around(mask, 14)
    near, far = np.percentile(background_depth[window], 2), np.percentile(depth[window], 98)

    def draw(missing: float, background: float) -> None:
        shares = {"missing_share": missing, "background_share": (1 - missing) * background}
        seen = see_through(depth, background_depth, mask, np.random.default_rng(0), **shares)
        found = corruption_statistics(seen, depth, mask)
        _, ax = plt.subplots(figsize=(5.0, 3.6))
        title = f"{found.missing_share:.0%} missing, median error {found.bias_m * 100:+.1f} cm"
        show_depth(ax, seen[window], title, vmin=float(near) - 0.1, vmax=float(far))

    share = (0.5, 0.0, 1.0, 0.05)
    return _live(draw, missing=("missing", *share), background=("background", *share))


def weigh_wishes(scene: HeldScene, grasps: Grasps, directions: Directions) -> Any:
    """Weigh the intended score's two wishes: its sphere and the grasp it chooses, base frame."""

    def draw(human: float, down: float) -> None:
        weights = Weights(robot_to_human=human, up_to_down=down)
        candidate_choice(scene, grasps, directions, weights, limit=1.2)

    ends = (0.0, 1.0, 0.1)
    return _live(draw, human=("w_r2h", 0.4, *ends), down=("w_u2d", 0.2, *ends))
