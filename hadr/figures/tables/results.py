"""The measured tables as pictures and Markdown, drawn from result files and nothing else."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from hadr.camera import FloatArray
from hadr.figures.panels import COLORS
from hadr.figures.rows import Dots, draw_dot_rows
from hadr.metrics import METRICS, best_in_bold
from hadr.models.networks import DEPTH_NETWORKS, NETWORKS

Row = Mapping[str, Any]

NAMES: dict[str, str] = {
    "raw": "nothing",
    "inpainting": "inpainting",
    "nearest": "nearest valid depth",
    "hand-median": "the hand's median depth",
    "hand-offset": "hand's median + constant",
    "nearest-hand": "the most similar hand's glass",
    "nearest-hand-no-sister": "the same, its own hold left out",
    "no-hand": "HADR without the hand",
    "hadr": "HADR",
    "hadr-long": "HADR, trained longer",
    **{
        kind + long: NETWORKS[kind].title + words
        for kind in DEPTH_NETWORKS
        for long, words in (("", ""), ("-long", ", trained longer"))
    },
    "no-aggregation": "HADR without aggregation of scales",
    "no-point-fusion": "HADR without point fusion",
    "hand-2d": "HADR with the 2D hand feature",
    "hand-xy": "HADR with the hand's x and y in metres",
    "no-augmentation": "HADR with colours that are never changed in training",
    "six-cells": "HADR with cells of 33 cm",
    "cells-from-zero": "HADR with cells from 0 m on",
    "random-encoder": "HADR, encoder from random weights",
    "whole-picture": "HADR, without a window",
    "no-aggregation-thawed": "HADR without aggregation, no stage frozen",
    "full": "HADR, the full model",
}
"""How a method of a result file is called in tables and pictures, in the order of the tables."""
_SIGNS = (
    ("hadr", "o"), ("voxel", "^"), ("second rival", "v"), ("truth", "s"), ("rival", "X"),
    ("baseline", "P"), ("robot", "*"), ("glass", "d"), ("hand", "p"),
)  # fmt: skip
"""Colour and marker of the depth networks, in the order of their table; the last are to spare."""
_SIGN: dict[str, tuple[str, str]] = {
    **{
        kind + long: sign
        for kind, sign in zip(DEPTH_NETWORKS, cycle(_SIGNS), strict=False)
        for long in ("", "-long")
    },
    "no-hand": ("glass", "o"),
    "hand-median": ("hand", "D"),
    "hand-offset": ("hand", "d"),
}
_OTHER = ("raw", "o")


def markdown(
    table: pd.DataFrame, align: str = "lr", best: Iterable[Iterable[int]] | None = None
) -> str:
    """A table of cells as Markdown.

    `align` has a letter a column, the last one for all others; `best` names the rows that compete
    (`hadr.metrics.best_in_bold`), all that share their first cell where it is left out and the
    first column is that of the objects.
    """
    if best is None and table.columns[0] == "objects":
        best = table.groupby("objects").indices.values()
    table = best_in_bold(table, best or ())
    sides = [{"l": "left", "r": "right"}[side] for side in align.ljust(table.shape[1], align[-1])]
    return str(table.to_markdown(index=False, disable_numparse=True, colalign=sides))


def system_marker(method: str) -> str:
    """Marker of a method in all pictures of results, so that colour alone tells nothing."""
    return _SIGN.get(method, _OTHER)[1]


def system_color(method: str) -> str:
    """Colour of a method in all pictures of results."""
    return COLORS[_SIGN.get(method, _OTHER)[0]]


def ordered(rows: Sequence[Row], *splits: str) -> list[Row]:
    """Give the rows of one split after the other, each in the order of `NAMES`."""
    place = {name: number for number, name in enumerate(NAMES)}
    listed = sorted(rows, key=lambda row: place.get(row["method"], len(place)))
    return [row for split in splits for row in listed if row["split"] == split]


def difference_cell(pair: Mapping[str, Any] | None) -> str:
    """A mean difference with its standard error, centimetres; "-" where nothing was compared."""
    if pair is None or pair["standard_error_m"] is None:
        return "-"
    return with_doubt(pair["mean_difference_m"], pair["standard_error_m"], sign="+")


def with_doubt(value_m: float, doubt_m: float, *, sign: str = "") -> str:
    """Set a length with its standard error, metres, in centimetres; ``sign`` "+" shows its sign.

    A narrow column can break the line before "±" and nowhere else.
    """
    return f"{100 * value_m:{sign}.2f} ±\N{NO-BREAK SPACE}{100 * doubt_m:.2f}"


def rmse_cm(row: Row) -> str:
    """A row's RMSE with its standard error over holds, centimetres."""
    return with_doubt(row["rmse_m"], row["rmse_standard_error_m"])


