"""Reader of numeric tables in text files, with line numbers for messages."""

import re
from dataclasses import dataclass

import numpy as np

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats

DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?|[+-]?\d+,\d*")


@dataclass(frozen=True, slots=True, eq=False)
class NamedFile:
    """Contents of a file and its name, for messages."""

    name: str
    data: bytes


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Cells row by row, of a text file without its empty lines and comments or of an array."""

    name: str
    header: tuple[str, ...] | None  # lower-case names of the columns, where there are any
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...] = ()  # of each row, from 1; none: rows are counted

    def where(self, row: int) -> str:
        """Return the place of a row, for messages."""
        place = f"line {self.lines[row]}" if self.lines else f"row {row}"
        return f"{self.name}, {place}"

    def numbers(self, width: int) -> Floats:
        """Return all cells as numbers (n, width), NaN and infinity included.

        Raises:
            InvalidInputError: a row with more or fewer cells, or a cell that is no number.
        """
        values = np.zeros((len(self.rows), width))
        for i, row in enumerate(self.rows):
            if len(row) != width:
                raise InvalidInputError(
                    f"{self.where(i)}: expected {width} numbers, got {len(row)}"
                )
            try:
                values[i] = [float(cell) for cell in row]
            except ValueError:
                bad = next(cell for cell in row if not is_number(cell))
                raise InvalidInputError(
                    f"{self.where(i)}: expected a number, got {bad[:40]!r}"
                ) from None
        return values


def is_number(cell: str) -> bool:
    """Return whether a cell is a number, NaN and infinity included."""
    try:
        float(cell)
    except ValueError:
        return False
    return True


def read_table(file: NamedFile) -> Table:
    """Read a text file whose cells are separated by commas, semicolons, tabs or spaces.

    Cells between semicolons, tabs or spaces may have a decimal comma. The first row is a header if
    none of its cells is a number; so is a comment (#, %) before it with a word for each cell. The
    text is UTF-8, or UTF-16 as some programs export it.

    Raises:
        InvalidInputError: not text, or nothing in it.
    """
    text = _text(file)
    text = text.replace('"', "")  # around names and numbers, of spreadsheets
    rows: list[tuple[str, ...]] = []
    lines: list[int] = []
    separator: str | None = None
    comment = ""
    for number, line in enumerate(text.splitlines(), start=1):
        stripped = line.strip()
        if not stripped or stripped.startswith(("#", "%")):
            comment = stripped.lstrip("#% ") if not rows else comment
            continue
        if len(rows) < 2:  # the header says less than the first numbers
            separator = _separator(stripped)
        if separator is None:
            cells = tuple(stripped.split())
        else:
            # a tab at the end of a line is an empty cell, so only line ends are taken off
            cells = tuple(cell.strip() for cell in line.strip("\r\n").split(separator))
        if separator != ",":
            cells = tuple(map(_with_point, cells))
        rows.append(_without_last(cells))
        lines.append(number)
    if not rows:
        raise InvalidInputError(f"{file.name} is empty: expected rows of numbers")
    if not any(is_number(cell) for cell in rows[0]):
        header = tuple(cell.lower() for cell in rows.pop(0))
        lines.pop(0)
    else:
        words = tuple(word.strip().lower() for word in comment.split(separator))
        header = words if len(words) == len(rows[0]) and not any(map(is_number, words)) else None
    return Table(file.name, header, tuple(rows), tuple(lines))


def _text(file: NamedFile) -> str:
    """Return the text of a file.

    Raises:
        InvalidInputError: it has none.
    """
    wide = file.data[:2] in (b"\xff\xfe", b"\xfe\xff")
    try:
        text = file.data.decode("utf-16" if wide else "utf-8-sig")
    except UnicodeDecodeError as error:
        raise InvalidInputError(
            f"{file.name}: expected text, got bytes that are none ({error.reason} at byte "
            f"{error.start}): save it as UTF-8"
        ) from error
    if "\0" in text:
        raise InvalidInputError(f"{file.name}: expected text, got a binary file")
    return text


def _separator(line: str) -> str | None:
    """Return what stands between the cells of a line; None for spaces."""
    if ";" in line:
        return ";"
    cells = line.split()
    # commas are decimal where they stand inside of all numbers, and something else between these
    decimal = len(cells) > 1 and all(re.fullmatch(r"[^,]*\d,\d[^,]*|[^,]*", c) for c in cells)
    if "," in line and not decimal:
        return ","
    if "\t" in line and not any(" " in cell.strip() for cell in line.split("\t")):
        return "\t"
    return None  # spaces, or tabs and spaces mixed


def _with_point(cell: str) -> str:
    return cell.replace(",", ".") if DECIMAL_COMMA.fullmatch(cell) else cell


def _without_last(cells: tuple[str, ...]) -> tuple[str, ...]:
    """Drop one empty cell at the end of a row of a matrix: some programs end rows with a comma."""
    matrix = len(cells) == 17 or (len(cells) == 5 and all(map(is_number, cells[:4])))
    return cells[:-1] if matrix and cells[-1] == "" else cells
