"""The table in a recording's file: what a glove's software writes, as cells.

Each vendor has its own delimiter, preamble and columns; no number is taken from a cell before it is
asked for, so that columns of no interest may hold anything.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from hadr.records.reading import read_bytes
from hadr.synthesis.recordings.glove_columns import (
    ANGLE_COLUMNS,
    POSITION_COLUMNS,
    find_angle_columns,
)


@dataclass(frozen=True)
class Table:
    """The cells of a CSV file.

    Attributes:
        path: The file.
        notes: What its comment lines say, by key.
        header: The columns' names.
        rows: The cells, as text.
        lines: Number of each row's line in the file, from 1.
        decimal_comma: Numbers are written as 1,5.
    """

    path: Path
    notes: Mapping[str, str]
    header: list[str]
    rows: list[list[str]]
    lines: list[int]
    decimal_comma: bool

    def place(self, row: int, columns: str = "") -> str:
        """A row, and perhaps its columns, as errors name them."""
        return f"{self.path.name}: row {row + 1} (line {self.lines[row]}){columns}"

    def number(self, row: int, column: int) -> float:
        """The number in a cell; a ValueError names a cell without one."""
        text = self.rows[row][column].strip()
        try:
            value = float(text.replace(",", ".") if self.decimal_comma else text)
        except ValueError:
            value = float("nan")
        if not np.isfinite(value):
            where = self.place(row, f", column {self.header[column]}")
            raise ValueError(f"{where}: {text!r} is not a finite number")
        return value

    def column(self, position: int) -> npt.NDArray[np.float64]:
        """All numbers of a column."""
        return np.array([self.number(row, position) for row in range(len(self.rows))])

    def find(self, *names: str) -> int | None:
        """Position of the first column that has one of the (bare) names."""
        bare = ["".join(c for c in name.lower() if c.isalnum()) for name in self.header]
        return next((bare.index(name) for name in names if name in bare), None)


def read_table(path: Path) -> Table:
    """Read a recording's table: comma, semicolon or tab, behind a preamble and comment lines.

    Raises:
        ValueError: It is no text, has no header with joint angles, or a row of another length.
    """
    try:
        text = read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path.name} is not text in UTF-8") from error
    notes: dict[str, str] = {}
    lines: list[tuple[int, str]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        if line.lstrip().startswith("#"):
            key, _, value = line.lstrip("# \t").partition(":")
            notes[key.strip().lower()] = value.strip()
        elif line.strip(" ,;\t"):
            lines.append((number, line))
    # The header is the first line with joint angles in it; what stands before is a preamble.
    start = 0
    for start, (_, line) in enumerate(lines):  # noqa: B007
        delimiter = max(",;\t", key=line.count)
        header = _cells(path, line, delimiter)
        try:
            angles = find_angle_columns(header)
        except ValueError as error:
            raise ValueError(f"{path.name}: {error}") from error
        if angles or any(n.strip() in POSITION_COLUMNS for n in header):
            break
    else:
        raise ValueError(f"{path.name} has no header with joint angles, such as {ANGLE_COLUMNS[5]}")
    header = [name.strip() for name in header]
    rows: list[list[str]] = []
    kept: list[int] = []
    for number, line in lines[start + 1 :]:
        cells = _cells(path, line, delimiter)
        if len(cells) > len(header) and not any(c.strip() for c in cells[len(header) :]):
            cells = cells[: len(header)]  # a delimiter at the end of each line
        if len(cells) != len(header):
            raise ValueError(
                f"{path.name}: row {len(rows) + 1} (line {number}) has {len(cells)} cells, the "
                f"header {len(header)}"
            )
        rows.append(cells)
        kept.append(number)
    if not rows:
        raise ValueError(f"{path.name} has a header but no rows")
    return Table(path, notes, header, rows, kept, delimiter == ";")


def _cells(path: Path, line: str, delimiter: str) -> list[str]:
    try:
        return next(csv.reader(io.StringIO(line), delimiter=delimiter))
    except (csv.Error, StopIteration) as error:
        raise ValueError(f"{path.name}: {line!r:.60} is no row of a table: {error}") from error
