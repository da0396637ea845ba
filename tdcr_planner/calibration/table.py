"""Tables of measured numbers: reading a CSV file with a header, and naming the line and column of what is wrong."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tdcr_planner.arrays import FloatArray
from tdcr_planner.errors import FormatError
from tdcr_planner.files import read_text

MOST_ROWS = 1_000_000


@dataclass(frozen=True)
class MeasuredTable:
    """A CSV file as text.

    Attributes:
        path: The file.
        header: Names of the columns.
        lines: Line of each row in the file.
        rows: The fields of each row.
    """

    path: Path
    header: tuple[str, ...]
    lines: tuple[int, ...]
    rows: tuple[tuple[str, ...], ...]

    def place(self, row: int, name: str = "") -> str:
        """Returns how messages name a row, counted from 0, and a column."""
        return f"line {self.lines[row]}, {name}" if name else f"line {self.lines[row]}"

    def texts(self, name: str) -> list[str]:
        """Returns the fields of a column."""
        column = self.header.index(name)
        return [row[column].strip() for row in self.rows]

    def numbers(self, names: list[str], *, may_be_empty: bool = False) -> FloatArray:
        """Returns columns as numbers, shape (n, names), NaN where a field is empty.

        Raises:
            FormatError: A field is no finite number, or is empty and must not be.
        """
        columns = [self.header.index(name) for name in names]
        values = np.empty((len(self.rows), len(names)))
        for index, row in enumerate(self.rows):
            for place, column in enumerate(columns):
                values[index, place] = self._parse(index, names[place], row[column], may_be_empty)
        return values

    def _parse(self, row: int, name: str, text: str, may_be_empty: bool) -> float:
        if not text.strip():
            if may_be_empty:
                return float("nan")
            raise FormatError(self.path, "is empty, expected a number", self.place(row, name))
        try:
            value = float(text)
        except ValueError as error:
            raise FormatError(self.path, f"expected a number, got {text!r}", self.place(row, name)) from error
        if not np.isfinite(value):
            raise FormatError(self.path, f"expected a finite number, got {text.strip()}", self.place(row, name))
        return value


def read_table(path: str | Path) -> MeasuredTable:
    """Returns the table in a CSV file.

    Raises:
        FormatError: It is no CSV file with a header and rows of as many fields, or a column appears twice.
    """
    try:
        table = list(csv.reader(read_text(path).split("\n"), strict=True))
    except csv.Error as error:
        raise FormatError(path, f"is not valid CSV: {error}") from error
    if len(table) > MOST_ROWS:
        raise FormatError(path, f"expected at most {MOST_ROWS:,} rows, got {len(table):,}: no bench measures so many")
    if not any(table[1:]):
        raise FormatError(path, "expected a header and at least one row of measured values")
    header = [name.strip() for name in table[0]]
    if len(header) == 1 and ";" in header[0]:
        raise FormatError(path, "expected fields separated by commas, got semicolons")
    lines, rows = [], []
    for line, row in enumerate(table[1:], start=2):
        if not row:
            continue
        if len(row) != len(header):
            raise FormatError(path, f"expected {len(header)} fields as in the header, got {len(row)}", f"line {line}")
        lines.append(line)
        rows.append(tuple(row))
    if len(set(header)) != len(header):
        doubled = next(name for name in header if header.count(name) > 1)
        raise FormatError(path, "column appears more than once", doubled)
    return MeasuredTable(Path(path), tuple(header), tuple(lines), tuple(rows))


def axes_of(pattern: str) -> list[str]:
    """Returns the three columns of a vector: "tip_{}_m" to tip_x_m, tip_y_m, tip_z_m."""
    return [pattern.format(axis) for axis in "xyz"]
