"""What several commands print: a report as JSON or as a table, and a verdict with its reasons."""

import json
import sys
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

COLOURS = {"good": "green", "weak": "yellow", "bad": "red"}
FIGURES = ("figure", "value", "unit")


def show(report: Any, draw: Callable[[Any], None], *, as_json: bool) -> None:
    """Print the figures of a report as one JSON object, or draw it."""
    if as_json:
        sys.stdout.write(json.dumps(report.figures(), allow_nan=False) + "\n")
    else:
        draw(report)


def table_of(
    title: str,
    rows: Iterable[Sequence[str | Text]],
    columns: Sequence[str] = FIGURES,
    right: Sequence[str] = ("value",),
) -> Table:
    """Return a table; the columns that ``right`` names hold numbers."""
    table = Table(title=title, title_justify="left", pad_edge=False)
    for column in columns:
        table.add_column(column, justify="right" if column in right else "left")
    for row in rows:
        table.add_row(*row)
    return table


def print_judged(table: Table, found: Any, notes: Iterable[str]) -> None:
    """Print a table with the verdict of a calibration, then notes and reasons."""
    table.add_row("Verdict", Text(found.verdict, COLOURS[found.verdict]), "")
    console = Console()
    console.print(table)
    for note in notes:
        console.print(note, highlight=False, soft_wrap=True)
    for reason in found.reasons:
        console.print(Text(f"{found.verdict}: {reason}", COLOURS[found.verdict]), soft_wrap=True)


def number(value: float | None, decimals: int = 3) -> str:
    """Return a figure as it is shown, a dash where there is none."""
    return "-" if value is None else f"{value:.{decimals}f}"
