"""What the figures of a picture come to: one verdict for step list, notes and table."""

from rona_core.app.overview.acceptance import Judgement, QualityRow, judgement, quality_rows
from rona_core.session.memo import Memo
from rona_ui.panels.widgets import style
from rona_ui.view_state import Picture

MOST_TOLD = 3  # figures in a note


# every panel of every browser asks for the same ones
_ROWS: Memo[tuple[QualityRow, ...]] = Memo(1)


def rows_of(picture: Picture) -> tuple[QualityRow, ...]:
    """Return the figures of a picture with their verdicts."""
    figures, session = picture.figures, picture.session
    return _ROWS.get((figures, session), lambda: quality_rows(figures, session))


def judged(picture: Picture, step: str) -> Judgement:
    """Return what the figures of a step come to."""
    return judgement(rows_of(picture), step)


def missed_note(found: Judgement) -> str:
    """Return the figures that do not pass as a note, the worst first; empty where all do."""
    if not found.missed:
        return ""
    icon, word, _ = style.VERDICTS[found.verdict]
    told = [row.sentence for row in found.missed[:MOST_TOLD]]
    more = len(found.missed) - MOST_TOLD
    told += [f"and {more} more, see Quality"] if more > 0 else []
    return style.note(f"{icon} {word}. {'. '.join(told)}.", "warn")
