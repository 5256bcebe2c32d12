"""Figures of features for the book: cells, false colours, boxes, influence and widths."""

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from torch import Tensor

from hadr.camera import BoolArray, FloatArray
from hadr.figures.panels import COLORS, show_color

_PARTS = (COLORS["hadr"], COLORS["voxel"], COLORS["hand"], "#5a5a5a", "#8a8a8a", "#b8b8b8")


def false_color(feature_map: Tensor) -> npt.NDArray[np.float32]:
    """The three strongest principal components of a map (C, H, W) as red, green, blue in 0..1."""
    flat = feature_map.flatten(1).T  # (pixels, C)
    flat = flat - flat.mean(dim=0)
    view = flat @ torch.linalg.svd(flat, full_matrices=False).Vh[:3].T  # (pixels, 3)
    low, high = view.quantile(0.02, dim=0), view.quantile(0.98, dim=0)
    scaled = ((view - low) / (high - low)).clamp(0, 1)
    return np.asarray(scaled.reshape(*feature_map.shape[1:], 3))


def show_cells(ax: Axes, picture: npt.NDArray[Any], stride: int) -> None:
    """Show an image, shape (H, W, 3), with a grid of square cells of `stride` pixels over it."""
    height, width = picture.shape[:2]
    show_color(ax, picture)
    x, y = np.arange(0, width + 1, stride) - 0.5, np.arange(0, height + 1, stride) - 0.5
    ax.vlines(x, -0.5, height - 0.5, color="white", lw=0.5)
    ax.hlines(y, -0.5, width - 0.5, color="white", lw=0.5)


def show_box(ax: Axes, picture: npt.NDArray[Any], row: int, column: int, *, aligned: bool) -> None:
    """Show the box of one ray, enlarged: its 2x2 bins and ROI align's samples, one per pixel."""
    box, half = 8, 4
    shift = 0.5 if aligned else 0.0  # from the box's coordinates to pixel centres at integers
    show_color(ax, picture)
    for left in (column - half, column):
        for top in (row - half, row):
            bin_corner = (left - shift, top - shift)
            ax.add_patch(plt.Rectangle(bin_corner, half, half, fill=False, ec="white", lw=2))
    samples = np.arange(box) - half + 0.5 - shift
    x, y = np.meshgrid(column + samples, row + samples)
    ax.plot(x.ravel(), y.ravel(), ".", color=COLORS["highlight"], ms=4)
    ax.plot(column, row, "s", color=COLORS["ray"], ms=7)
    ax.set(xlim=(column - half - 2.5, column + half + 2.5))
    ax.set(ylim=(row + half + 2.5, row - half - 2.5))


def box_picture(picture: npt.NDArray[Any], row: int, column: int) -> Figure:
    """Draw one ray's box of 8x8 pixels: in the picture, enlarged with samples, its bins' means."""
    figure: Figure = plt.figure(figsize=(9, 2.9), layout="none")  # all alike, and drawn faster
    figure.subplots_adjust(0.01, 0.02, 0.99, 0.89, 0.06, 0.0)
    axes = figure.subplots(1, 3, width_ratios=(1.75, 1, 1))
    show_color(axes[0], picture, f"column {column}, row {row}")
    corner = (column - 4.5, row - 4.5)
    axes[0].add_patch(plt.Rectangle(corner, 8, 8, fill=False, ec=COLORS["ray"], lw=2))
    show_box(axes[1], picture, row, column, aligned=True)
    axes[1].set_title("box, bins, samples")
    box = np.asarray(picture, dtype=float)[row - 4 : row + 4, column - 4 : column + 4]
    show_color(axes[2], box.reshape(2, 4, 2, 4, 3).mean(axis=(1, 3)), "mean of each bin")
    return figure


def winners_figure(
    picture: npt.NDArray[Any],
    points_uv: npt.ArrayLike,
    winners_uv: npt.ArrayLike,
    share: npt.ArrayLike,
) -> Figure:
    """Draw a voxel's points (N, 2) and winners (K, 2); their share (K, C) of channels' maxima."""
    points, winners = np.asarray(points_uv), np.asarray(winners_uv)
    shares, marks = np.asarray(share), {"mfc": COLORS["highlight"], "mec": "black"}
    fig: Figure
    fig, (left, right) = plt.subplots(1, 2, figsize=(9, 3.9), width_ratios=[1, 1.1])
    show_color(left, 0.5 * np.asarray(picture) + 0.5, "points of one voxel, and the winners")
    left.plot(*points.T, ".", ms=3, color=COLORS["voxel"])
    left.plot(*winners.T, "o", ms=6, **marks)
    low, high = points.min(axis=0) - 5, points.max(axis=0) + 5
    left.set(xlim=(low[0], high[0]), ylim=(high[1], low[1]))
    image = right.imshow(shares, aspect="auto", cmap="magma_r", vmin=0, vmax=1)
    right.plot(range(shares.shape[1]), shares.argmax(axis=0), "o", ms=4, **marks)
    right.set(xlabel="channel", ylabel="winning point", title="share of the channel's maximum")
    for axis in (right.xaxis, right.yaxis):
        axis.set_major_locator(MaxNLocator(integer=True))
    fig.colorbar(image, ax=right, shrink=0.8)
    return fig


def influence_figure(maps: Mapping[str, FloatArray], outline: BoolArray) -> Figure:
    """Draw how strongly each pixel counts, relative to the strongest, on a logarithmic scale."""
    fig: Figure
    fig, axes = plt.subplots(1, len(maps), figsize=(9, 3.0), squeeze=False)
    for ax, (title, influence) in zip(axes[0], maps.items(), strict=True):
        relative = np.log10(influence / influence.max() + 1e-5)
        image = ax.imshow(relative, cmap="magma", vmin=-4, vmax=0)
        ax.contour(outline, levels=[0.5], colors=[COLORS["glass"]], linewidths=1)
        ax.set(title=title, xticks=[], yticks=[])
    fig.colorbar(image, ax=axes[0].tolist(), label="influence (log10)", shrink=0.9)
    return fig


def widths_figure(parts: Mapping[str, int]) -> Figure:
    """Draw how many numbers each part (at most six) brings to a row: one long divided bar."""
    fig: Figure
    fig, ax = plt.subplots(figsize=(9, 1.7))
    start = 0
    for (name, count), shade in zip(parts.items(), _PARTS, strict=False):
        ax.barh(0, count, left=start, color=shade, ec="white", lw=1.5)
        wide = count > 30
        text = f"{name}\n{count}".replace(" point", "\npoint") if wide else f"{name} {count}"
        ink = "black" if shade in (_PARTS[-1], COLORS["voxel"]) else "white"
        middle, turn = start + count / 2, 0 if wide else 90
        ax.text(middle, 0, text, ha="center", va="center", color=ink, fontsize=9, rotation=turn)
        start += count
    ax.set(xlim=(0, start), yticks=[], xlabel="column of the decoders' input")
    ax.spines["left"].set_visible(False)
    return fig
