"""What every session can do, whatever its steps: rename, undo, redo, replay."""

from dataclasses import dataclass, replace

from rona_core import __version__
from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.changes import done
from rona_core.app.dependencies.staleness import input_digests, stale_reason
from rona_core.app.messages.message import Answer, message
from rona_core.app.runtime.handling import derive_again
from rona_core.app.runtime.process_pool import use_one_thread
from rona_core.devices.limits import limited
from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.errors import CancelledError
from rona_core.session.codec import digest
from rona_core.session.document import TITLE, Derived, Session


@dataclass(frozen=True, slots=True)
class ReplayedResult:
    """One result, computed again: digests of the stored and of the new value."""

    result: str
    stored: str
    recomputed: str
    same: bool
    version: str  # of the program that made the stored one
    difference: str | None  # where it comes from, as far as the versions show; None: it is the same

    @property
    def by_version(self) -> bool:
        """Whether it differs, and another version of the program made it."""
        return not self.same and self.version != __version__


@dataclass(frozen=True, slots=True)
class Replay:
    """All results that are not stale, computed again from the captures."""

    same: bool
    version: str  # of the program that computed them again
    by_version: tuple[str, ...]  # results that differ and that another version made
    results: tuple[ReplayedResult, ...]


def recompute(session: Session, progress: Progress = silent, cancel: Cancel = never) -> Session:
    """Return the session with every result computed anew; stale ones are left out.

    Each is computed from what it was computed from, as the session holds it: so a last bit that
    another processor rounds otherwise is reported where it arises, and makes nothing stale.

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
            same = stored == again
            words = None if same else _difference(name, old.version)
            found.append(ReplayedResult(name, stored, again, same, old.version, words))
    return tuple(found)


def _difference(name: str, version: str) -> str:
    """Return what is known of why a result comes out otherwise, and what to do."""
    if version != __version__:
        made = f"RONA {version}" if version else "an unknown version of RONA"
        return (
            f"{done(name)} by {made}, and RONA {__version__} finds another value: do it again to "
            "have all results of one version"
        )
    return (
        f"{done(name)} by RONA {__version__}, which now finds another value: another processor "
        "may round its last bits otherwise; else report it"
    )


def replay_report(session: Session, *, progress: Progress, cancel: Cancel) -> Replay:
    """Return what ``replay`` finds, and whether all of it is the same."""
    rows = replay(session, progress, cancel)
    others = tuple(row.result for row in rows if row.by_version)
    return Replay(all(row.same for row in rows), __version__, others, rows)


@message
class RenameSession:
    """Give the session another name."""

    name: str = limited(**TITLE)


@message
class Undo:
    """Take the last change back."""


@message
class Redo:
    """Do again what was taken back."""


@message
class StartReplay:
    """Compute every result again from the captures and compare; the session stays as it is.

    Results that are stale are left out. What was found is the `result` of the job.
    """


SESSION = declare.Step(
    "session",
    commands=(
        declare.Command(
            RenameSession,
            lambda m, s: replace(s, name=m.name.strip()),
            done="the session was renamed",
        ),
        declare.Command(Undo, done="the last change was undone"),
        declare.Command(Redo, done="the change was done again"),
    ),
    activities=(
        declare.Activity(
            StartReplay,
            lambda m, s, context: (Answer(context.run(replay_report, s)),),
            "Computing all results again",
        ),
    ),
)
