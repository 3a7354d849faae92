"""``make metrics``: write the tables of docs/metrics.md from the declared figures.

A table stands between ``<!-- table: NAME -->`` and ``<!-- end -->``.
"""

import re
import sys
from collections.abc import Iterable
from pathlib import Path

from benchmarks.metric import row
from rona_core.app.declarations.figures import SECTIONS, Figure

PAGE = Path(__file__).resolve().parents[1] / "docs" / "metrics.md"
TABLE = re.compile(r"(<!-- table: (.+?) -->\n).*?(<!-- end -->)", re.DOTALL)
LIMITS = "Limits"


def figure_table(figures: Iterable[Figure]) -> str:
    """Return figures with name, unit, limit and meaning, a line each."""
    lines = [row("key", "name", "unit", "limit", "paper", "meaning"), row(*["---"] * 6)]
    for one in figures:
        paper = "" if one.paper is None else f"{one.paper:g}"
        lines.append(row(f"`{one.key}`", one.title, one.unit, _limit(one), paper, one.says))
    return "\n".join(lines)


def limit_table() -> str:
    """Return every limit and where it comes from."""
    lines = [row("figure", "limit", "where it comes from"), row(*["---"] * 3)]
    for one in (figure for part in SECTIONS.values() for figure in part):
        if one.limit is not None:
            words = f"{_limit(one)} {one.unit}".rstrip()
            lines.append(row(f"`{one.key}`", words, one.source))
    return "\n".join(lines)


def _limit(figure: Figure) -> str:
    sign = "≤" if figure.sense == "at most" else "≥"
    return "" if figure.limit is None else f"{sign} {figure.limit:g}"


def with_tables(page: str) -> str:
    """Return the page with its tables as the figures are declared now.

    Raises:
        KeyError: the page names a table that there is not.
    """

    def write(found: re.Match[str]) -> str:
        name = found[2]
        table = limit_table() if name == LIMITS else figure_table(SECTIONS[name])
        return f"{found[1]}\n{table}\n\n{found[3]}"

    return TABLE.sub(write, page)


def main() -> int:
    """Write the page."""
    PAGE.write_text(with_tables(PAGE.read_text("utf-8")), "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
