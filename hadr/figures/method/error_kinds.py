"""Errors of depth by kind: real, simulated and analytic side by side, in one set of colours."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from hadr.camera import BoolArray, valid_depth, window_around
from hadr.figures.depth.corruption_examples import (
    KINDS,
    Depth,
    error_kinds,
    error_places,
    kind_shares,
)
from hadr.figures.panels import COLORS, ERROR_MAP, bare_axes, show_depth
from hadr.figures.rows import draw_bar_rows
from hadr.records.caches import read_only

_BLUE, *_REDS = (mpl.colors.to_hex(mpl.colormaps[ERROR_MAP](x)) for x in (0.12, 0.66, 0.82, 0.97))
#: Colours of the kinds of error: light grey is missing, as in all depth pictures; blue and red are
#: in front and behind, as in all pictures of errors; what is right is highlighted.
KIND_COLORS: tuple[str, ...] = ("#d9d9d9", _BLUE, COLORS["highlight"], *_REDS)
_SHORT = ("none", "<−1", "±1", "1–5", "5–20", ">20")
_NOWHERE = "#ffffff"
_EDGE = "#404040"


@dataclass(frozen=True)
class Source:
    """One column of the comparison: a depth picture, (H, W), what is true, and the glass's mask.

    Depths are z-depths in metres: 0 is missing where measured and unknown in the truth. Where
    nothing was measured there is no such picture, and the note stands in the column.
    """

    title: str
    measured: Depth | None
    truth: Depth
    mask: BoolArray
    note: str = ""

    @cached_property
    def places(self) -> dict[str, BoolArray]:
        """Where the pixels lie: each of `PLACES`, shape (H, W)."""
        return read_only(error_places(self.truth, self.mask))

    @cached_property
    def kinds(self) -> npt.NDArray[np.int64]:
        """The kind of each pixel's error, shape (H, W); -1 where the truth is unknown."""
        measured = np.zeros_like(self.truth) if self.measured is None else self.measured
        return read_only(error_kinds(measured, self.truth))

    def shares(self, place: str) -> npt.NDArray[np.float64]:
        """Share of each kind of error at a place, shape (6,); NaN without a picture."""
        if self.measured is None:
            return np.full(len(KINDS), np.nan)
        return kind_shares(self.kinds, self.places[place])

    def errors_m(self, place: str) -> npt.NDArray[np.float64]:
        """Measured minus true depth at a place, where both are known, metres, shape (N,)."""
        if self.measured is None:
            return np.zeros(0)
        known = self.places[place] & valid_depth(self.truth) & valid_depth(self.measured)
        return np.asarray((self.measured - self.truth)[known], dtype=float)


def error_kinds_picture(sources: Sequence[Source], place: str) -> Figure:
    """Draw sources side by side: what was measured, the errors' kinds at a place, their shares."""
    figure: Figure = plt.figure(figsize=(8, 5.5), layout="none")  # all alike, and drawn faster
    figure.subplots_adjust(0.072, 0.085, 0.895, 0.945, 0.06, 0.16)
    axes = figure.subplots(3, len(sources), squeeze=False, height_ratios=(1, 1, 0.8))
    around = np.concatenate([s.truth[window_around(s.mask, 22)].ravel() for s in sources])
    near, far = np.percentile(around[valid_depth(around)], (1, 95))  # one scale for all
    image = None
    for column, source in zip(axes.T, sources, strict=True):
        column[0].set_title(source.title)
        if source.measured is None:
            _say(column, source.note)
            continue
        window = window_around(source.mask, 22)
        image = show_depth(column[0], source.measured[window], vmin=near, vmax=far, colorbar=False)
        kinds = np.where(source.places[place], source.kinds, -1)
        colors = ListedColormap([_NOWHERE, *KIND_COLORS])
        column[1].imshow(kinds[window], cmap=colors, vmin=-1.5, vmax=len(KINDS) - 0.5)
        column[1].set(xticks=[], yticks=[])
        column[1].spines[:].set_color("#b0b0b0")
        column[1].spines[:].set_visible(True)
        _draw_shares(column[2], source, place)
    axes[0, 0].set_ylabel("measured depth")
    axes[1, 0].set_ylabel(f"error {place}")
    axes[2, 0].set_ylabel("share (%)")
    for ax in axes[2, 1:]:
        ax.set_yticks([])
    if image is not None:
        box = axes[0, -1].get_position()
        bar = figure.colorbar(image, cax=figure.add_axes((0.905, box.y0, 0.014, box.height)))
        bar.locator = MaxNLocator(4)
        bar.update_ticks()
        bar.set_label("depth (m)")
    return figure


def _say(column: Sequence[Axes], note: str) -> None:
    for ax in column:
        bare_axes(ax)
    column[1].text(
        0.5, 0.5, note, ha="center", va="center", transform=column[1].transAxes, color="#505050"
    )


def _draw_shares(ax: Axes, source: Source, place: str) -> None:
    shares = 100 * source.shares(place)
    bars = ax.bar(range(len(KINDS)), shares, color=KIND_COLORS, edgecolor=_EDGE, lw=0.7)
    ax.bar_label(bars, fmt="%.0f", fontsize=9)
    ax.set(ylim=(0, 165), yticks=(0, 50, 100))  # the words stand above the bars
    ax.set_xticks(range(len(KINDS)), _SHORT, fontsize=8.5)
    ax.tick_params(axis="x", length=0)
    errors, unknown = source.errors_m(place), np.mean(source.kinds[source.places[place]] < 0)
    lines = ["nothing measured"]
    if errors.size:
        middle, typical = 100 * np.median(errors), 100 * np.median(np.abs(errors))
        lines = [f"median {middle:+.2f} cm, size {typical:.2f} cm"]
    if unknown > 0.005:
        lines.append(f"truth unknown: {unknown:.0%}")
    ax.text(
        0.985, 0.97, "\n".join(lines), ha="right", va="top", fontsize=8.5, transform=ax.transAxes
    )
    ax.set_xlabel("cm behind the truth", fontsize=9)


def draw_kind_bars(ax: Axes, sources: Mapping[str, Source], place: str) -> None:
    """Draw the shares of several sources as stacked bars, one below the other."""
    shares = 100 * np.array([source.shares(place) for source in sources.values()])
    parts = dict(zip(KINDS, shares.T, strict=True))
    draw_bar_rows(ax, list(sources), parts, KIND_COLORS, text="{:.0f}", least=4, edges=_EDGE)
    ax.set(xlim=(0, 100), xlabel=f"share of the pixels {place} (%)")
    ax.tick_params(axis="y", length=0)
    ax.spines["left"].set_visible(False)
    ax.legend(loc="lower center", bbox_to_anchor=(0.42, 1.0), ncols=3)
