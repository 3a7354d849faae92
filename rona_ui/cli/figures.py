"""``rona figures``: the paper's figures, drawn from a session."""

import sys
from pathlib import Path
from typing import Any

from rona_core.app.paper_figures.style import FORMATS
from rona_core.app.paper_figures.table import (
    PAPER_FIGURES,
    drawn_figure,
    figure_named,
)
from rona_core.errors import StepBlockedError, storing
from rona_core.session.files import load_session

NOTHING_DRAWN = 3


def run(wanted: Any) -> int:
    """Write the figures that the session has what they need for, and say what others lack."""
    figures = [figure_named(name) for name in wanted.only or PAPER_FIGURES]
    session = load_session(wanted.file)
    out: Path = wanted.out or wanted.file.with_name(f"{wanted.file.stem}_figures")
    status = NOTHING_DRAWN
    for figure in figures:
        for form in (wanted.format,) if wanted.format else FORMATS:
            try:
                data = drawn_figure(session, figure.name, form)
            except StepBlockedError as error:
                sys.stdout.write(f"{error}\n")
                break
            path, status = out / figure.file_name(form), 0
            with storing(path):
                out.mkdir(parents=True, exist_ok=True)
                path.write_bytes(data)
            sys.stdout.write(f"{path}  {len(data) / 1024:.0f} kB\n")
    return status