def _listed(rows: Sequence[Row]) -> list[str]:
    """Methods that occur in any split, in the order of `NAMES`."""
    there = {row["method"] for row in rows}
    return [name for name in NAMES if name in there] + sorted(there - set(NAMES))


def _in_rows(rows: Sequence[Row], split: str, part: str) -> tuple[list[str], FloatArray]:
    """Names of all methods, and a part of each one's row of a split in cm; NaN without one."""
    own = {row["method"]: row for row in rows if row["split"] == split}
    methods = _listed(rows)
    values = [100 * (own[m].get(part) or 0) if m in own else np.nan for m in methods]
    return [NAMES.get(m, m) for m in methods], np.array(values)


def results_table(rows: Sequence[Row], published: Mapping[str, Mapping[str, Any]]) -> str:
    """Set the rows of both splits side by side, the paper's HADR below."""
    head = ["method", "known: RMSE (cm)", "MAE (cm)", "δ1.05 (%)", "unknown: RMSE (cm)", "MAE (cm)",
            "δ1.05 (%)", "weights (M)", "training (min)"]  # fmt: skip
    lines = []
    found = {(row["split"], row["method"]): row for row in rows}
    for method, name in NAMES.items():
        pair = [found.get((split, method)) for split in ("known", "unknown")]
        if pair == [None, None]:
            continue
        cells = [cell for row in pair for cell in scores(row)]
        trained = next((row for row in pair if row and row.get("training_s")), None)
        size = f"{trained['parameters'] / 1e6:.1f}" if trained else "-"
        minutes = f"{trained['training_s'] / 60:.0f}" if trained else "-"
        lines.append([name, *cells, size, minutes])
    cells = []
    for split in ("known", "unknown"):
        rmse, _, mae, delta = published[split]["HADR"][:4]
        cells += [f"{100 * rmse:.1f}", f"{100 * mae:.1f}", f"{delta:.2f}"]
    lines.append(["*HADR as published*", *cells, "-", "-"])
    return markdown(pd.DataFrame(lines, columns=head), best=[range(len(lines) - 1)])


def scores(row: Row | None) -> list[str]:
    """RMSE, MAE and the tightest share of a row, as tables print them."""
    if row is None:
        return ["-"] * 3
    return [METRICS[name].text(row[name]) for name in ("rmse_m", "mae_m", "delta_105")]


def margins_table(rows: Sequence[Row], pairs: Sequence[tuple[str, str]]) -> str:
    """Say by how much a method's RMSE differs from another's, in percent, for pairs of methods."""
    own = {(row["split"], row["method"]): row["rmse_m"] for row in rows}
    lines = []
    for one, other in pairs:
        both = [(own.get((s, one)), own.get((s, other))) for s in ("known", "unknown")]
        cells = [f"{100 * (a / b - 1):+.0f} %" if a and b else "-" for a, b in both]
        lines.append([NAMES[one], NAMES[other], *cells])
    head = ["RMSE of", "against", "known", "unknown"]
    return markdown(pd.DataFrame(lines, columns=head), "llr")


def parts_table(rows: Sequence[Row]) -> str:
    """List each method's error, and what is left of it, as `draw_parts` shows them."""
    parts = {
        "rmse_m": "RMSE (cm)",
        "place_m": "place: median error (cm)",
        "shape_m": "shape, with tilt (cm)",
        "tilt_m": "shape without tilt (cm)",
    }
    lines = [
        [row["split"], NAMES[row["method"]], *(f"{100 * row[part]:.2f}" for part in parts)]
        for row in ordered(rows, "known", "unknown")
    ]
    head = ["objects", "method", *parts.values()]
    return markdown(pd.DataFrame(lines, columns=head), "llr")


def seeing_table(rows: Sequence[Row], parts: Sequence[Row], colors: Sequence[Row]) -> str:
    """List what each method sees: its error, of place and of shape, and what colours are worth."""
    place = {row["method"]: row for row in parts if row["split"] == "known"}
    worth = {row["method"]: difference_cell(row["others_minus_own"]) for row in colors}
    head = ["method", "RMSE (cm)", "δ1.05 (%)", "error of place (cm)", "of shape (cm)",
            "another frame's colours cost (cm)"]  # fmt: skip
    lines = []
    for row in ordered(rows, "known"):
        method, found = row["method"], place.get(row["method"])
        apart = [f"{100 * found[p]:.2f}" if found else "-" for p in ("place_m", "shape_m")]
        cells = [rmse_cm(row), f"{row['delta_105']:.1f}", *apart, worth.get(method, "-")]
        lines.append([NAMES[method], *cells])
    return markdown(pd.DataFrame(lines, columns=head), best=[range(len(lines))])


