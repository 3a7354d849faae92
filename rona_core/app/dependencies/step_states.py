"""States of the steps: done, ready, blocked, stale or partial, and why."""

from dataclasses import dataclass
from typing import Literal

from rona_core.app.declarations.declarations import USABLE, Judgement, StepLine
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.inputs import missing
from rona_core.app.dependencies.judge import STOPPED_EARLY, blocked, judge
from rona_core.session.document import Session

State = Literal["done", "partial", "ready", "blocked", "stale"]


@dataclass(frozen=True, slots=True)
class StepState:
    """One step of the procedure: its title, its state and why."""

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


def step_judgement(name: str, session: Session) -> Judgement:
    """Return the judgement of what a step leaves behind: the first part that is not usable."""
    found = [judge(item, session) for item in REGISTRY.lines[name].leaves(session)]
    lacking = [one for one in found if not one.holds] or [one for one in found if one.reason]
    return lacking[0] if lacking else USABLE


def _step_state(number: int, name: str, line: StepLine, session: Session) -> StepState:
    hindrance = None if line.message is None else blocked(line.message, session)
    against = None if hindrance is None else hindrance.reason
    state, reason = _state(line, session, against)
    return StepState(number, name, line.title, state, reason, against)


def _state(line: StepLine, session: Session, against: str | None) -> tuple[State, str]:
    if line.message is None:
        return "done", line.summary(session)
    leaves = line.leaves(session)
    there = missing(leaves, session) is None
    if there:
        found = [judge(item, session) for item in leaves]
        if (reason := line.stale(session)) is not None:
            return "stale", reason
        for one in found:
            if one.state == "stale":
                return "stale", one.reason
        if not all(one.holds for one in found):
            return "ready", line.summary(session)
    elif against is not None:
        return "blocked", against
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
            return STOPPED_EARLY
    return None
