"""Judgement of results and captures, and from it the states of the steps.

Judgement: whether a result or capture is usable, why not, and the message that mends it. The remedy
of something missing or stale is the message that makes the earliest part it lacks, in the order in
which the steps are declared. That of a bad result comes from its own declaration: to compute it
again would give the same.
"""

import dataclasses
from dataclasses import dataclass
from typing import Any, Literal

from rona_core.app.declarations.declarations import (
    USABLE,
    Activity,
    Command,
    Judge,
    Judgement,
    Message,
    Remedy,
    StepLine,
)
from rona_core.app.declarations.inputs import Input, is_missing
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.staleness import (
    CAPTURE,
    is_orphan,
    missing,
    place_of,
    stale_reason,
    stale_root,
    wanted_for,
    wanted_of,
)
from rona_core.app.messages.message import message_from
from rona_core.errors import RonaError, StepBlockedError
from rona_core.session.document import Session
from rona_core.session.memo import Memo

STOPPED_EARLY = "the recording was stopped early: do it again, or go on with what came"


@dataclass(frozen=True, slots=True)
class _Found:
    """A judgement, and the name of the part that its remedy mends."""

    judgement: Judgement
    root: str = ""


_JUDGED: Memo[_Found] = Memo(512)  # sessions never change, and each part asks those before


def judge(item: Input[object], session: Session) -> Judgement:
    """Return the judgement of an input of a result or message."""
    return _judged(item, session).judgement


def judge_part(name: str, session: Session) -> Judgement:
    """Return the judgement of a result (``"roll"``) or capture (``"capture scan"``)."""
    return _found(name, session).judgement


def usable(name: str, session: Session) -> Any:
    """Return the value of a result; None where it is missing, stale or bad."""
    held = session.results.get(name)
    return held.value if held is not None and judge_part(name, session).holds else None


def fresh(name: str, session: Session) -> Any:
    """Return the value of a result, bad or not; None where it is missing or stale."""
    held = session.results.get(name)
    return None if held is None or judge_part(name, session).state == "stale" else held.value


def blocked(message_type: type, session: Session) -> Judgement | None:
    """Return why a message of this type makes no sense yet, and its remedy; None: it does."""
    found = _hindrance(message_type, session)
    return None if found is None else found.judgement


def by_verdict(remedy: Remedy, *, used: bool = False) -> Judge:
    """Return the judge of a calibration with a ``verdict`` and ``reasons`` of its own.

    Args:
        remedy: Of one that is weak or bad: a measurement, which comes out otherwise when repeated.
        used: Whether a bad one is used all the same, with its large error; it counts as weak.
    """

    def judged(value: Any, session: Session) -> Judgement:
        if value.verdict == "good":
            return USABLE
        bad = value.verdict == "bad" and not used
        return Judgement("bad" if bad else "weak", "; ".join(value.reasons), remedy)

    return judged


def require_inputs(message_type: type, session: Session) -> None:
    """Raise StepBlockedError if ``session`` lacks what the message needs, or has it stale."""
    found = blocked(message_type, session)
    if found is not None:
        raise StepBlockedError(found.reason)


def require_for(activity: Message, session: Session) -> None:
    """Raise StepBlockedError if ``session`` lacks what an activity needs, or has it stale."""
    declared = REGISTRY.activity(activity)
    if declared.check is not None:
        declared.check(activity, session)
    require_inputs(type(activity), session)


def _judged(item: Input[object], session: Session) -> _Found:
    missing = is_missing(item.read(session))
    if item.upstream is None:
        first = Judgement("missing", f"first {item.wanted}", Remedy(item.wanted or ""))
        return _Found(first if missing else USABLE)
    found = _found(item.upstream, session)
    if not item.takes_bad or found.judgement.state in ("missing", "blocked", "stale"):
        return found
    reason = f"first {wanted_for(item)}: {found.judgement.reason}"
    lacks = Judgement("missing", reason, found.judgement.remedy)
    return _Found(lacks if missing else USABLE, found.root)


def _found(name: str, session: Session) -> _Found:
    return _JUDGED.get((session,), lambda: _judge(name, session), name)


def _judge(name: str, session: Session) -> _Found:
    if is_missing(_held(name, session)):
        return _of_missing(name, session)
    reason = stale_reason(name, session)
    if reason is not None:
        return _of_stale(name, reason, session)
    if name.startswith(CAPTURE):
        return _Found(_of_capture(name, session), name)
    derived = session.results.get(name)
    judged = None if derived is None else REGISTRY.result(name, derived.message).judged
    if derived is None or judged is None:
        return _Found(USABLE, name)
    return _Found(judged(derived.value, session), name)


def _held(name: str, session: Session) -> object:
    if name.startswith(CAPTURE):
        return session.captures.get(name.removeprefix(CAPTURE))
    return session.results.get(name)


