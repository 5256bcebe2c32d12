"""Plots with one named row a thing, the first at the top: dots with their doubt, and bars."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes


@dataclass(frozen=True)
class Dots:
    """One dot a row, at values of shape (N,), where NaN leaves a row free.

    Colours and markers are one for all rows or one a row; `label` is what the legend says. Through
    each dot goes a bar between its ends, (N, 2), NaN for none. It stands `aside` rows below its
    row's middle. `text` formats the number beside it, for example ``"{:.1f}"``.
    """

    values: npt.ArrayLike
    colors: str | Sequence[str]
    markers: str | Sequence[str] = "o"
    label: str = ""
    ends: npt.ArrayLike | None = None
    hollow: bool = False
    aside: float = 0.0
    text: str = ""


def name_rows(ax: Axes, names: Sequence[str]) -> None:
    """Name the rows 0, 1, ... of axes, the first at the top."""
    ax.set_yticks(range(len(names)), names)
    ax.set_ylim(len(names) - 0.4, -0.6)


def draw_dot_rows(
    ax: Axes, names: Sequence[str], series: Sequence[Dots], *, size: float = 7, joined: bool = False
) -> None:
    """Draw series of dots, `size` points large, in N named rows.

    Where they are joined, a line in the first series' colour joins the dots of each row.
    """
    if joined:
        every = np.array([dots.values for dots in series], dtype=float)
        for row, color in enumerate(_each(series[0].colors, len(names))):
            here = every[np.isfinite(every[:, row]), row]
            ax.plot(here, np.full(len(here), row), color=color, lw=1.2, alpha=0.7)
    for dots in series:
        colors, markers = _each(dots.colors, len(names)), _each(dots.markers, len(names))
        values = np.asarray(dots.values, dtype=float)
        ends = np.stack([values, values], 1) if dots.ends is None else np.asarray(dots.ends, float)
        style: dict[str, Any] = {"ls": "", "ms": size} | ({"mfc": "white"} if dots.hollow else {})
        for row, (value, (low, high)) in enumerate(zip(values, ends, strict=True)):
            at, color = row + dots.aside, colors[row]
            if high > low:
                ax.plot([low, high], [at, at], color=color, lw=1.8)
            ax.plot(value, at, markers[row], color=color, **style)
            if dots.text and np.isfinite(value):
                left = dots.text.startswith("{:+") and value < 0
                ax.annotate(dots.text.format(value), (low if left else high, at), va="center",
                            xytext=(-6 if left else 6, 0), textcoords="offset points",
                            ha="right" if left else "left", fontsize=9)  # fmt: skip
        if dots.label:
            grey = "#7f7f7f" if colors is dots.colors else colors[0]  # no one row's colour
            ax.plot([], [], markers[0], color=grey, label=dots.label, **style)
    name_rows(ax, names)


def draw_bar_rows(
    ax: Axes,
    names: Sequence[str],
    parts: Mapping[str, npt.ArrayLike],
    colors: Sequence[Any],
    *,
    edges: Any = "none",
    hatches: Sequence[str] = (),
    height: float = 0.7,
    left: npt.ArrayLike = 0.0,
    text: str = "",
    least: float = 0.0,
) -> None:
    """Draw bars in named rows, one behind the other from left to right.

    `parts` has by what the legend says the lengths of its bars, shape (N,), with a colour (or one a
    row) and a hatch each; they begin at `left`. `text` formats the number within a bar, for example
    ``"{:.0f}"``; those shorter than `least` get none.
    """
    start = np.broadcast_to(np.asarray(left, dtype=float), len(names)).copy()
    box = {"facecolor": "white", "edgecolor": "none", "pad": 1.0, "alpha": 0.8}
    for k, (part, values) in enumerate(parts.items()):
        lengths = np.asarray(values, dtype=float)
        ax.barh(range(len(names)), lengths, height, start, label=part, color=colors[k],
                edgecolor=edges, hatch=hatches[k] if hatches else None)  # fmt: skip
        for row, length in enumerate(lengths):
            if text and length > 0 and length >= least:
                ax.text(start[row] + length / 2, row, text.format(length), ha="center",
                        va="center", fontsize=8.5, bbox=box)  # fmt: skip
        start += np.nan_to_num(lengths)
    name_rows(ax, names)


def _each(value: str | Sequence[str], count: int) -> Sequence[str]:
    return [value] * count if isinstance(value, str) else value
