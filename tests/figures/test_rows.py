"""Plots of named rows: what stands where, and in which colour."""

import numpy as np
import pytest
from matplotlib.colors import to_hex

from hadr.figures.rows import Dots, draw_bar_rows, draw_dot_rows


def names(axes):
    return [label.get_text() for label in axes.get_yticklabels()]


def test_the_first_row_is_at_the_top_and_numbers_stand_beside_their_bars(ax):
    values = np.array([2.0, np.nan, -1.0])
    ends = np.stack([values - 0.5, values + 0.5], axis=1)
    draw_dot_rows(ax, ["a", "b", "c"], [Dots(values, ["red", "blue", "green"], ends=ends,
                                              text="{:+.1f}", label="one")])  # fmt: skip
    assert names(ax) == ["a", "b", "c"]
    assert ax.yaxis_inverted()
    bar, dot = ax.lines[:2]
    assert list(bar.get_xdata()) == [1.5, 2.5]
    assert (dot.get_xdata()[0], dot.get_ydata()[0], dot.get_color()) == (2.0, 0, "red")
    assert [(t.get_text(), t.xy) for t in ax.texts] == [("+2.0", (2.5, 0)), ("-1.0", (-1.5, 2))]
    (legend,) = ax.get_legend_handles_labels()[0]
    assert legend.get_color() == "#7f7f7f", "a series of many colours is grey in the legend"


def test_series_are_joined_and_may_be_hollow_and_stand_aside(ax):
    known, unknown = Dots([1.0, 2.0], "red"), Dots([3.0, 1.5], "red", "s", hollow=True, aside=0.2)
    draw_dot_rows(ax, ["a", "b"], [known, unknown], joined=True)
    joints, dots = ax.lines[:2], ax.lines[2:]
    assert [list(line.get_xdata()) for line in joints] == [[1.0, 3.0], [2.0, 1.5]]
    assert [d.get_markerfacecolor() for d in dots] == ["red", "red", "white", "white"]
    assert [float(d.get_ydata()[0]) for d in dots] == pytest.approx([0, 1, 0.2, 1.2])


def test_bars_stand_end_to_end_with_their_numbers_inside(ax):
    parts = {"own": [3.0, 1.0], "rest": [0.0, 4.0]}
    draw_bar_rows(ax, ["a", "b"], parts, ["#ff0000", "#0000ff"], text="{:.0f}", least=2,
                  hatches=["", "//"], left=[0.0, 1.0])  # fmt: skip
    assert names(ax) == ["a", "b"]
    ends = [(bar.get_x(), bar.get_width()) for bar in ax.patches]
    assert ends == [(0, 3), (1, 1), (3, 0), (2, 4)]
    assert [bar.get_hatch() for bar in ax.patches[1:3]] == ["", "//"]
    assert to_hex(ax.patches[3].get_facecolor()) == "#0000ff"
    assert [(t.get_text(), t.get_position()) for t in ax.texts] == [("3", (1.5, 0)), ("4", (4, 1))]
    assert ax.get_legend_handles_labels()[1] == ["own", "rest"]
