"""States of the steps: done, ready, blocked, stale or partial, and why."""

from dataclasses import dataclass
from typing import Literal

from rona_core.app.declarations.declarations import StepLine
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.inputs import missing
from rona_core.app.dependencies.requirements import blocked_reason
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.session.document import Session

State = Literal["done", "partial", "ready", "blocked", "stale"]


@dataclass(frozen=True, slots=True)
class StepState:
    """One step of the procedure: what it is, how it stands and why."""

    number: int
    name: str
    title: str
    state: State
    reason: str  # why blocked, stale or partial, or a line about the result
    blocked: str | None = None  # what is to be done before it can be started, again too


def step_states(session: Session) -> tuple[StepState, ...]:
    """Return the state of every step of the procedure, in order."""
    return tuple(
        _step_state(number, name, line, session)
        for number, (name, line) in enumerate(REGISTRY.lines.items(), start=1)
    )


def _step_state(number: int, name: str, line: StepLine, session: Session) -> StepState:
    blocked = None if line.message is None else blocked_reason(line.message, session)
    state, reason = _state(line, session, blocked)
    return StepState(number, name, line.title, state, reason, blocked)


def _state(line: StepLine, session: Session, blocked: str | None) -> tuple[State, str]:
    if line.message is None:
        return "done", line.summary(session)
    leaves = line.leaves(session)
    there = missing(leaves, session) is None
    if there:
        for name in (item.upstream or "" for item in leaves):
            if (reason := line.stale(session) or stale_reason(name, session)) is not None:
                return "stale", reason
        if line.unusable(session) is not None:
            return "ready", line.summary(session)
    elif blocked is not None:
        return "blocked", blocked
    partial = partial_reason(line, session)
    if partial is not None and (there or line.partial_without):
        return "partial", partial
    return ("done", line.summary(session)) if there else ("ready", partial or "ready")


def partial_reason(line: StepLine, session: Session) -> str | None:
    """Return what a step lacks because a recording was stopped early; None where it is whole."""
    if line.partial is not None:
        return line.partial(session)
    for item in line.leaves(session):
        held = item.read(session)
        strokes = held if isinstance(held, tuple) else (held,)
        if any(getattr(stroke, "partial", False) for stroke in strokes):
            return "the recording was stopped early: do it again, or go on with what came"
    return None
