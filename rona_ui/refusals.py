"""Refusals of the sessions: the newest stands on the page, all are kept for the log."""

import threading
from dataclasses import dataclass, field
from datetime import UTC, datetime

KEPT = 60  # of each session, the newest


@dataclass(frozen=True, slots=True)
class Refusal:
    """One thing that was not done, and why."""

    after: int  # number of the last message in the session's log when it happened
    where: str  # step, or what was going on
    title: str
    body: str  # cause and remedy
    time_utc: str = field(
        default_factory=lambda: datetime.now(UTC).isoformat(timespec="milliseconds")
    )
    explained: bool = False  # the reason stands beside what was refused


class Refusals:
    """Keeps refusals by session as long as the program runs; safe to use from several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._held: dict[str, tuple[Refusal, ...]] = {}
        self._count = 0

    @property
    def count(self) -> int:
        """How many there have been, of all sessions."""
        return self._count

    def add(self, session_id: str, refusal: Refusal) -> None:
        """Keep a refusal."""
        with self._lock:
            held = (*self._held.get(session_id, ()), refusal)
            self._held[session_id] = held[-KEPT:]
            self._count += 1

    def keep_only(self, session_ids: tuple[str, ...]) -> None:
        """Forget the refusals of all other sessions: they are closed."""
        with self._lock:
            self._held = {key: held for key, held in self._held.items() if key in session_ids}

    def of(self, session_id: str) -> tuple[Refusal, ...]:
        """Return what was refused in a session, oldest first; one object until there is more."""
        with self._lock:
            return self._held.get(session_id, ())
