"""A camera that circles a held glass: which hand features it changes, what it loses sight of."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hadr.camera import Array, Intrinsics, project, transform_points
from hadr.figures.panels import BONE_COLORS, COLORS, bare_axes
from hadr.figures.solids.studio import StudioView, studio_picture, studio_view
from hadr.figures.solids.turntable import HandOnGlass
from hadr.hand import FINGERS, absolute_hand_feature, keypoints_from_skeleton, relative_hand_feature
from hadr.ray_voxels import VoxelGrid
from hadr.synthesis.hand.mesh import HandMesh
from hadr.synthesis.rendering.raycast import Labels, RayCaster
from hadr.synthesis.scene.contents import Contents

#: The features in their order: title, colour, whether it is given in centimetres.
FEATURES: dict[str, tuple[str, str, bool]] = {
    "absolute": ("absolute: keypoints in the wrist frame", COLORS["hadr"], True),
    "lengths": ("lengths of the arrows from the point", COLORS["glass"], True),
    "relative": ("relative: arrows from the voxel's centre", COLORS["voxel"], True),
    "image": ("2D: pixels as a share of the picture", COLORS["raw"], False),
}
_KEYPOINT_COLORS = (COLORS["truth"], *BONE_COLORS)
#: What a camera sees of a keypoint: hidden by flesh, behind glass, or in full view.
HIDDEN, BEHIND_GLASS, IN_VIEW = 0, 1, 2
#: Flesh this far in front of a keypoint, metres, is that of another part of the hand.
_FLESH = 0.022


@dataclass(frozen=True)
class Orbit:
    """A camera at N places around a held glass, by how far it has gone around the glass's axis.

    The places are there as the studio has them and as poses, (N, 4, 4); the keypoints are in the
    camera's frame, metres, (N, 21, 3).
    """

    scene: HandOnGlass
    turns_deg: Array
    views: tuple[StudioView, ...]
    camera: Intrinsics
    camera_from_object: Array
    keypoints: Array

    def picture(self, place: int) -> npt.NDArray[np.uint8]:
        """Draw what the camera sees from a place, shape (pixels, pixels, 3)."""
        return studio_picture(self.scene, self.views[place], pixels=self.camera.width)

    def labels(self, place: int) -> Labels:
        """Give the exact depth and masks of that picture."""
        hand, plain = self.scene.hand, np.zeros((len(self.scene.hand.vertices), 3))
        contents = Contents(HandMesh(hand, plain, plain[:, 0]), (self.scene.glass,))
        pose: Array = np.linalg.inv(self.camera_from_object[place])
        return RayCaster(contents).labels(self.camera, pose)


def orbit(scene: HandOnGlass, turns_deg: npt.ArrayLike, *, pixels: int = 224) -> Orbit:
    """Send a camera around a held glass, by turns (N,) in degrees, all equally far from it."""
    turns = np.asarray(turns_deg, dtype=float)
    views = tuple(studio_view(scene, azimuth_deg=scene.azimuth_deg + turn) for turn in turns)
    poses = np.tile(np.eye(4), (len(turns), 1, 1))
    for pose, view in zip(poses, views, strict=True):
        pose[:3, :3] = np.diag([1.0, -1.0, -1.0]) @ view.screen_from_object
        pose[:3, 3] = [0.0, 0.0, view.distance] - pose[:3, :3] @ view.center
    middle, one = views[0].center, views[0].center + views[0].screen_from_object[0]
    near = views[0].pixels_of([middle, one], pixels)
    focal = float(near[1, 0] - near[0, 0]) * views[0].distance
    camera = Intrinsics(focal, focal, pixels / 2 - 0.5, pixels / 2 - 0.5, pixels, pixels)
    points = keypoints_from_skeleton(scene.joints)
    keypoints = np.stack([transform_points(pose, points) for pose in poses])
    return Orbit(scene, turns, views, camera, poses, keypoints)


def point_on_glass(track: Orbit) -> Array:
    """The upper glass's point (3,), object frame, that is nearest to the orbit's middle camera."""
    vertices = track.scene.glass.vertices
    low, high = vertices[:, 2].min(), vertices[:, 2].max()
    upper = vertices[vertices[:, 2] >= low + 0.75 * (high - low)]
    pose = track.camera_from_object[len(track.turns_deg) // 2]
    return np.asarray(upper[np.argmin(np.linalg.norm(transform_points(pose, upper), axis=1))])


def orbit_features(track: Orbit, point: npt.ArrayLike, grid: VoxelGrid) -> dict[str, Array]:
    """Each of `FEATURES`, (N, 21 * D), of a point of the glass, object frame, at each place."""
    hands = torch.from_numpy(track.keypoints)
    at = np.stack([transform_points(p, np.asarray(point)) for p in track.camera_from_object])
    centers = grid.center_of(grid.cell_of(torch.from_numpy(at)), torch.float64)
    size = np.array([track.camera.width, track.camera.height])
    uv = np.stack([project(hand, track.camera) for hand in track.keypoints])
    return {
        "absolute": absolute_hand_feature(hands).numpy(),
        "lengths": np.linalg.norm(track.keypoints - at[:, None], axis=2),
        "relative": relative_hand_feature(hands, centers).numpy(),
        "image": ((uv + 0.5) / size).reshape(len(uv), -1),
    }


def change_of(values: npt.ArrayLike, start: int) -> Array:
    """Change (N,) of a feature (N, 21 * D) since a place, in units of the hand's own size in it."""
    rows = np.asarray(values, dtype=float)
    rows = rows.reshape(len(rows), 21, -1)
    size = np.linalg.norm(rows[start] - rows[start].mean(axis=0))
    return np.asarray(np.linalg.norm(rows - rows[start], axis=(1, 2)) / size)


