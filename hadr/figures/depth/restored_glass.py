"""What methods restore of a glass: depth and error beside the truth, and as clouds that turn."""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from scipy.spatial.transform import Rotation

from hadr.camera import BoolArray, FloatArray, back_project, valid_depth
from hadr.data.frame import Frame
from hadr.figures.panels import DEPTH_MAP, bare_axes, show_color, show_error
from hadr.figures.solids.turntable import Cloud

_DEPTH_CM, _ERROR_M = 8.0, 0.05  # where the bars end
_LEFT, _TOP, _BOTTOM = 0.45, 0.45, 0.75  # inches around the pictures
_GREY = 0.85
_AROUND_M, _SEEN_M = 0.16, 0.085  # of a cloud, around the glass: what there is, what a view shows
_GLASS = np.array([0, 114, 178])


def frames_at(errors: npt.ArrayLike, shares: Sequence[float]) -> list[int]:
    """Numbers of the frames whose error, (N,), has the given share of the others below it."""
    order = np.argsort(np.asarray(errors), kind="stable")
    return [int(order[round(share * (len(order) - 1))]) for share in shares]


def square_window(mask: BoolArray, margin: float = 1.25) -> tuple[slice, slice]:
    """Rows and columns of a square around a mask's bounding box, moved to lie in the image."""
    (top, left), (bottom, right) = np.argwhere(mask).min(axis=0), np.argwhere(mask).max(axis=0) + 1
    side = min(int(margin * max(bottom - top, right - left)), *mask.shape)
    row, column = (
        int(np.clip((low + high - side) // 2, 0, size - side))
        for low, high, size in zip((top, left), (bottom, right), mask.shape, strict=True)
    )
    return slice(row, row + side), slice(column, column + side)


def draw_restored(
    frames: Sequence[Frame], depths: Mapping[str, Sequence[FloatArray]], titles: Sequence[str]
) -> Figure:
    """Draw two rows a frame: each method's depth, above its error on the glass.

    The first column has the colours above the true depth. By a method's name stands a depth image
    for each frame, (H, W) metres; 0 is missing.
    """
    wide, columns = 9.0, 1 + len(depths)
    side = (wide - _LEFT) / columns
    high = _TOP + side * 2 * len(frames) + _BOTTOM
    fig: Figure = plt.figure(figsize=(wide, high), layout="none")
    grid = {"left": _LEFT / wide, "right": 1, "top": 1 - _TOP / high, "bottom": _BOTTOM / high}
    axes = fig.subplots(
        2 * len(frames), columns, squeeze=False, gridspec_kw=grid | {"wspace": 0.04, "hspace": 0.04}
    )
    for k, (frame, title) in enumerate(zip(frames, titles, strict=True)):
        window = square_window(frame.object_mask)
        above, below = axes[2 * k], axes[2 * k + 1]
        show_color(above[0], frame.color[window], "").set_interpolation("antialiased")
        near = _show_near(below[0], frame.depth, frame, window)
        for column, listed in enumerate(depths.values(), start=1):
            _show_near(above[column], listed[k], frame, window)
            off = _show_error(below[column], listed[k], frame, window)
        above[0].annotate(title, (-0.08, 0), xycoords="axes fraction", rotation=90, ha="right",
                          va="center", multialignment="center")  # fmt: skip
    for ax, name in zip(axes[0], ("colour and\ntruth", *depths), strict=True):
        ax.set_title(name, fontsize=9.5)
    for image, left, label in (
        (near, 0.1, "behind the glass's middle (cm)"),
        (off, 0.57, "error (cm)"),
    ):
        bar = fig.add_axes((left, 0.45 / high, 0.38, 0.13 / high))
        fig.colorbar(image, cax=bar, orientation="horizontal", extend="both", label=label)
    return fig


def _show_near(ax: Axes, depth: FloatArray, frame: Frame, window: tuple[slice, slice]) -> AxesImage:
    """Depth of glass and hand relative to the glass's own, the outline of the glass upon it."""
    middle = float(np.median(frame.depth[frame.object_mask & valid_depth(frame.depth)]))
    held = frame.object_mask | frame.hand_mask
    cmap = plt.get_cmap(DEPTH_MAP).with_extremes(bad=(0, 0, 0, 0))
    ax.imshow(np.where(held, _GREY, 1.0)[window], cmap="gray", vmin=0, vmax=1)
    shown = np.ma.masked_where(~(valid_depth(depth) & held), 100 * (depth - middle))[window]
    image = ax.imshow(shown, cmap=cmap, vmin=-_DEPTH_CM, vmax=_DEPTH_CM)
    ax.contour(frame.object_mask[window], [0.5], colors="black", linewidths=0.8)
    bare_axes(ax)
    return image


def _show_error(
    ax: Axes, depth: FloatArray, frame: Frame, window: tuple[slice, slice]
) -> AxesImage:
    """Signed error on the glass, with its root mean square and how much is missing."""
    error = _error(depth, frame)
    image = show_error(ax, error[window], limit=_ERROR_M, colorbar=False)
    ax.contour(frame.object_mask[window], [0.5], colors="black", linewidths=0.8)
    ax.text(0.97, 0.03, _words(error, frame.object_mask), transform=ax.transAxes, ha="right",
            fontsize=8.5, bbox={"color": "white", "alpha": 0.85, "pad": 1})  # fmt: skip
    return image


def _error(depth: FloatArray, frame: Frame) -> FloatArray:
    """Signed error on the glass, metres, (H, W); NaN beside it and where depth is missing."""
    scored = frame.object_mask & valid_depth(depth) & valid_depth(frame.depth)
    return np.where(scored, depth - frame.depth, np.nan)


def _words(error: FloatArray, mask: BoolArray) -> str:
    """Root mean square of the error, and the share of the mask without one if it is large."""
    known = np.isfinite(error)
    if not known.any():
        return "all missing"
    missing = 100 * float(1 - known.sum() / mask.sum())
    size = f"{100 * np.sqrt(np.mean(error[known] ** 2)):.1f} cm"
    return f"{missing:.0f} % missing\n{size}" if missing >= 5 else size


def restored_clouds(frame: Frame, depths: Mapping[str, FloatArray]) -> list[Cloud]:
    """The points around a glass for each depth image, (H, W) metres; those of the glass are blue.

    The images stand by what the reader chooses; the view turns around the true glass.
    """
    truth = back_project(frame.depth, frame.camera)
    center = np.median(truth[frame.object_mask & valid_depth(frame.depth)], axis=0)
    blue = np.rint(0.35 * frame.color + 0.65 * _GLASS)
    colors = np.where(frame.object_mask[..., None], blue, frame.color).astype(np.uint8)
    clouds = []
    for name, depth in depths.items():
        points = back_project(depth, frame.camera)
        near = valid_depth(depth) & (np.linalg.norm(points - center, axis=-1) <= _AROUND_M)
        off = _words(_error(depth, frame), frame.object_mask).replace("\n", ", ")
        note = "the true surface" if name == "truth" else f"{name}, on the glass: {off}"
        view: tuple[Any, ...] = (center, _SEEN_M, float(center[2] / frame.camera.fx))
        clouds.append(Cloud(name, note, points[near], colors[near], *view))
    return clouds


def draw_cloud(ax: Axes, cloud: Cloud, title: str) -> None:
    """Draw a cloud as who stands aside of the camera by 65 degrees sees it, in centimetres."""
    turn = Rotation.from_euler("y", 65.0, degrees=True).as_matrix()
    turned = (cloud.points - cloud.center) @ turn.T
    order = np.argsort(-turned[:, 2])  # the nearest last
    x, y, _ = 100 * turned[order].T
    ax.scatter(x, -y, s=2.5, c=cloud.colors[order] / 255, lw=0)
    half = 100 * cloud.radius
    ax.set(xlim=(-half, half), ylim=(-1.3 * half, 1.3 * half), aspect="equal")
    ax.set_facecolor("#e6ebf0")
    bare_axes(ax, title)


def draw_clouds(clouds: Sequence[Cloud]) -> Figure:
    """Draw clouds side by side as `draw_cloud` does, with their scale."""
    fig: Figure
    fig, axes = plt.subplots(1, len(clouds), figsize=(9, 9 / len(clouds) * 1.3 + 0.3))
    for ax, cloud in zip(axes, clouds, strict=True):
        draw_cloud(ax, cloud, cloud.name)
    half = 100 * clouds[0].radius
    axes[0].plot([2 - half, 7 - half], [1 - 1.3 * half] * 2, color="black", lw=2)
    axes[0].text(4.5 - half, 1.4 - 1.3 * half, "5 cm", ha="center", fontsize=9.5)
    return fig
