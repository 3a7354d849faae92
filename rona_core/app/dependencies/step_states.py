"""States of the steps: done, ready, blocked, stale or partial, and why."""

from dataclasses import dataclass
from typing import Literal

from rona_core.app.declarations.declarations import Step, StepLine
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
        _step_state(number, step, step.line, session)
        for number, step in enumerate(REGISTRY.listed, start=1)
        if step.line is not None
    )


def _step_state(number: int, step: Step, line: StepLine, session: Session) -> StepState:
    blocked = None if line.message is None else blocked_reason(line.message, session)
    state, reason = _state(line, session, blocked)
    return StepState(number, step.name, line.title, state, reason, blocked)


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
    partial = line.partial(session)
    if partial is not None and (there or line.partial_without):
        return "partial", partial
    return ("done", line.summary(session)) if there else ("ready", partial or "ready")


def summary(step: str, session: Session) -> str:
    """Return one line about what a step has produced; empty if nothing yet."""
    return next(
        (one.line.summary(session) for one in REGISTRY.steps if one.name == step and one.line), ""
    )


def partial_reason(step: str, session: Session) -> str | None:
    """Return what a step lacks because a recording was stopped early; None where it is whole."""
    return next(
        (one.line.partial(session) for one in REGISTRY.steps if one.name == step and one.line), None
    )


def stopped_early(capture: str, session: Session) -> str | None:
    """Return that a recording was stopped early; None where it is whole, or there is none."""
    held = session.captures.get(capture)
    strokes = held if isinstance(held, tuple) else (held,)
    if not any(stroke is not None and stroke.partial for stroke in strokes):
        return None
    return "the recording was stopped early: do it again, or go on with what came"
