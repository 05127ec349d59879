"""Tables of numbers in CSV files: signals, roads, recordings, reference results."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import numpy as np
import numpy.typing as npt

from build_fmus.base.checks import one_line

BOOLEANS = {"true": 1.0, "false": 0.0}


@dataclass(frozen=True)
class CsvTable:
    """A header, and lines of cells, separated by commas, semicolons or tabs.

    With semicolons a decimal comma is understood. Lines ahead of the header may be empty or begin with #.

    Attributes:
        path: of the file.
        header: its cells.
        separator: of cells.
        first: number of the line behind the header.
        lines: all lines from there on, without empty ones at the end.
        error: class of the errors.
    """

    path: Path
    header: tuple[str, ...]
    separator: str
    first: int
    lines: tuple[str, ...]
    error: type[ValueError]

    @classmethod
    def read(cls, path: Path, error: type[ValueError], hint: str, separators: str = ";\t,") -> CsvTable:
        """The table of a file; the first of the `separators` that its header contains separates its cells.

        Raises:
            error: the file cannot be read, is no text, or is empty, where the `hint` says what belongs there.
        """
        try:
            lines = path.read_text(encoding="utf-8-sig").split("\n")
        except OSError as reason:
            raise error(f"{path}: cannot be read: {reason.strerror}") from None
        except UnicodeDecodeError:
            raise error(f"{path}: not a text file (UTF-8); {hint}") from None
        while lines and not lines[-1].strip():
            lines.pop()
        head = next((k for k, line in enumerate(lines) if line.strip() and not line.startswith("#")), None)
        if head is None:
            raise error(f"{path}: empty; {hint}")
        separator = next((s for s in separators if s in lines[head]), ",")
        made = cls(path, (), separator, head + 1, tuple(lines[head:]), error)
        header = made.cells(0)
        return cls(path, tuple(header), separator, head + 2, tuple(lines[head + 1 :]), error)

    def refuse(self, row: int, what: str) -> NoReturn:
        """Raise the error about a line, by its place among `lines`."""
        raise self.error(f"{self.path}, line {self.first + row}: {what}")

    def cells(self, row: int) -> list[str]:
        """The cells of a line, without blanks around them."""
        try:
            return [c.strip() for c in next(csv.reader([self.lines[row]], delimiter=self.separator), [])]
        except csv.Error as reason:
            self.refuse(row, f"cannot be read: {reason}")

    def rows(self, gap: str) -> Iterator[list[str]]:
        """The cells of each line, as many as the header has; `gap` says what to do about an empty line."""
        for row in range(len(self.lines)):
            cells = self.cells(row)
            if not any(cells):
                self.refuse(row, f"empty line; {gap}")
            if len(cells) != len(self.header):
                self.refuse(row, f"{len(cells)} values for {len(self.header)} columns ({', '.join(self.header)})")
            yield cells

    def number(self, row: int, column: str, cell: str, gap: str) -> float:
        """The number in a cell, 1 and 0 for true and false; `gap` says what to do about an empty one."""
        if not cell:
            self.refuse(row, f"{column}: no value; {gap}")
        if cell.lower() in BOOLEANS:
            return BOOLEANS[cell.lower()]
        try:
            return float(cell.replace(",", ".") if self.separator == ";" else cell)
        except ValueError:
            self.refuse(row, f"{column} is {one_line(cell, 40)!r}, which is not a number")

    def numbers(self) -> npt.NDArray[np.float64] | None:
        """All lines at once (rows, columns), where they hold nothing but numbers; None where one must be looked at."""
        if not self.lines or self.separator == ";" or not all(line.strip() for line in self.lines):
            return None
        try:
            table = np.loadtxt(io.StringIO("\n".join(self.lines)), delimiter=self.separator, comments=None, ndmin=2)
        except ValueError:
            return None
        return table if table.shape == (len(self.lines), len(self.header)) else None
