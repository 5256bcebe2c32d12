"""Markdown tables: the sides of columns, and rows that don't fit."""

import pytest

from hadr.records.markdown import markdown_table


def test_the_last_side_counts_for_all_columns_that_follow() -> None:
    lines = markdown_table(["method", "RMSE", "MAE"], [["hadr", "1.2", "0.9"]]).splitlines()
    assert lines == ["| method | RMSE | MAE |", "|:--|--:|--:|", "| hadr | 1.2 | 0.9 |"]


def test_each_column_can_have_its_side() -> None:
    assert markdown_table(["a", "b", "c"], [], "lrl").splitlines()[1] == "|:--|--:|:--|"


@pytest.mark.parametrize("cells", [["one"], ["one", "two", "three"]])
def test_a_row_with_another_number_of_cells_is_refused(cells: list[str]) -> None:
    with pytest.raises(ValueError, match=f"2 columns has {len(cells)} cells"):
        markdown_table(["a", "b"], [cells])
