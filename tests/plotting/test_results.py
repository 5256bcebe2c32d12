"""Tables and pictures show what the result file says, and say what is missing."""

from __future__ import annotations

import matplotlib.pyplot as plt
import pytest

from hadr.plotting.results import (
    draw_by_object,
    draw_learning,
    draw_parts,
    draw_systems,
    results_table,
)

PAPER = {split: {"HADR": [0.009, 0.016, 0.005, 95.22]} for split in ("known", "unknown")}


def row(method: str, split: str, rmse: float, **more: object) -> dict[str, object]:
    return {"method": method, "split": split, "rmse_m": rmse, "mae_m": rmse / 2,
            "delta_105": 70.0, "rmse_standard_error_m": 0.001, **more}  # fmt: skip


ROWS = [
    row("hadr", "known", 0.0312, parameters=2_700_000, training_s=1200.0,
        curve={"seconds": [60, 120], "validation_rmse_m": [0.05, 0.04]}),
    row("raw", "known", 0.65),
    row("hadr", "unknown", 0.0456),
]  # fmt: skip


def test_the_table_has_each_number_once_and_says_what_is_missing() -> None:
    lines = results_table(ROWS, PAPER).splitlines()
    assert lines[2].startswith("| raw depth | 65.00 | 32.50 | 70.00 | - | - | - | - | - |")
    assert lines[3] == "| HADR | 3.12 | 1.56 | 70.00 | 4.56 | 2.28 | 70.00 | 2.7 | 20 |"
    assert "published" in lines[-1]
    assert "| 0.9 | 0.5 | 95.22 |" in lines[-1]
    assert len({line.count("|") for line in lines}) == 1


def test_systems_stand_where_they_were_measured() -> None:
    fig, ax = plt.subplots()
    draw_systems(ax, ROWS, "known", 0.009)
    assert [t.get_text() for t in ax.get_yticklabels()] == ["raw depth", "HADR"]
    assert {t.get_text() for t in ax.texts} == {"65.0", "3.1"}
    plt.close(fig)


def test_a_run_that_one_split_lacks_leaves_its_line_empty() -> None:
    fig, axes = plt.subplots(1, 2, sharey=True)
    for ax, split in zip(axes, ("known", "unknown"), strict=True):
        draw_systems(ax, ROWS, split, 0.009)
    assert [t.get_text() for t in axes[0].get_yticklabels()] == ["raw depth", "HADR"]
    (number,) = axes[1].texts
    assert number.get_text() == "4.6"
    assert number.xy[1] == axes[1].get_yticks()[1]  # HADR's line
    plt.close(fig)


def test_curves_are_in_minutes_and_centimetres() -> None:
    fig, ax = plt.subplots()
    draw_learning(ax, ROWS, "known")
    (line,) = ax.lines
    assert line.get_xdata().tolist() == pytest.approx([1, 2])
    assert line.get_ydata().tolist() == pytest.approx([5, 4])
    plt.close(fig)


def test_parts_and_objects_in_centimetres() -> None:
    parts = {"rmse_m": 0.04, "shape_m": 0.02, "tilt_m": 0.01}
    errors = [{"method": "hadr", "split": "known", **parts, "by_object": {"0001": parts}}]
    fig, (left, right) = plt.subplots(1, 2)
    draw_parts(left, errors, "known")
    assert sorted(float(x) for line in left.lines[1:4] for x in line.get_xdata()) == pytest.approx(
        [1, 2, 4]
    )
    draw_by_object(right, errors, "known", {"0001": "cup"})
    assert right.get_yticklabels()[0].get_text() == "0001 cup"
    assert right.lines[0].get_xdata() == pytest.approx([4])
    plt.close(fig)
