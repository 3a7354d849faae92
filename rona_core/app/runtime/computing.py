"""Computing: activities whose results follow from the session alone, in another process."""

from collections.abc import Callable
from dataclasses import fields, replace
from typing import TYPE_CHECKING

from rona_core.app.declarations.activity_context import ActivityContext
from rona_core.app.declarations.declarations import Message
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.requirements import require_for
from rona_core.app.dependencies.staleness import input_digests
from rona_core.app.messages.outcomes import StoreResult
from rona_core.app.messages.serialization import serialize_arguments
from rona_core.errors import InvalidInputError
from rona_core.session.document import Derived, Session

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def strip_for_worker(session: Session) -> Session:
    """Return the session without what no computation needs, to send it to another process."""
    return replace(session, archive=(), log=())


def compute_one(
    message: Message, session: Session, context: ActivityContext
) -> tuple[StoreResult, ...]:
    """Carry out an activity that makes the one result declared for it."""
    require_for(message, session)
    (result,) = REGISTRY.results_of(type(message).__name__)
    if result.derive is None:
        raise InvalidInputError(f"{result.name} is not computed from a session")
    inputs = input_digests(result.name, session, type(message).__name__)
    value = context.run(result.derive, strip_for_worker(session), message)
    arguments = serialize_arguments(message)
    values = {result.name: value}
    return (StoreResult(type(message).__name__, values, arguments, {result.name: inputs}),)


def compute_several(
    derive: Callable[..., "DataclassInstance"],
) -> Callable[[Message, Session, ActivityContext], tuple[StoreResult, ...]]:
    """Return what carries out an activity that makes several results by ``derive``.

    Args:
        derive: Returns a dataclass with a field for each result, in the order they follow.
    """

    def perform(
        message: Message, session: Session, context: ActivityContext
    ) -> tuple[StoreResult, ...]:
        require_for(message, session)
        made = context.run(derive, strip_for_worker(session), message)
        values = {part.name: getattr(made, part.name) for part in fields(made)}
        by, arguments = type(message).__name__, serialize_arguments(message)
        inputs: dict[str, dict[str, str]] = {}
        for name, value in values.items():  # each may depend on those before
            derived = None
            if value is not None:
                inputs[name] = input_digests(name, session, by)
                derived = Derived(value, by, arguments, inputs[name])
            session = replace(session, results=session.results.with_(name, derived))
        return (StoreResult(by, values, arguments, inputs),)

    return perform
