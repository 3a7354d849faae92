"""Inputs of results and messages, by the name of the result or capture that they are."""

from functools import cache
from typing import Any, TypeVar

from rona_core.app.declarations.inputs import Input, Quantity, is_missing
from rona_core.app.declarations.registry import REGISTRY
from rona_core.errors import StepBlockedError
from rona_core.session.document import Session

T = TypeVar("T")
CAPTURE = "capture "  # before the name of a capture, where results are named too


@cache
def result_input(name: str, *, optional: bool = False) -> Input[Any]:
    """Return the value of a result as an input: one object for each result."""

    def read(session: Session) -> object:
        derived = session.results.get(name)
        return None if derived is None else derived.value

    return Input(read, None, name, optional)


@cache
def capture_input(name: str) -> Input[Any]:
    """Return a capture as an input: one object for each capture."""
    return Input(lambda session: session.captures.get(name), None, f"{CAPTURE}{name}")


def wanted_for(item: Input[object]) -> str:
    """Return what to do to get an input."""
    if item.wanted is not None or item.upstream is None:
        return item.wanted or ""
    return wanted_of(item.upstream)


def wanted_of(name: str) -> str:
    """Return what to do to get a result (``"roll"``) or capture (``"capture scan"``)."""
    if name.startswith(CAPTURE):
        return REGISTRY.captures[name.removeprefix(CAPTURE)].wanted
    return REGISTRY.result(name).wanted


def missing(inputs: tuple[Input[object], ...], session: Session) -> str | None:
    """Return what to do first, or None if nothing is missing."""
    for item in inputs:
        if not item.optional and is_missing(item.read(session)):
            return wanted_for(item)
    return None


def required(item: Input[T] | Quantity[T], session: Session) -> T:
    """Return an input or a quantity; raise StepBlockedError that says what to do first."""
    value = item.read(session)
    if value is None or is_missing(value):
        parts = (item,) if isinstance(item, Input) else tuple(item.inputs().values())
        raise StepBlockedError(f"first {missing(parts, session) or wanted_for(parts[0])}")
    return value
