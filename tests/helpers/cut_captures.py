"""Captures that were stopped early: what was measured before them was made from whole ones."""

import dataclasses
from typing import Any

import numpy as np

from rona_core.app.declarations.registry import REGISTRY
from rona_core.session.document import Session

SHARE = 0.03  # of the samples that are kept
LONG = 12  # samples: what is shorter has a fixed shape, and stays


def captures_held(session: Session) -> list[str]:
    """Return the names of the captures that a session holds."""
    return [name for name in REGISTRY.captures if session.captures.get(name)]


def with_cut_capture(session: Session, name: str) -> Session:
    """Return the session with one capture stopped after its first samples."""
    held = session.captures.get(name)
    number = max(one.ordinal for one in session.archive) + 1
    if isinstance(held, tuple):
        return session.with_capture(name, (*held[:-1], _stopped(held[-1], number)))
    return session.with_capture(name, _stopped(held, number))


def _stopped(capture: Any, number: int) -> Any:
    return dataclasses.replace(_cut(capture), partial=True, ordinal=number)


def _cut(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        long = value.ndim > 0 and len(value) > LONG
        return value[: max(2, round(SHARE * len(value)))] if long else value
    if isinstance(value, tuple):
        return tuple(map(_cut, value))
    if not dataclasses.is_dataclass(value):
        return value
    parts = {f.name: getattr(value, f.name) for f in dataclasses.fields(value) if f.init}
    return dataclasses.replace(value, **{name: _cut(part) for name, part in parts.items()})
