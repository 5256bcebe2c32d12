"""What the benchmarks measured is shown with its unit, and what is missing is said."""

from hadr.figures.tables.benchmarks import by_heart_table, draw_ablation


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
    assert own[5] == "the true voxel of 1.5 % of its rays is no candidate; on the others 0.06 mm"
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
