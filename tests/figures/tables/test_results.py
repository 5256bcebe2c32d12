"""Tables and pictures show what the result file says, and say what is missing."""

import re

import cv2
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from hadr.figures.tables.comparison import (
    ablation_table,
    averages_table,
    compared,
    draw_against_paper,
    draw_error_over_time,
    memory_table,
    orders_table,
    poses_table,
    reasons_table,
)
from hadr.figures.tables.results import (
    draw_hole,
    draw_systems,
    margins_table,
    parts_table,
    results_table,
    seeing_table,
    system_color,
)
from hadr.models.networks import DEPTH_NETWORKS

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
    lines = [re.sub(" +", " ", line) for line in results_table(ROWS, PAPER).splitlines()]
    assert lines[2].startswith("| nothing | 65.00 | 32.50 | 70.00 | - | - | - | - | - |")
    assert lines[3] == "| HADR | **3.12** | **1.56** | 70.00 | 4.56 | 2.28 | 70.00 | 2.7 | 20 |"
    assert "published" in lines[-1]
    assert "| 0.9 | 0.5 | 95.22 |" in lines[-1]
    assert len({line.count("|") for line in lines}) == 1


def test_a_run_that_one_split_lacks_leaves_its_line_empty() -> None:
    _, axes = plt.subplots(1, 2, sharey=True)
    for ax, split in zip(axes, ("known", "unknown"), strict=True):
        draw_systems(ax, ROWS, split, 0.009)
    assert [t.get_text() for t in axes[0].get_yticklabels()] == ["nothing", "HADR"]
    (number,) = axes[1].texts
    assert number.get_text() == "4.6"
    assert number.xy[1] == axes[1].get_yticks()[1]  # HADR's line


def test_margins_are_percent_of_the_other_and_a_missing_one_is_said() -> None:
    (line,) = margins_table(ROWS, [("hadr", "raw")]).splitlines()[2:]
    assert cells(line) == ["HADR", "nothing", "-95 %", "-"]


def test_parts_are_listed_in_centimetres() -> None:
    parts = {"rmse_m": 0.04, "place_m": 0.03, "shape_m": 0.02, "tilt_m": 0.01}
    (line,) = parts_table([{"method": "hadr", "split": "unknown", **parts}]).splitlines()[2:]
    assert cells(line) == ["unknown", "HADR", "4.00", "3.00", "2.00", "1.00"]


FIVE = {
    "known": {"HADR": [0.009, 0.016, 0.005, 95.22], "SwinDRNet": [0.009, 0.015, 0.005, 94.82],
              "TODE-Trans": [0.024, 0.056, 0.017, 57.03]},
    "unknown": {"HADR": [0.018, 0.042, 0.014, 72.74]},
    "ablation": {
        "Full Model": [0.009, 0.016, 0.005, 95.22],
        "w/o Hand Feature": [0.012, 0.019, 0.006, 93.35],
    },
}  # fmt: skip
RIVALS = [
    row("hadr", "known", 0.0312, pooled={"rmse_m": 0.04}, parameters=1,
        against_hand_median={"mean_difference_m": -0.01, "standard_error_m": 0.002},
        against_next={"method": "tode", "mean_difference_m": 0.0062, "standard_error_m": 0.001}),
    row("tode", "known", 0.025),
    row("unet-hand", "known", 0.02),
    row("hadr", "unknown", 0.0456),
]  # fmt: skip


def cells(line: str) -> list[str]:
    """Cells of a line without bold; the spaces that hold a number and its doubt as plain ones."""
    line = line.strip("|").replace("\N{NO-BREAK SPACE}", " ").replace("**", "")
    return [cell.strip() for cell in line.split("|")]


