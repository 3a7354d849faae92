"""What the figures of a picture come to: one verdict for step list, notes and table."""

from typing import Any

from rona_core.app.overview.acceptance import Judgement, QualityRow, judgement, quality_rows
from rona_core.session.document import Session
from rona_ui.panels.widgets import style
from rona_ui.presentation.snapshot import Snapshot

MOST_TOLD = 3  # figures in a note


class _Latest:
    """The rows of the last picture: every panel of every browser asks for the same ones."""

    key: tuple[dict[str, Any], Session] | None = None
    rows: tuple[QualityRow, ...] = ()


def rows_of(snapshot: Snapshot) -> tuple[QualityRow, ...]:
    """Return the figures of a picture with their verdicts."""
    key = (snapshot.figures, snapshot.session)
    held = _Latest.key
    if held is None or held[0] is not key[0] or held[1] is not key[1]:
        _Latest.rows = quality_rows(snapshot.figures, snapshot.session)
        _Latest.key = key
    return _Latest.rows


def judged(snapshot: Snapshot, step: str) -> Judgement:
    """Return what the figures of a step come to."""
    return judgement(rows_of(snapshot), step)


def missed_note(found: Judgement) -> str:
    """Return the figures that do not pass as a note, the worst first; empty where all do."""
    if not found.missed:
        return ""
    icon, word, _ = style.VERDICTS[found.verdict]
    told = [row.sentence for row in found.missed[:MOST_TOLD]]
    more = len(found.missed) - MOST_TOLD
    told += [f"and {more} more, see Quality"] if more > 0 else []
    return style.note(f"{icon} {word}. {'. '.join(told)}.", "warn")
