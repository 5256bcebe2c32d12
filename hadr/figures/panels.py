"""The book's figure style: the same colours for the same things, labelled axes, units.

Colours are Okabe and Ito's, which colour-blind readers can tell apart, and a dark brown. Depth is
drawn in one sequential map (near is bright), signed errors in a diverging one that is white at
zero.
"""

from collections.abc import Callable, Sequence
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from IPython import get_ipython
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.rcsetup import cycler
from matplotlib_inline.backend_inline import set_matplotlib_formats

from hadr.camera import BoolArray, FloatArray, valid_depth
from hadr.hand import BONES, FINGERS

#: One colour for one thing, throughout the book.
COLORS: dict[str, str] = {
    "truth": "#000000",
    "raw": "#7f7f7f",
    "hadr": "#0072B2",
    "baseline": "#E69F00",
    "hand": "#D55E00",
    "glass": "#56B4E9",
    "robot": "#009E73",
    "voxel": "#CC79A7",
    "ray": "#D55E00",
    "highlight": "#F0E442",
    "background": "#B8B8B8",
    "rival": "#661100",
    "second rival": "#7716D9",
}
#: Colours of the five fingers, thumb to little finger.
FINGER_COLORS: dict[str, str] = {
    "thumb": "#D55E00",
    "index": "#E69F00",
    "middle": "#009E73",
    "ring": "#0072B2",
    "little": "#CC79A7",
}
#: Colours of the 20 bones between keypoints, in the order of `hadr.hand.BONES`.
BONE_COLORS: tuple[str, ...] = tuple(FINGER_COLORS[f] for f in FINGERS for _ in range(4))
DEPTH_MAP = "viridis_r"
ERROR_MAP = "RdBu_r"
MISSING = "#d9d9d9"


def use_style() -> None:
    """Set matplotlib's defaults to the book's style; call it once at a chapter's start.

    In a notebook figures have twice the pixels that they are shown with, for finer screens.
    """
    if (shell := get_ipython()) is not None and hasattr(shell, "kernel"):
        set_matplotlib_formats("retina")  # type: ignore[no-untyped-call]
    lines = [COLORS[k] for k in ("hadr", "hand", "robot", "baseline", "voxel", "glass")]
    mpl.rc("figure", figsize=(8.0, 3.6), dpi=110)
    mpl.rc("figure.constrained_layout", use=True)
    mpl.rc("savefig", dpi=110)
    mpl.rc("font", size=10.5)
    mpl.rc("axes", titlesize=11, labelsize=10.5, grid=False, prop_cycle=cycler(color=lines))
    mpl.rc("axes.spines", top=False, right=False)
    mpl.rc(("xtick", "ytick"), labelsize=9.5)
    mpl.rc("legend", fontsize=9.5, frameon=False)
    mpl.rc("lines", linewidth=1.8)
    mpl.rc("image", interpolation="nearest")


def bare_axes(ax: Axes, title: str | None = None) -> None:
    """Take ticks and borders away, for pictures; the labels of the axes stay."""
    ax.set(xticks=[], yticks=[])
    ax.spines[:].set_visible(False)
    if title is not None:
        ax.set_title(title)


def show_color(ax: Axes, color: npt.NDArray[Any], title: str | None = None) -> AxesImage:
    """Show a colour image, shape (H, W, 3), uint8 or float in 0..1."""
    bare_axes(ax, title)
    return ax.imshow(color)


def show_depth(
    ax: Axes,
    depth: FloatArray,
    title: str | None = None,
    *,
    vmin: float | None = None,
    vmax: float | None = None,
    colorbar: bool = True,
) -> AxesImage:
    """Show a depth image in metres, shape (H, W); missing values are light grey.

    Where no limits are given, they are the 1st and 99th percentile of the valid depth.
    """
    low, high = _limits(depth, vmin, vmax)
    cmap = mpl.colormaps[DEPTH_MAP].with_extremes(bad=MISSING)
    shown = np.ma.masked_where(~valid_depth(depth), depth)
    image = ax.imshow(shown, cmap=cmap, vmin=low, vmax=high)
    bare_axes(ax, title)
    if colorbar:
        ax.figure.colorbar(image, ax=ax, shrink=0.75, pad=0.02, label="depth (m)")
    return image


def _limits(depth: FloatArray, vmin: float | None, vmax: float | None) -> tuple[float, float]:
    valid = depth[valid_depth(depth)]
    low, high = np.percentile(valid, (1, 99)) if valid.size else (0.0, 1.0)
    return (low if vmin is None else vmin), (high if vmax is None else vmax)


