"""What the benchmarks measured is shown with its unit, and what is missing is said."""

import re

from hadr.figures.tables.benchmarks import (
    by_heart_table,
    draw_ablation,
    speed_table,
)


def timed(ms: float) -> dict[str, float]:
    return {"wall_median_ms": ms, "cpu_median_ms": 2 * ms}


RESTORATION = {
    "times": {
        "Swin-T": timed(100.0),
        **{f"{size}, {form}": timed(ms) for size, form, ms in (
            ("mini", "all rays", 40.0), ("paper", "all rays", 160.0),
            ("mini", "half the rays", 20.0), ("paper", "half the rays", 130.0),
            ("mini", "ONNX", 10.0), ("paper", "ONNX", 90.0))},
    },
    "against_swin": {"wall_median_ms": {"paper, all rays": 1.6, "paper, half the rays": 1.3,
                                        "paper, ONNX": 0.9}},
    "accuracy": {"change_percent": {"all rays": 0.0, "half the rays": -0.5, "ONNX": 1.25}},
    "parts_cpu_ms": {"mini": {"backbone": 30.0, "decoders": 40.0, "all": 70.0},
                     "paper": {"backbone": 200.0, "decoders": 100.0, "all": 300.0}},
}  # fmt: skip
PERCEPTION = {"frames_per_second": {"as it is": {"wall_median": 8.04},
                                    "half the rays": {"wall_median": 12.0}}}  # fmt: skip


def test_each_form_has_its_own_line() -> None:
    lines = [re.sub(" +", " ", line) for line in speed_table(RESTORATION, PERCEPTION).splitlines()]
    assert lines[2:] == [
        "| *plain Swin-T* | - | 100 | 1.00 | - | - |",
        "| all rays | 40 | 160 | 1.60 | - | 8.0 |",
        "| half the rays | 20 | 130 | 1.30 | -0.5 % | 12.0 |",
        "| ONNX | 10 | 90 | 0.90 | +1.2 % | - |",
    ]
    assert len({line.count("|") for line in lines}) == 1


def test_metres_and_overlap_in_the_units_a_reader_knows() -> None:
    rows = [
        {"network": "hadr", "steps": 600, "counts": "validation_mae_m", "reached": 0.0031,
         "goal": 0.002, "is_reached": False, "share_with_true_voxel": 0.985,
         "mae_where_true_voxel_m": 0.00006},
        {"network": "swindrnet", "steps": 2000, "frozen_steps": 600, "goal": 0.002,
         "counts": "validation_mae_m", "reached": 0.005, "is_reached": False,
         "least_mae_of_its_grid_m": 0.0042},
        {"network": "segmentation", "steps": 600, "counts": "validation_iou_missing",
         "reached": 0.004, "goal": 0.02, "is_reached": True},
    ]  # fmt: skip
    lines = by_heart_table(rows).splitlines()
    own, grid, masks = ([c.strip() for c in line.strip("|").split("|")] for line in lines[2:])
    assert own[:5] == ["hadr", "600", "3.1 mm", "2.0 mm", "**no**"]
    assert own[5] == "98.5 % of its rays, those whose true voxel is a candidate: 0.06 mm"
    assert grid[1:3] == ["2600", "5.0 mm"]
    assert grid[5] == "an image of a quarter of the size, enlarged: no less than 4.2 mm"
    assert masks == ["segmentation", "600", "0.996 IoU", "0.980 IoU", "yes", ""]


def test_an_ablation_is_drawn_against_the_full_network(ax) -> None:
    against = {"mean_difference_m": 0.004, "standard_error_m": 0.001}
    rows = [
        {"network": "full", "rmse_m": 0.02, "against_full": None},
        {"network": "no plane", "against_full": against},
        {"network": "no colour", "against_full": {**against, "mean_difference_m": -0.001}},
    ]
    draw_ablation(ax, rows)
    assert [t.get_text() for t in ax.get_yticklabels()] == ["no plane", "no colour"]
    assert [t.get_text() for t in ax.texts] == ["+0.40", "-0.10"]
    assert "2.00 cm" in ax.get_xlabel()
