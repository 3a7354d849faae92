"""Figures that are still to be computed: those of results that have come since the last time."""

from rona_core.app.dependencies.inputs import CAPTURE
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.overview.figure_kinds import FIGURES
from rona_core.session.document import Session


def pending_figures(session: Session, judged: Session | None) -> frozenset[str]:
    """Return the keys of figures of ``session`` that those of ``judged`` do not tell.

    Args:
        session: The session that is looked at.
        judged: The session whose figures are known, None where none are.
    """
    if judged is session:
        return frozenset()
    return frozenset(
        key
        for key, kind in FIGURES.items()
        if kind.of
        and (part := _part(kind.of, session)) is not None
        and (judged is None or part is not _part(kind.of, judged))
        and stale_reason(kind.of, session) is None
    )


def _part(name: str, session: Session) -> object:
    """Return a result (``"roll"``) or capture (``"capture scan"``) of a session, or None."""
    held = session.captures if name.startswith(CAPTURE) else session.results
    return held.get(name.removeprefix(CAPTURE))