def keypoints_seen(track: Orbit) -> npt.NDArray[np.int64]:
    """HIDDEN, BEHIND_GLASS or IN_VIEW: how each place sees each keypoint, (N, 21)."""
    seen = np.full(track.keypoints.shape[:2], HIDDEN)
    for place, hand in enumerate(track.keypoints):
        labels = track.labels(place)
        column, row = np.rint(project(hand, track.camera)).astype(int).T
        inside = (column >= 0) & (column < track.camera.width)
        inside &= (row >= 0) & (row < track.camera.height)
        at = row.clip(0, track.camera.height - 1), column.clip(0, track.camera.width - 1)
        skin = labels.background_depth[at]
        own = inside & (skin > 0) & (hand[:, 2] - skin < _FLESH)
        seen[place, own] = np.where(labels.object_mask[at], BEHIND_GLASS, IN_VIEW)[own]
    return seen


def orbit_picture(
    track: Orbit,
    pictures: Sequence[npt.NDArray[np.uint8]],
    features: Mapping[str, Array],
    point: npt.ArrayLike,
    place: int,
    start: int,
) -> Figure:
    """Draw one place of an orbit: what is seen there, the features, and how far they have moved."""
    figure: Figure = plt.figure(figsize=(7.8, 4.9), layout="none")  # all alike, and drawn faster
    figure.subplots_adjust(0.005, 0.1, 0.99, 0.945, 0.36, 0.68)
    names = [[side, name] for side, name in zip("pppl", FEATURES, strict=True)]
    axes: dict[str, Axes] = figure.subplot_mosaic(
        names, width_ratios=(1, 1.62), height_ratios=(1, 1, 1, 1.2)
    )
    _draw_picture(axes["p"], track, pictures[place], point, place)
    for name, (title, _, metric) in FEATURES.items():
        _draw_bars(axes[name], features[name] * (100 if metric else 1), place, start)
        change = float(change_of(features[name], start)[place])
        said = f"changed by {change:.0%}" if change > 1e-9 else "unchanged"
        axes[name].set_title(f"{title}: {said}", fontsize=9.5, loc="left", pad=3)
        axes[name].set_ylabel("cm" if metric else "share", labelpad=1)
    _draw_changes(axes["l"], track, features, place, start)
    return figure


def _draw_picture(
    ax: Axes, track: Orbit, picture: npt.NDArray[np.uint8], point: npt.ArrayLike, place: int
) -> None:
    ax.imshow(picture, interpolation="bilinear")
    uv = project(track.keypoints[place], track.camera)
    at = project(
        transform_points(track.camera_from_object[place], np.asarray([point])), track.camera
    )[0]
    for end, color in zip(uv, _KEYPOINT_COLORS, strict=True):
        ax.plot(*np.stack([at, end]).T, color=COLORS["truth"], lw=0.5, alpha=0.45)
        ax.plot(*end, "o", ms=4.5, color=color, mec="white", mew=0.6)
    ax.plot(*at, "*", ms=15, color=COLORS["highlight"], mec="black", mew=0.9)
    width, height = track.camera.width, track.camera.height
    ax.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5))
    bare_axes(ax, f"camera at {track.turns_deg[place]:.0f}°")


