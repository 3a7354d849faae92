"""Requirements: what must be there, and fresh, before a message makes sense."""

from rona_core.app.declarations.declarations import Activity, Command, Message
from rona_core.app.declarations.inputs import Input
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.inputs import CAPTURE, missing, wanted_for
from rona_core.app.dependencies.staleness import stale_reason, stale_root
from rona_core.errors import StepBlockedError
from rona_core.session.document import Session


def blocked_reason(message_type: type, session: Session) -> str | None:
    """Return what is to be done before a message of this type makes sense; None: nothing."""
    name = message_type.__name__
    declared: Command | Activity | None = REGISTRY.commands.get(name)
    again = declared is not None  # a command computes anew from what is there
    declared = declared or REGISTRY.activities.get(name)
    if declared is None:
        return None
    wanted = missing(declared.needs, session)
    if wanted is not None:
        return f"first {wanted}"
    if declared.blocked is not None and (reason := declared.blocked(session)) is not None:
        return reason
    if isinstance(declared, Command) and declared.takes_stale:
        return None
    # to compute anew from a capture that is stale changes nothing: the result is stale, too
    behind = tuple(item for item in declared.needs if not (again and _is_capture(item)))
    return _stale_before(behind, session)


def _is_capture(item: Input[object]) -> bool:
    return item.upstream is not None and item.upstream.startswith(CAPTURE)


def _stale_before(inputs: tuple[Input[object], ...], session: Session) -> str | None:
    """Return which stale input is to be made again first, and why; None where all are fresh."""
    root = stale_root(tuple(i for i in inputs if not _is_orphan(i, session)), session)
    if root is None or root.upstream is None:
        return None
    return f"first {wanted_for(root)} again: {stale_reason(root.upstream, session)}"


def _is_orphan(item: Input[object], session: Session) -> bool:
    """Return whether a capture lacks the result it rests on: a file too old to hold the plan.

    Its scan can be mapped.
    """
    if item.upstream is None or not _is_capture(item):
        return False
    after = REGISTRY.captures[item.upstream.removeprefix(CAPTURE)].after
    if after is None or after.upstream is None or _is_capture(after):
        return False
    return session.results.get(after.upstream) is None


def require_inputs(message_type: type, session: Session) -> None:
    """Raise StepBlockedError if ``session`` lacks what the message needs, or has it stale."""
    reason = blocked_reason(message_type, session)
    if reason is not None:
        raise StepBlockedError(f"{message_type.__name__} is blocked: {reason}")


def require_for(activity: Message, session: Session) -> None:
    """Raise StepBlockedError if ``session`` lacks what an activity needs, or has it stale."""
    declared = REGISTRY.activity(activity)
    if declared.check is not None:
        declared.check(activity, session)
    require_inputs(type(activity), session)