def draw_systems(ax: Axes, rows: Sequence[Row], split: str, published_rmse_m: float) -> None:
    """Draw each method's RMSE with its standard error over holds as dots, the paper's as a line."""
    names, values = _in_rows(rows, split, "rmse_m")
    _, doubt = _in_rows(rows, split, "rmse_standard_error_m")
    colors = [system_color(method) for method in _listed(rows)]
    ends = np.stack([values - doubt, values + doubt], axis=1)
    draw_dot_rows(ax, names, [Dots(values, colors, ends=ends, text="{:.1f}")])
    ax.axvline(100 * published_rmse_m, color=COLORS["truth"], lw=1, ls=":")
    ax.set(xscale="log", xlim=(0.6, 300), xlabel="RMSE (cm)", title=f"{split} objects")
    ax.set_xticks([1, 3, 10, 30, 100], ["1", "3", "10", "30", "100"])
    ax.minorticks_off()


def draw_parts(ax: Axes, rows: Sequence[Row], split: str) -> None:
    """Draw what is left of each method's error when place, and place and tilt, are given away."""
    colors = [system_color(method) for method in _listed(rows)]
    series = []
    for part, label, marker in (
        ("rmse_m", "whole error", "o"),
        ("shape_m", "without its median: shape, with tilt", "s"),
        ("tilt_m", "without its best plane: shape without tilt", "D"),
    ):
        names, values = _in_rows(rows, split, part)
        series.append(Dots(values, colors, marker, label, hollow=marker != "o"))
    draw_dot_rows(ax, names, series, size=6, joined=True)
    ax.set(xlim=(0, None), xlabel="RMSE (cm)", title=f"{split} objects")


def draw_by_object(
    ax: Axes,
    rows: Sequence[Row],
    split: str,
    names: Mapping[str, str],
    part: str = "rmse_m",
    xlabel: str = "RMSE (cm)",
) -> None:
    """Draw each method's error on each object as a dot, one below the other as in the legend."""
    chosen = ordered(rows, split)
    below = np.linspace(-0.33, 0.33, len(chosen))
    objects = sorted({number for row in chosen for number in row["by_object"]})
    series = [
        Dots([100 * row["by_object"][number][part] for number in objects],
             system_color(row["method"]), system_marker(row["method"]),
             NAMES.get(str(row["method"]), str(row["method"])),
             hollow=row["method"].endswith("-long"), aside=aside)
        for row, aside in zip(chosen, below, strict=True)
    ]  # fmt: skip
    draw_dot_rows(ax, [names.get(n, n) for n in objects], series, size=6)
    ax.set(xlabel=xlabel, title=f"{split} objects")
    if part == "bias_m":
        ax.axvline(0, color=COLORS["truth"], lw=0.8)
    else:
        ax.set_xlim(0, None)
    for row in range(0, len(objects), 2):
        ax.axhspan(row - 0.5, row + 0.5, color="#000000", alpha=0.05, lw=0)


def draw_hole(ax: Axes, rows: Sequence[Row], split: str) -> None:
    """Draw how far each network moves the glass as its hole grows and shrinks."""
    for row in ordered(rows, split):
        points = sorted([(0.0, 0.0, 0.0)] + [
            (100 * p["grown"], 100 * p["moved_m"], 100 * (p["standard_error_m"] or 0))
            for p in row["by_share"]
        ])  # fmt: skip
        share, moved, doubt = (list(column) for column in zip(*points, strict=True))
        color, marker = system_color(row["method"]), system_marker(row["method"])
        name = NAMES[row["method"]]
        above = 4 if row["method"].startswith("hadr") else 3
        ax.errorbar(
            share, moved, doubt, color=color, marker=marker, ms=5, lw=1.4, label=name, zorder=above
        )
    shown = [row for row in rows if row["split"] == split]
    if shown:
        grown = [100 * point["grown"] for row in shown for point in row["by_share"]]
        shares = np.linspace(min(*grown, 0.0), max(*grown, 0.0), 40)
        distance = float(np.mean([row["depth_m"] for row in shown]))
        ruler = 100 * distance * (1 / (1 + shares / 100) - 1)
        ax.plot(shares, ruler, "--", color=COLORS["raw"], lw=1, label="size alone", zorder=0)
    ax.axhline(0, color=COLORS["truth"], lw=0.8)
    ax.set(
        xlabel="hole wider by (% of its radius)",
        ylabel="nearer  ←  glass moves (cm)  →  farther",
        title=f"{split} objects",
    )
    ax.label_outer()
