"""Compute every result of a session again from its captures, and compare."""

from dataclasses import dataclass, replace
from typing import Any

from rona_core.app.derive import SHORT
from rona_core.app.derive_placement import derive_placement
from rona_core.app.derive_scan import (
    derive_chosen_roll,
    derive_detection,
    derive_maps,
    derive_roll,
    derive_second,
    derive_second_detection,
)
from rona_core.app.derive_skull import derive_registration
from rona_core.app.derive_sono import derive_sono_detection, derive_sono_maps
from rona_core.app.plain import message_from
from rona_core.app.staleness import RESULTS, input_digests, stale_reason
from rona_core.app.threads import use_one_thread
from rona_core.devices.protocols import Progress, silent
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


def recompute(session: Session, progress: Progress = silent) -> Session:
    """Return the session with every result computed anew; stale ones are left out.

    Each is computed from what it was computed from, as the session holds it: so a last bit that
    another processor rounds otherwise is told where it arises, and makes nothing stale.
    """
    use_one_thread()
    fresh = replace(session, results=type(session.results)())
    held = session
    for name in RESULTS:
        if getattr(session.results, name) is not None and stale_reason(name, session) is not None:
            held = replace(held, results=replace(held.results, **{name: None}))
    for i, name in enumerate(RESULTS):
        stored = getattr(session.results, name)
        if stored is None or stale_reason(name, session) is not None:
            continue
        value = _value(name, held, stored)
        inputs = input_digests(name, held, stored.message)
        made = Derived(value, stored.message, stored.arguments, inputs)
        fresh = replace(fresh, results=replace(fresh.results, **{name: made}))
        progress((i + 1) / len(RESULTS))
    return fresh


def _value(name: str, session: Session, stored: Derived[Any]) -> Any:
    arguments = dict(stored.arguments)
    chosen, branch = arguments.pop("chosen", None), arguments.pop("branch", None)
    message = message_from(stored.message, arguments)
    if name == "roll":
        plan = derive_roll(session, message)
        if not isinstance(chosen, int):
            return plan
        return derive_chosen_roll(
            session, plan, chosen, branch if isinstance(branch, int) else None
        )
    if name == "placement":
        return derive_placement(session, message)
    if name == "registration":
        return derive_registration(session, message)
    if name == "detection":
        return derive_detection(session, message)
    if name == "second":
        return derive_second(session, message)
    if name == "second_detection":
        return derive_second_detection(session, message)
    if name == "sono_detection":
        return derive_sono_detection(session, message)
    if name == "sono_maps":
        return derive_sono_maps(session, message)
    if name == "maps":
        return derive_maps(session, message)
    return SHORT[type(message)][1](session, message)


def replay(session: Session, progress: Progress = silent) -> tuple[Replayed, ...]:
    """Compute all results that are not stale again and compare them with the stored ones."""
    fresh = recompute(session, progress)
    return tuple(
        Replayed(name, digest(old.value), digest(new.value), compare(old.value, new.value))
        for name in RESULTS
        if (old := getattr(session.results, name)) is not None
        and (new := getattr(fresh.results, name)) is not None
    )
