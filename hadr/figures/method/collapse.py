"""A colour encoder's collapse: its stages' ranks and the worth of colours over the epochs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, ScalarFormatter

STAGE_COLORS = ("#56B4E9", "#0072B2", "#004B76", "#000000")
"""Of the stages, the finest first."""
STYLES = ("-", "--", "-.", ":")


def draw_collapse(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw the ways of results/training/collapse.json side by side, one a column.

    Above is the effective rank of each of the encoder's stages before the training and after each
    epoch, below by how much the RMSE grows with another frame's colours.
    """
    figure: Figure
    figure, axes = plt.subplots(2, len(rows), figsize=(9, 4.8), sharex=True, sharey="row")
    for column, row in enumerate(rows):
        above, below = axes[:, column]
        epochs = row["epochs"]
        stages = [name for name in epochs[0] if name.startswith("rank_")]
        for name, color, style in zip(stages, STAGE_COLORS, STYLES, strict=False):
            values = [epoch[name] for epoch in epochs]
            above.plot(values, style, color=color, label=f"stage {name.removeprefix('rank_')}")
        below.plot(100 * np.array([epoch["color_gain_m"] for epoch in epochs]), color="#D55E00")
        below.axhline(0, color="grey", lw=0.8)
        above.set_title(row["way"].replace(", ", "\n", 1))
        below.set_xlabel("epoch")
    axes[0, 0].set(ylabel="effective rank\n(directions)", yscale="log")
    axes[0, 0].yaxis.set_major_locator(FixedLocator([1, 2, 4, 8, 16, 32, 64]))
    axes[0, 0].yaxis.set_major_formatter(ScalarFormatter())
    axes[0, 0].yaxis.set_minor_locator(FixedLocator([]))
    axes[1, 0].set_ylabel("cost of another\nframe's colours (cm)")
    names = axes[0, 0].get_legend_handles_labels()
    figure.legend(*names, loc="outside lower center", ncols=len(STAGE_COLORS))
    return figure
