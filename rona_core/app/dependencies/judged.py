"""Calibrations by their verdict: whether one is used, and what people read of it."""

from dataclasses import dataclass
from typing import TypeVar

from rona_core.app.dependencies.staleness import stale_reason
from rona_core.session.document import Derived, Session

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Judged:
    """One line about a result, and whether it is good, weak, bad or stale."""

    sentence: str
    verdict: str


def usable(name: str, made: Derived[T] | None, session: Session) -> T | None:
    """Return a result that has a verdict, unless there is none, or it is stale or bad."""
    value: T | None = None if made is None else made.value
    bad = getattr(value, "verdict", None) == "bad"
    return None if bad or stale_reason(name, session) else value
