"""Tables in Markdown, as the book and the reports print them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]], align: str = "lr") -> str:
    """Write a table in Markdown.

    Args:
        head: Titles of the columns.
        rows: The cells, as many in each row as there are titles.
        align: "l" or "r" for each column; the last counts for all that follow.

    Returns:
        The lines, without a line break at the end.

    Raises:
        ValueError: A row has more or fewer cells than there are titles.
    """
    sides = [align[min(column, len(align) - 1)] for column in range(len(head))]
    lines = [_line(head), "|" + "|".join(":--" if side == "l" else "--:" for side in sides) + "|"]
    for row in rows:
        if len(row) != len(head):
            raise ValueError(f"a row of {len(head)} columns has {len(row)} cells: {list(row)}")
        lines.append(_line(row))
    return "\n".join(lines)


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"
