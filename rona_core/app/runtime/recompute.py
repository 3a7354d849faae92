"""Compute every result of a session again from its captures, and compare."""

from dataclasses import dataclass, replace

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.staleness import input_digests, stale_reason
from rona_core.app.runtime.deriving import derive_again
from rona_core.app.runtime.process_pool import use_one_thread
from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.errors import CancelledError
from rona_core.session.codec import digest
from rona_core.session.document import Derived, Session


@dataclass(frozen=True, slots=True)
class ReplayedResult:
    """One result, computed again: digests of the stored and of the new value."""

    result: str
    stored: str
    recomputed: str
    same: bool


@dataclass(frozen=True, slots=True)
class Replay:
    """All results that are not stale, computed again from the captures."""

    same: bool
    results: tuple[ReplayedResult, ...]


def recompute(session: Session, progress: Progress = silent, cancel: Cancel = never) -> Session:
    """Return the session with every result computed anew; stale ones are left out.

    Each is computed from what it was computed from, as the session holds it: so a last bit that
    another processor rounds otherwise is told where it arises, and makes nothing stale.

    Raises:
        CancelledError: ``cancel`` said so.
    """
    use_one_thread()
    results = REGISTRY.replayed
    fresh = replace(session, results=type(session.results)())
    held = session
    for name in results:
        if session.results.get(name) is not None and stale_reason(name, session) is not None:
            held = held.with_result(name, None)
    for i, name in enumerate(results):
        if cancel():
            raise CancelledError("the replay was cancelled")
        stored = session.results.get(name)
        if stored is None or stale_reason(name, session) is not None:
            continue

        def within(share: float, i: int = i) -> None:
            progress((i + share) / len(results))

        value = derive_again(name, held, stored, within, cancel)
        made = Derived(
            value, stored.message, stored.arguments, input_digests(name, held, stored.message)
        )
        fresh = replace(fresh, results=fresh.results.with_(name, made))
        within(1.0)
    return fresh


def replay(
    session: Session, progress: Progress = silent, cancel: Cancel = never
) -> tuple[ReplayedResult, ...]:
    """Compute all results that are not stale again and compare them with the stored ones.

    Raises:
        CancelledError: ``cancel`` said so.
    """
    fresh = recompute(session, progress, cancel)
    found: list[ReplayedResult] = []
    for name in REGISTRY.replayed:
        old, new = session.results.get(name), fresh.results.get(name)
        if old is not None and new is not None:
            stored, again = digest(old.value), digest(new.value)
            found.append(ReplayedResult(name, stored, again, stored == again))
    return tuple(found)


def replay_report(session: Session, *, progress: Progress, cancel: Cancel) -> Replay:
    """Return what ``replay`` finds, and whether all of it is the same."""
    rows = replay(session, progress, cancel)
    return Replay(all(row.same for row in rows), rows)
