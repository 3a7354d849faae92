"""Inputs of results and messages, by the name of the result or capture that they are."""

from typing import TypeVar

from rona_core.app.declarations.declarations import Input
from rona_core.app.declarations.registry import REGISTRY
from rona_core.errors import StepBlockedError
from rona_core.session.document import Session

T = TypeVar("T")
CAPTURE = "capture "  # before the name of a capture, where results are named too


def result_input(name: str, *, optional: bool = False) -> Input:
    """Return the value of a result as an input."""

    def read(session: Session) -> object:
        derived = session.results.get(name)
        return None if derived is None else derived.value

    return Input(read, None, name, optional)


def capture_input(name: str) -> Input:
    """Return a capture as an input."""
    return Input(lambda session: session.captures.get(name), None, f"{CAPTURE}{name}")


def wanted_for(item: Input) -> str:
    """Return what to do to get an input."""
    if item.wanted is not None or item.upstream is None:
        return item.wanted or ""
    return wanted_of(item.upstream)


def wanted_of(name: str) -> str:
    """Return what to do to get a result (``"roll"``) or capture (``"capture scan"``)."""
    if name.startswith(CAPTURE):
        return REGISTRY.captures[name.removeprefix(CAPTURE)].wanted
    return REGISTRY.result(name).wanted


def missing(inputs: tuple[Input, ...], session: Session) -> str | None:
    """Return what to do first, or None if nothing is missing."""
    for item in inputs:
        if not item.optional and item.read(session) in (None, ()):
            return wanted_for(item)
    return None


def require_result(value: T | None, wanted: str) -> T:
    """Return ``value``; raise StepBlockedError that says what to do first where it is missing."""
    if value is None or value == ():
        raise StepBlockedError(f"first {wanted}")
    return value
