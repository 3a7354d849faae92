"""Outcomes: what activities produce. No route leads here, so nobody can post a forged result."""

from collections.abc import Mapping
from dataclasses import dataclass

from rona_core.session.captures import Capture
from rona_core.session.specimen import LoadedSkull


@dataclass(frozen=True, slots=True, eq=False)
class StoreSkull:
    """A skull was read from a file."""

    skull: LoadedSkull


@dataclass(frozen=True, slots=True, eq=False)
class StoreCapture:
    """Something was recorded; it replaces what was recorded before, or is added to it."""

    kind: str  # the name of the capture, as its step declares it
    capture: Capture
    append: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class StoreResult:
    """Something was computed: one result or several, each may depend on those before."""

    message: str  # name of the activity that asked for it
    values: Mapping[str, object | None]  # result -> value; None: there is none
    arguments: dict[str, object]  # of that activity
    inputs: Mapping[str, dict[str, str]]  # result -> digests of what it was computed from


@dataclass(frozen=True, slots=True)
class Answer:
    """What an activity found, for who asked; the session does not hold it."""

    value: object
