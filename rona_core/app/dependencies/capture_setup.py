"""Set-up digests of captures: which part of the set-up each kind of capture depends on."""

from collections.abc import Callable

from rona_core.app.declarations.registry import REGISTRY
from rona_core.session.codec import digest
from rona_core.session.document import Session

Part = Callable[[Session], list[object]]


def capture_setup_digest(kind: str, session: Session) -> str:
    """Return a digest of the part of the set-up that a capture of this kind depends on."""
    return _digest(REGISTRY.captures[kind].setup, session)


def known_setup_digests(kind: str, session: Session) -> tuple[str, ...]:
    """Return the digests under which a capture of this kind counts as taken with this set-up.

    Beside the present one it is that of older files, which depended on more.
    """
    declared = REGISTRY.captures[kind]
    rules = (declared.setup, declared.earlier_setup)
    return tuple(_digest(parts, session) for parts in rules if parts is not None)


def _digest(parts: tuple[Part, ...], session: Session) -> str:
    seen: list[object] = [session.setup.seed]
    return digest(seen + [value for part in parts for value in part(session)])
