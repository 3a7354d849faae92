"""Verdicts of the figures: one verdict for step list, notes and table."""

from rona_core.app.overview.acceptance import Judgement, QualityRow, judgement, quality_rows
from rona_core.session.memo import Memo
from rona_ui.panels.widgets import style
from rona_ui.presentation.snapshot import Snapshot

MAX_LISTED = 3  # figures in a note


# every panel of every browser asks for the same ones
_ROWS: Memo[tuple[QualityRow, ...]] = Memo(1)


def rows_of(snapshot: Snapshot) -> tuple[QualityRow, ...]:
    """Return the figures of a picture with their verdicts."""
    figures, session = snapshot.figures, snapshot.session
    return _ROWS.get((figures, session), lambda: quality_rows(figures, session))


def judged(snapshot: Snapshot, step: str) -> Judgement:
    """Return the verdict of the figures of a step."""
    return judgement(rows_of(snapshot), step)


def missed_note(found: Judgement) -> str:
    """Return the figures that do not pass as a note, the worst first; empty where all do."""
    if not found.missed:
        return ""
    icon, word, _ = style.VERDICTS[found.verdict]
    lines = [row.sentence for row in found.missed[:MAX_LISTED]]
    more = len(found.missed) - MAX_LISTED
    lines += [f"and {more} more, see Quality"] if more > 0 else []
    return style.note(f"{icon} {word}. {'. '.join(lines)}.", "warn")