def _of_capture(name: str, session: Session) -> Judgement:
    held = _held(name, session)
    judged = REGISTRY.captures[name.removeprefix(CAPTURE)].judged
    if judged is not None:
        return judged(held, session)
    strokes = held if isinstance(held, tuple) else (held,)
    if not any(getattr(stroke, "partial", False) for stroke in strokes):
        return USABLE
    return Judgement("weak", STOPPED_EARLY, Remedy(f"{wanted_of(name)} again", _maker(name)))


def _of_missing(name: str, session: Session) -> _Found:
    maker, wanted = _maker(name), wanted_of(name)
    hindrance = None if maker is None else _against(maker, session)
    if hindrance is not None:
        behind = hindrance.judgement
        state = "missing" if _is_recorded_for(maker, hindrance.root) else "blocked"
        return _Found(Judgement(state, behind.reason, behind.remedy), hindrance.root)
    return _Found(Judgement("missing", f"first {wanted}", Remedy(wanted, maker)), name)


def _is_recorded_for(maker: Message, root: str) -> bool:
    """Return whether a command computes from this capture, whose recording is followed by it."""
    command = REGISTRY.commands.get(type(maker).__name__)
    needed = () if command is None else command.needs
    return root.startswith(CAPTURE) and any(item.upstream == root for item in needed)


def _of_stale(name: str, reason: str, session: Session) -> _Found:
    itself: Input[object] = Input(lambda _: None, None, name)
    root = stale_root((itself,), session)
    first = name if root is None or root.upstream is None else root.upstream
    again = _again(first, session)
    hindrance = None if again is None else _against(again, session)
    if hindrance is not None:
        behind = hindrance.judgement
        return _Found(Judgement("stale", reason, behind.remedy), hindrance.root)
    return _Found(Judgement("stale", reason, Remedy(f"{wanted_of(first)} again", again)), first)


def _maker(name: str) -> Message | None:
    """Return the message that makes a result or capture; None where it has fields to be filled."""
    if name.startswith(CAPTURE):
        capture = name.removeprefix(CAPTURE)
        makers = (part for part in REGISTRY.activities.values() if capture in part.makes)
        kind = next((part.message for part in makers), None)
    else:
        kind = REGISTRY.result(name).message
    if kind is None or any(_is_needed(field) for field in dataclasses.fields(kind)):
        return None
    return kind()


def _is_needed(field: Any) -> bool:
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def _again(name: str, session: Session) -> Message | None:
    """Return the message that made what is stale, with its fields as they were."""
    derived = None if name.startswith(CAPTURE) else session.results.get(name)
    kind = None if derived is None else REGISTRY.messages.get(derived.message)
    if derived is None or kind is None:
        return _maker(name)
    names = {field.name for field in dataclasses.fields(kind)}
    arguments = {key: value for key, value in derived.arguments.items() if key in names}
    try:
        return message_from(derived.message, arguments)
    except RonaError:  # written by a version with other limits
        return _maker(name)


def _against(message: Message, session: Session) -> _Found | None:
    """Return what stands against this very message; None: nothing."""
    declared = REGISTRY.activities.get(type(message).__name__)
    if declared is not None and declared.check is not None:
        try:
            declared.check(message, session)
        except RonaError as error:
            return _Found(Judgement("blocked", str(error), Remedy(str(error))))
    return _hindrance(type(message), session)


def _hindrance(message_type: type, session: Session) -> _Found | None:
    name = message_type.__name__
    declared: Command | Activity | None
    declared = REGISTRY.commands.get(name) or REGISTRY.activities.get(name)
    if declared is None:
        return None
    found = [(item, _judged(item, session)) for item in declared.needs]
    lacking = [(item, one) for item, one in found if _hinders(item, one, declared, session)]
    if not lacking:
        own = (
            declared.blocked(session)
            if isinstance(declared, Activity) and declared.blocked
            else None
        )
        return None if own is None else _Found(own)
    _, first = min(lacking, key=lambda pair: place_of(pair[1].root))
    reason = _reason([item for item, _ in lacking], first, session)
    return _Found(Judgement("blocked", reason, first.judgement.remedy), first.root)


def _hinders(
    item: Input[object], found: _Found, declared: Command | Activity, session: Session
) -> bool:
    state = found.judgement.state
    if state in ("usable", "weak"):
        return False
    if state in ("missing", "blocked"):
        return not item.optional
    if state == "bad":
        return not item.takes_bad
    if item.optional or is_orphan(item, session):
        return False
    if not isinstance(declared, Command):
        return True
    # to compute anew from a capture that is stale changes nothing: the result is stale, too
    return not declared.takes_stale and not (item.upstream or "").startswith(CAPTURE)


def _reason(lacking: list[Input[object]], first: _Found, session: Session) -> str:
    """Return what is to be done first: what is missing before what is stale or bad."""
    for item in lacking:
        if is_missing(item.read(session)):
            found = judge(item, session)
            return found.reason if item.takes_bad else f"first {wanted_for(item)}"
    if first.judgement.state != "stale":
        return first.judgement.reason
    root = stale_root(tuple(lacking), session)
    name = "" if root is None or root.upstream is None else root.upstream
    return f"first {wanted_of(name)} again: {stale_reason(name, session)}"


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