def _draw_bars(ax: Axes, rows: Array, place: int, start: int) -> None:
    """One bar a number in its finger's colour, and what the number was first as a mark."""
    count = rows.shape[1]
    colors = np.repeat(_KEYPOINT_COLORS, count // 21).tolist()
    numbers = np.arange(count)
    ax.vlines(numbers, 0, rows[place], colors=colors, lw=240 / count)  # quicker than bars
    ax.hlines(rows[start], numbers - 0.5, numbers + 0.5, color="black", lw=1.3)
    ax.axhline(0, color="black", lw=0.5)
    low, high = min(float(rows.min()), 0.0), float(rows.max())
    ax.set(xlim=(-1, count), ylim=(low - 0.04 * (high - low), high + 0.06 * (high - low)))
    groups = ["wrist", *FINGERS]
    middles = np.array([0.0, 2.5, 6.5, 10.5, 14.5, 18.5]) * (count / 21) + (count / 21 - 1) / 2
    ax.set_xticks(middles.tolist(), groups, fontsize=8)
    ax.tick_params(axis="x", length=0, pad=1)
    ax.tick_params(axis="y", labelsize=8)


def _draw_changes(
    ax: Axes, track: Orbit, features: Mapping[str, Array], place: int, start: int
) -> None:
    for name, (title, color, _) in FEATURES.items():
        change = 100 * change_of(features[name], start)
        width = {"absolute": 4.0}.get(name, 1.8)  # it lies below the lengths' line
        label = title.split(":")[0].split(" ")[0]
        ax.plot(track.turns_deg, change, color=color, lw=width, label=label)
        ax.plot(track.turns_deg[place], change[place], "o", ms=6, color=color)
    ax.axvline(track.turns_deg[place], color="black", lw=0.8, ls=":", zorder=0)
    ax.set(xlabel="camera's turn (°)", ylabel="change (%)")
    ax.legend(loc="upper left", fontsize=8, ncols=2, handlelength=1.2, columnspacing=0.8)
    ax.set_ylim(top=1.55 * ax.get_ylim()[1])  # room for the legend
    box = ax.get_position()
    ax.set_position((0.085, box.y0, box.width - 0.08, box.height))


def draw_orbit_losses(
    axes: Sequence[Axes],
    turns_deg: npt.ArrayLike,
    seen: npt.NDArray[np.int64],
    errors_m: npt.ArrayLike,
    feature_errors_m: npt.ArrayLike,
) -> None:
    """Draw what no feature can keep: the keypoints in view, and the error of those predicted."""
    counts, errors = axes
    turns = np.asarray(turns_deg, dtype=float)
    kinds = {
        "in full view": (IN_VIEW, COLORS["hand"]),
        "behind glass": (BEHIND_GLASS, COLORS["glass"]),
        "hidden by flesh": (HIDDEN, COLORS["background"]),
    }
    rows = [(seen == kind).sum(axis=1) for kind, _ in kinds.values()]
    inks = [color for _, color in kinds.values()]
    counts.stackplot(turns, rows, labels=list(kinds), colors=inks, alpha=0.85)
    counts.set(xlabel="camera's turn (°)", ylabel="keypoints", ylim=(0, 21), xlim=turns[[0, -1]])
    counts.set_yticks([0, 7, 14, 21])
    counts.legend(loc="lower left", frameon=True, framealpha=0.85)
    for values, color, label in (
        (errors_m, COLORS["raw"], "predicted keypoints, in the camera frame"),
        (feature_errors_m, COLORS["hadr"], "absolute feature made of them"),
    ):
        errors.plot(turns, 1000 * np.asarray(values), "o-", ms=4, color=color, label=label)
    errors.set(xlabel="camera's turn (°)", ylabel="mean error of a keypoint (mm)")
    errors.set_ylim(bottom=0)
    errors.legend()
