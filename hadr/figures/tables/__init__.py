"""Results as tables and plots."""

import pandas as pd


def markdown(table: pd.DataFrame, align: str = "lr") -> str:
    """A table of cells as Markdown; `align` has a letter a column, the last one for all others."""
    sides = [{"l": "left", "r": "right"}[side] for side in align.ljust(table.shape[1], align[-1])]
    return str(table.to_markdown(index=False, disable_numparse=True, colalign=sides))