def test_what_a_network_sees_is_joined_by_method_and_what_was_not_measured_is_a_dash() -> None:
    parts = [{"method": "hadr", "split": "known", "place_m": 0.01, "shape_m": 0.02}]
    gap = {"mean_difference_m": 0.005, "standard_error_m": 0.001}
    colors = [{"method": "hadr", "others_minus_own": gap}]
    lines = [cells(line) for line in seeing_table(ROWS, parts, colors).splitlines()[2:]]
    assert lines == [
        ["nothing", "65.00 ± 0.10", "70.0", "-", "-", "-"],
        ["HADR", "3.12 ± 0.10", "70.0", "1.00", "2.00", "+0.50 ± 0.10"],
    ]


def test_orders_are_those_of_the_methods_that_both_tables_have() -> None:
    assert compared(RIVALS, FIVE, "known") == ["hadr", "tode"]
    lines = [cells(line) for line in orders_table(RIVALS, FIVE).splitlines()]
    assert lines[2][:8] == ["known", "HADR", "0.9", "1", "95.22", "3.12", "2", "70.00"]
    assert lines[2][8] == "+0.62 ± 0.10"
    assert lines[3] == ["known", "TODE-Trans", "2.4", "2", "57.03", "2.50", "1", "70.00", "-"]
    assert lines[4][:2] == ["unknown", "HADR"]
    assert len({len(line) for line in lines}) == 1
    bold = [line.count("**") // 2 for line in orders_table(RIVALS, FIVE).splitlines()]
    assert bold == [0, 0, 2, 1, 0]  # the paper's RMSE and delta of HADR, our RMSE of TODE-Trans


def test_a_number_and_its_doubt_take_two_lines_at_most() -> None:
    line = orders_table(RIVALS, FIVE).splitlines()[2]
    assert "+0.62 ±\N{NO-BREAK SPACE}0.10" in line


def test_reasons_stand_beside_the_differences() -> None:
    tables = {
        "known": RIVALS[:1],
        "unknown": RIVALS[3:],
        "ablation": [row("no-hand", "known", 0.05)],
    }
    reasons = {"hadr": ("it is small", "nowhere"), "no-hand": ("it is blind", "here")}
    lines = [cells(line) for line in reasons_table(tables, FIVE, reasons).splitlines()[2:]]
    assert lines == [
        ["HADR", "+2.2", "+2.8", "it is small", "nowhere"],
        ["HADR without the hand", "+3.8", "-", "it is blind", "here"],
    ]
    with pytest.raises(KeyError, match="lidf"):
        reasons_table(tables, {**FIVE, "known": {}, "unknown": {}}, {"lidf": ("", "")})


def test_published_dots_are_hollow_and_ours_full(ax) -> None:
    draw_against_paper(ax, RIVALS, FIVE, "known")
    dots = {(round(float(line.get_xdata()[0]), 2), line.get_markerfacecolor() == "white")
            for line in ax.lines if line.get_marker() in ("o", "X")}  # fmt: skip
    assert dots == {(0.9, True), (2.4, True), (3.12, False), (2.5, False)}
    assert [t.get_text() for t in ax.get_yticklabels()] == ["HADR", "TODE-Trans"]


def test_times_are_those_of_the_networks_that_were_scored(ax) -> None:
    speed = [{"method": "hadr", "preset": size, "wall_min_ms": ms}
             for size, ms in (("paper", 125.0), ("mini", 30.0), ("imagenet", 20.0))]  # fmt: skip
    draw_error_over_time(ax, RIVALS, speed, "known")
    (line,) = ax.lines
    assert (line.get_xdata()[0], line.get_ydata()[0]) == (20.0, pytest.approx(3.12))


def test_tables_of_parts_averages_and_poses() -> None:
    gap = {"mean_difference_m": 0.004, "standard_error_m": 0.001}
    parts = [row("no-hand", "known", 0.04, against_full=gap),
             row("full", "known", 0.0312, against_full=None)]  # fmt: skip
    part, full = (cells(line) for line in ablation_table(parts, FIVE).splitlines()[2:])
    assert part[4:] == ["4.00", "+0.40 ± 0.10", "2.00", "70.00"]
    assert full == ["HADR, the full model", "0.9", "0.5", "95.22", "3.12", "-", "1.56", "70.00"]
    (line,) = averages_table(RIVALS).splitlines()[2:]  # the others were compared with nothing
    assert cells(line) == ["known", "HADR", "3.12", "4.00", "-1.00 ± 0.20"]
    poses = [row("hadr", "known", 0.03, rank_correlation=0.25,
                 by_pose=[{"rmse_m": 0.02}, {"rmse_m": 0.03}, {"rmse_m": 0.04}])]  # fmt: skip
    assert cells(poses_table(poses).splitlines()[2]) == ["known", "HADR", "2.00", "4.00", "+0.25"]


def test_a_hole_moves_the_glass_in_centimetres_beside_the_line_of_size_alone(ax) -> None:
    shares = [{"grown": s, "moved_m": -s / 10, "standard_error_m": 0.001} for s in (-0.2, 0.25)]
    rows = [row("tode", "known", 0.04, depth_m=0.6, by_share=shares, elsewhere={})]
    draw_hole(ax, rows, "known")
    drawn = {line.get_label(): line for line in ax.lines}
    (bars,) = ax.containers
    x, y = bars.lines[0].get_data()
    assert x == pytest.approx([-20, 0, 25])
    assert y == pytest.approx([2, 0, -2.5])
    ruler = drawn["size alone"]
    assert ruler.get_xdata()[[0, -1]] == pytest.approx([-20, 25])
    # 60 cm away: a hole four fifths as wide is 75 cm away, one 5/4 as wide 48 cm
    assert ruler.get_ydata()[[0, -1]] == pytest.approx([15, -12])


def test_a_memory_is_shown_under_both_splits() -> None:
    def one(method: str, split: str, rmse_m: float, gap_m: float) -> dict[str, object]:
        gap = {"mean_difference_m": gap_m, "standard_error_m": 0.001}
        return row(method, split, rmse_m, rmse_standard_error_m=0.002, against_hand_median=gap)

    rows = [
        one("nearest-hand", "known", 0.04, -0.01),
        one("nearest-hand", "by-frame", 0.03, -0.02),
        one("hand-median", "by-frame", 0.049, 0),
        one("hand-median", "known", 0.05, 0),
    ]
    lines = [cells(line) for line in memory_table(rows).splitlines()[2:]]
    assert lines == [
        ["the hand's median depth", "5.00 ± 0.20", "-", "4.90 ± 0.20", "-"],
        ["the most similar hand's glass", "4.00 ± 0.20", "-1.00 ± 0.10",
         "3.00 ± 0.20", "-2.00 ± 0.10"],
    ]  # fmt: skip


LOSSES = {
    "none": np.eye(3),
    "protan": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
               [-0.003882, -0.048116, 1.051998]],
    "deutan": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
               [-0.011820, 0.042940, 0.968881]],
    "tritan": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
               [0.004733, 0.691367, 0.303900]],
}  # fmt: skip
"""Linear RGB as it is seen without one kind of cones: Machado, Oliveira and Fernandes (2009)."""


@pytest.mark.parametrize("loss", LOSSES)
def test_methods_have_colors_that_colour_blind_readers_tell_apart(loss: str) -> None:
    names = [*DEPTH_NETWORKS, "no-hand", "hand-median"]
    colors = np.array([to_rgb(system_color(name)) for name in names])
    linear = np.where(colors <= 0.04045, colors / 12.92, ((colors + 0.055) / 1.055) ** 2.4)
    seen = np.clip(linear @ np.array(LOSSES[loss]).T, 0, 1)
    back = np.where(seen <= 0.0031308, 12.92 * seen, 1.055 * seen ** (1 / 2.4) - 0.055)
    lab = cv2.cvtColor(back[None].astype(np.float32), cv2.COLOR_RGB2LAB)[0]
    apart = np.linalg.norm(lab[:, None] - lab[None], axis=2)[np.triu_indices(len(names), 1)]
    assert apart.min() > 15
