"""Compute every result of a session again from its captures, and compare."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from rona_core.app.dependencies.staleness import RESULTS, input_digests, stale_reason
from rona_core.app.derive import SHORT
from rona_core.app.messages.serialization import message_from
from rona_core.app.runtime.process_pool import use_one_thread
from rona_core.app.steps.handheld.derivation import derive_sono_detection, derive_sono_maps
from rona_core.app.steps.maps.derivation import (
    derive_chosen_roll,
    derive_detection,
    derive_maps,
    derive_roll,
    derive_second,
    derive_second_detection,
)
from rona_core.app.steps.roll.base_placement import derive_placement
from rona_core.app.steps.surface.skull_registration import derive_registration
from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.errors import CancelledError
from rona_core.session.codec import digest
from rona_core.session.compare import Difference, compare
from rona_core.session.document import Derived, Session


@dataclass(frozen=True, slots=True)
class Replayed:
    """One result, computed again."""

    result: str
    stored: str  # digest
    recomputed: str  # digest
    difference: Difference

    @property
    def same(self) -> bool:
        """Whether every bit agrees."""
        return self.stored == self.recomputed


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


LONG: dict[str, Callable[..., Any]] = {  # what tells its progress and can be cancelled
    "placement": derive_placement,
    "registration": derive_registration,
    "detection": derive_detection,
    "second": derive_second,
    "second_detection": derive_second_detection,
    "sono_detection": derive_sono_detection,
    "sono_maps": derive_sono_maps,
    "maps": derive_maps,
}


def recompute(session: Session, progress: Progress = silent, cancel: Cancel = never) -> Session:
    """Return the session with every result computed anew; stale ones are left out.

    Each is computed from what it was computed from, as the session holds it: so a last bit that
    another processor rounds otherwise is told where it arises, and makes nothing stale.

    Raises:
        CancelledError: ``cancel`` said so.
    """
    use_one_thread()
    fresh = replace(session, results=type(session.results)())
    held = session
    for name in RESULTS:
        if getattr(session.results, name) is not None and stale_reason(name, session) is not None:
            held = replace(held, results=replace(held.results, **{name: None}))
    for i, name in enumerate(RESULTS):
        if cancel():
            raise CancelledError("the replay was cancelled")
        stored = getattr(session.results, name)
        if stored is None or stale_reason(name, session) is not None:
            continue

        def within(share: float, i: int = i) -> None:
            progress((i + share) / len(RESULTS))

        value = _value(name, held, stored, within, cancel)
        made = Derived(
            value, stored.message, stored.arguments, input_digests(name, held, stored.message)
        )
        fresh = replace(fresh, results=replace(fresh.results, **{name: made}))
        within(1.0)
    return fresh


def _value(
    name: str, session: Session, stored: Derived[Any], progress: Progress, cancel: Cancel
) -> Any:
    arguments = dict(stored.arguments)
    chosen, branch = arguments.pop("chosen", None), arguments.pop("branch", None)
    message = message_from(stored.message, arguments)
    if name == "roll":
        plan = derive_roll(session, message, progress=progress, cancel=cancel)
        if not isinstance(chosen, int):
            return plan
        return derive_chosen_roll(
            session, plan, chosen, branch if isinstance(branch, int) else None
        )
    if name in LONG:
        return LONG[name](session, message, progress=progress, cancel=cancel)
    return SHORT[type(message)][1](session, message)


def replay(
    session: Session, progress: Progress = silent, cancel: Cancel = never
) -> tuple[Replayed, ...]:
    """Compute all results that are not stale again and compare them with the stored ones.

    Raises:
        CancelledError: ``cancel`` said so.
    """
    fresh = recompute(session, progress, cancel)
    return tuple(
        Replayed(name, digest(old.value), digest(new.value), compare(old.value, new.value))
        for name in RESULTS
        if (old := getattr(session.results, name)) is not None
        and (new := getattr(fresh.results, name)) is not None
    )


def replay_report(session: Session, *, progress: Progress, cancel: Cancel) -> Replay:
    """Return in plain values what ``replay`` finds; picklable, so that it can run elsewhere."""
    rows = tuple(
        ReplayedResult(row.result, row.stored, row.recomputed, row.same)
        for row in replay(session, progress, cancel)
    )
    return Replay(all(row.same for row in rows), rows)