def show_error(
    ax: Axes,
    error: FloatArray,
    title: str | None = None,
    *,
    limit: float = 0.05,
    colorbar: bool = True,
) -> AxesImage:
    """Show a signed depth error in metres, shape (H, W); NaN is light grey, red lies behind.

    The colour bar is in centimetres and ends at plus and minus ``limit`` metres.
    """
    cmap = mpl.colormaps[ERROR_MAP].with_extremes(bad=MISSING)
    shown = np.ma.masked_invalid(np.asarray(error) * 100)
    image = ax.imshow(shown, cmap=cmap, vmin=-limit * 100, vmax=limit * 100)
    bare_axes(ax, title)
    if colorbar:
        ax.figure.colorbar(image, ax=ax, shrink=0.75, pad=0.02, extend="both", label="error (cm)")
    return image


def show_mask(ax: Axes, mask: BoolArray, color: str, alpha: float) -> AxesImage:
    """Lay a mask, shape (H, W), over the image that the axes already show."""
    overlay = np.zeros((*mask.shape, 4))
    overlay[..., :3] = to_rgb(color)
    overlay[..., 3] = alpha * mask
    return ax.imshow(overlay)


def show_keypoints(ax: Axes, uv: npt.ArrayLike, *, size: float = 12.0) -> None:
    """Draw 21 keypoints (u, v) and their bones over an image, one colour a finger."""
    points = np.asarray(uv, dtype=float)
    for (parent, child), color in zip(BONES, BONE_COLORS, strict=True):
        segment = points[[parent, child]]
        ax.plot(segment[:, 0], segment[:, 1], color="white", lw=2.6, solid_capstyle="round")
        ax.plot(segment[:, 0], segment[:, 1], color=color, lw=1.6, solid_capstyle="round")
    ax.scatter(points[:, 0], points[:, 1], s=size, c="white", edgecolors="black", lw=0.6, zorder=3)


def frame_strip(
    images: Sequence[npt.NDArray[Any]],
    titles: Sequence[str],
    *,
    vmin: float | None = None,
    vmax: float | None = None,
) -> Figure:
    """Draw images side by side, each with a title: (H, W, 3) colour, (H, W) depth, (H, W) bool.

    All depth images share one scale, from ``vmin`` to ``vmax`` metres or as `show_depth` has it,
    and one colour bar stands at the right.
    """
    if len(images) != len(titles):
        raise ValueError(f"{len(images)} images, but {len(titles)} titles")
    depths = [im for im in images if im.ndim == 2 and im.dtype != np.bool_]
    low, high = _limits(np.concatenate([d.ravel() for d in (*depths, np.zeros(0))]), vmin, vmax)
    rows, columns = images[0].shape[:2]
    bar = 0.9 if depths else 0.0
    height = (9.0 - bar) / len(images) * rows / columns + 0.45
    fig: Figure
    fig, axes = plt.subplots(1, len(images), figsize=(9.0, height), squeeze=False)
    last: AxesImage | None = None
    for ax, image, title in zip(axes[0], images, titles, strict=True):
        if image.ndim == 3:
            show_color(ax, image, title)
        elif image.dtype == np.bool_:
            ax.imshow(image, cmap="gray", vmin=0, vmax=1)
            bare_axes(ax, title)
        else:
            last = show_depth(ax, image, title, vmin=low, vmax=high, colorbar=False)
    if last is not None:
        fig.colorbar(last, ax=axes[0].tolist(), shrink=0.85, pad=0.01, label="depth (m)")
    return fig


def legend_below(fig: Figure, ax: Axes, *, columns: int = 4) -> None:
    """Put the legend of one of a figure's axes below all of them."""
    handles, labels = ax.get_legend_handles_labels()
    fig.legend(handles, labels, fontsize=8.5, loc="outside lower center", ncols=columns)


def show_both_splits(
    draw: Callable[[Axes, str], None], *, height: float, legend: int = 0, same_scale: bool = True
) -> None:
    """Show known objects on the left and unknown ones on the right, `height` inches high.

    `draw` is called with axes and "known" or "unknown"; `legend` has so many columns, none at 0.
    """
    fig, axes = plt.subplots(1, 2, figsize=(9, height), sharey=same_scale)
    for ax, split in zip(axes, ("known", "unknown"), strict=True):
        draw(ax, split)
    ends = np.array([ax.get_xlim() for ax in axes])
    for ax in axes:  # lengths side by side can be compared
        ax.set_xlim(ends.min(), ends.max())
    if legend:
        legend_below(fig, axes[0], columns=legend)
    plt.show()


def live_figure(draw: Callable[..., object], **sliders: Any) -> Any:
    """Sliders for draw's arguments, each (label, start, least, most, step) or a widget.

    Show it as a cell's last value, beside a static figure that tells the same story.
    """
    import ipywidgets as widgets  # only notebooks need it

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
