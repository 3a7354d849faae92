"""Deriving: results computed from the values that their declarations read of a session."""

from collections.abc import Mapping
from typing import TypeVar

from rona_core.app.declarations.declarations import Message, Result
from rona_core.app.declarations.inputs import handed_items
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.inputs import missing, required
from rona_core.app.dependencies.staleness import input_digests, stale_reason
from rona_core.app.messages.serialization import message_from, serialize_arguments
from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.errors import InvalidInputError
from rona_core.session.document import Derived, Session

T = TypeVar("T")


def read_inputs(kind: type[T], session: Session) -> T:
    """Return the values of a class of inputs as a session holds them.

    Raises:
        StepBlockedError: one that is needed is missing.
    """
    return kind(
        **{
            name: item.read(session) if item.optional else required(item, session)
            for name, item in handed_items(kind).items()
        }
    )


def derive(
    result: Result,
    session: Session,
    message: Message,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> object:
    """Return the value of a result from the inputs that a session holds.

    Raises:
        StepBlockedError: an input is missing.
        InvalidInputError: the result follows from no input.
    """
    known = _known(result, session)
    if result.derive is None:
        raise InvalidInputError(f"the {result.name} result follows from no capture")
    if type(message).__name__ in REGISTRY.activities:
        return result.derive(known, message, progress=progress, cancel=cancel)
    return result.derive(known, message)


def derive_again(
    name: str, session: Session, stored: Derived[object], progress: Progress, cancel: Cancel
) -> object:
    """Return the value of a stored result, computed again from the inputs that a session holds."""
    result = REGISTRY.result(name, stored.message)
    if result.recompute is None:
        message = message_from(stored.message, stored.arguments)
        return derive(result, session, message, progress=progress, cancel=cancel)
    return result.recompute(_known(result, session), stored.arguments, progress, cancel)


def _known(result: Result, session: Session) -> object:
    return None if result.known is None else read_inputs(result.known, session)


def derive_all(
    session: Session, message: Message, *, progress: Progress = silent, cancel: Cancel = never
) -> dict[str, object]:
    """Return the results that a message makes, in the order of their declaration.

    Where some of them stand, fresh and made with the same settings, and others do not, only those
    others are computed. A result that is spared is None where one of its inputs is missing.

    Raises:
        StepBlockedError: an input of a result that is not spared is missing.
        CancelledError: ``cancel`` returned True.
    """
    name, arguments = type(message).__name__, serialize_arguments(message)
    results = REGISTRY.results_of(name)
    made = [one for one in results if not _left_out(one, session)]
    anew = all(_stands(one, session, arguments) for one in made)
    values: dict[str, object] = {}
    for number, result in enumerate(results):

        def part(share: float, start: int = number) -> None:
            progress((start + share) / len(results))

        derived = None
        if not _left_out(result, session):
            held = session.results.get(result.name)
            if anew or held is None or not _stands(result, session, arguments):
                value = derive(result, session, message, progress=part, cancel=cancel)
                digests = input_digests(result.name, session, name)
                held = Derived(value, name, arguments, digests)
            derived = held
        session = session.with_result(result.name, derived)
        values[result.name] = None if derived is None else derived.value
    return values


def _left_out(result: Result, session: Session) -> bool:
    return result.spared and missing(tuple(result.inputs.values()), session) is not None


def _stands(result: Result, session: Session, arguments: Mapping[str, object]) -> bool:
    """Return whether a result is there, fresh, and made with the same settings."""
    held = session.results.get(result.name)
    if held is None or stale_reason(result.name, session) is not None:
        return False
    return all(held.arguments.get(name) == arguments[name] for name in result.settings)
