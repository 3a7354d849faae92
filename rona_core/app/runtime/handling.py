"""Handling: what each message does to a session, what captures share, and derived results.

Stop ends a capture early; what came so far is kept.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TypeVar

import numpy as np

from rona_core.app.declarations.declarations import ActivityContext, Message, Perform, Result
from rona_core.app.declarations.inputs import handed_items
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.changes import title
from rona_core.app.dependencies.judge import require_inputs
from rona_core.app.dependencies.staleness import (
    CAPTURE,
    capture_setup_digest,
    input_digests,
    missing,
    required,
    stale_reason,
)
from rona_core.app.messages.message import (
    Point,
    StoreCapture,
    StoreResult,
    message_from,
    serialize_arguments,
)
from rona_core.devices.protocols import Cancel, Motion, Progress, never, silent
from rona_core.devices.samples import ToolTrack, TrackerFrame
from rona_core.errors import DeviceError, InvalidInputError, StaleResultError
from rona_core.session.captures import Capture, PointerCapture
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
    anew = all(_result_stands(one, session, arguments) for one in made)
    values: dict[str, object] = {}
    for number, result in enumerate(results):

        def part(share: float, start: int = number) -> None:
            progress((start + share) / len(results))

        derived = None
        if not _left_out(result, session):
            held = session.results.get(result.name)
            if anew or held is None or not _result_stands(result, session, arguments):
                value = derive(result, session, message, progress=part, cancel=cancel)
                digests = input_digests(result.name, session, name)
                held = Derived(value, name, arguments, digests)
            derived = held
        session = session.with_result(result.name, derived)
        values[result.name] = None if derived is None else derived.value
    return values


def _left_out(result: Result, session: Session) -> bool:
    return result.spared and missing(tuple(result.inputs.values()), session) is not None


def _result_stands(result: Result, session: Session, arguments: Mapping[str, object]) -> bool:
    """Return whether a result is there, fresh, and made with the same settings."""
    held = session.results.get(result.name)
    if held is None or stale_reason(result.name, session) is not None:
        return False
    return all(held.arguments.get(name) == arguments[name] for name in result.settings)


def handle(message: Message, session: Session) -> Session:
    """Return the session after ``message``; the one that came in stays as it was.

    Raises:
        RonaError: the message does not fit the session.
    """
    if isinstance(message, StoreCapture):
        return _store_capture(message, session)
    if isinstance(message, StoreResult):
        return _store_result(message, session)
    name = type(message).__name__
    declared = REGISTRY.commands.get(name) or REGISTRY.outcomes.get(name)
    if declared is None or declared.handle is None:
        raise InvalidInputError(f"there is no handler for {name}")
    return declared.handle(message, session)


def compute_result(message: Message, session: Session) -> Session:
    """Return the session with the result that a command asks for.

    Raises:
        StepBlockedError: an input is missing.
    """
    require_inputs(type(message), session)
    name = type(message).__name__
    (result,) = REGISTRY.results_of(name)
    inputs = input_digests(result.name, session, name)
    made = Derived(derive(result, session, message), name, serialize_arguments(message), inputs)
    return session.with_result(result.name, made)


def _store_capture(message: StoreCapture, session: Session) -> Session:
    """Return the session with a capture in its place, and in the archive: none is ever lost.

    One that was stopped early takes no place of a whole one that is not stale: the archive alone
    has it then, and all that rests on the whole one stays as it was. Where captures add up it does.
    """
    declared = REGISTRY.captures[message.kind]
    after = replace(session, archive=(*session.archive, message.capture))
    if message.capture.partial and not declared.adds and _stands(message.kind, session):
        return after
    held = declared.placed(session, message.capture, message.append)
    after = after.with_capture(message.kind, held)
    return after if declared.stored is None else declared.stored(session, after)


def _stands(name: str, session: Session) -> bool:
    """Return whether there is a whole capture of this name that is not stale."""
    held = session.captures.get(name)
    captures = held if isinstance(held, tuple) else (held,)
    whole = all(capture is not None and not capture.partial for capture in captures)
    return bool(captures) and whole and stale_reason(f"{CAPTURE}{name}", session) is None


def _store_result(message: StoreResult, session: Session) -> Session:
    """Return the session with computed results, each of which may depend on those before.

    Raises:
        StaleResultError: an input has changed while one was computed.
    """
    for name, value in message.values.items():
        made = None
        if value is not None:
            inputs = message.inputs[name]
            _require_unchanged(name, message.message, inputs, session)
            made = Derived(value, message.message, message.arguments, inputs)
        session = session.with_result(name, made)
    return session


def _require_unchanged(name: str, by: str, inputs: dict[str, str], session: Session) -> None:
    now, items = input_digests(name, session, by), REGISTRY.result(name, by).inputs
    changed = [title(items[key]) for key in now if now[key] != inputs.get(key)]
    if changed:
        raise StaleResultError(
            f"not stored: {' and '.join(changed)} changed meanwhile; start it again"
        )


def strip_for_worker(session: Session) -> Session:
    """Return the session without what no computation needs, to send it to another process."""
    return replace(session, archive=(), log=())


def record(
    kind: str,
    capture: Callable[[Message, Session, ActivityContext], Capture],
    then: Callable[[], Message] | None = None,
) -> Perform:
    """Return what carries out an activity that records a capture.

    Args:
        kind: Name of the capture.
        capture: Takes it; given the activity, the session and the context.
        then: The command that follows where the recording was not cut short.
    """

    def perform(
        activity: Message, session: Session, context: ActivityContext
    ) -> tuple[Message, ...]:
        taken = capture(activity, session, context)
        append = getattr(activity, "append", False)
        stored = StoreCapture(kind, taken, append, _file_of(activity))
        return (stored,) if taken.partial or then is None else (stored, then())

    return perform


def _file_of(activity: Message) -> str | None:
    """Return the name of the file that an activity reads, the first of several; None: of none."""
    first, *others = getattr(activity, "files", None) or (getattr(activity, "file", None),)
    return f"{first} and {len(others)} more" if others else first


def compute(
    message: Message, session: Session, context: ActivityContext
) -> tuple[StoreResult, ...]:
    """Carry out an activity that makes the results declared for it."""
    return computed(message, context.run(derive_all, strip_for_worker(session), message), session)


def computed(
    message: Message, values: Mapping[str, object], session: Session
) -> tuple[StoreResult, ...]:
    """Return the outcome that stores results by name; each may depend on those before."""
    by, arguments = type(message).__name__, serialize_arguments(message)
    inputs: dict[str, dict[str, str]] = {}
    for name, value in values.items():
        derived = None
        if value is not None:
            inputs[name] = input_digests(name, session, by)
            derived = Derived(value, by, arguments, inputs[name])
        session = session.with_result(name, derived)
    return (StoreResult(by, values, arguments, inputs),)


ARRIVAL_S = 0.12  # after a motion, until the last joint angles have arrived
LIVE_PERIOD_S = 0.02  # how often a positioning move looks at Cancel
SHOWN_FRAMES = 15  # of a stroke, after which what has come is shown anew
HEAD_HZ = 10.0  # how often the head marker is kept: a breath takes seconds


def begin(session: Session, context: ActivityContext) -> int:
    """Configure the devices from the session; return the ordinal of the capture that starts."""
    ordinal = len(session.archive) + 1
    context.rig.begin(session.setup.devices, ordinal)
    context.live.put(ordinal=ordinal)
    return ordinal


def capture_hand(
    kind: str,
    session: Session,
    context: ActivityContext,
    prepare: Callable[[], float],
    finished: Callable[[], bool] = never,
    *,
    tool: str | None = None,
    keep: list[TrackerFrame] | None = None,
) -> PointerCapture:
    """Record the marker of a tool in the hand, the pointer if none is named, while it moves.

    The frames themselves go to ``keep``; with it, they are shown while they come.
    """
    pointer = session.setup.devices.pointer if tool is None else tool
    ordinal = begin(session, context)
    duration_s = prepare()
    frames: list[TrackerFrame] = [] if keep is None else keep

    def until(frame: TrackerFrame) -> bool:
        context.progress(min(1.0, frame.time_s / duration_s))
        if keep is not None and len(frames) % SHOWN_FRAMES == 0:
            context.live.put(frames=tuple(frames))
        return frame.time_s >= duration_s or finished()

    try:
        partial = record_frames(context, until, frames)
    finally:
        context.live.put(frames=())
    return PointerCapture(
        ordinal=ordinal,
        setup_digest=capture_setup_digest(kind, session),
        pointer=pointer,
        marker=ToolTrack.from_frames(pointer, frames),
        partial=partial,
        base=ToolTrack.from_frames("basemarker", frames),
        tracker_place=session.setup.devices.tracker.place,
    )


def capture_stroke(
    kind: str,
    session: Session,
    context: ActivityContext,
    picks_base_mm: tuple[Point, ...],
    duration_s: float,
    without_picks: Callable[[], float],
) -> PointerCapture:
    """Let the pointer follow the picked places; without any, do what the operator does alone."""
    picks = np.array(picks_base_mm)

    def along_picks() -> float:
        return context.rig.operator.stroke(picks, duration_s=duration_s)

    frames: list[TrackerFrame] = []
    prepare = along_picks if len(picks) else without_picks
    taken = capture_hand(kind, session, context, prepare, keep=frames)
    every = max(1, round(session.setup.devices.tracker.rate_hz / HEAD_HZ))
    return replace(taken, head=ToolTrack.from_frames("headmarker", frames[::every]))


def part_of(context: ActivityContext, start: float, share: float) -> ActivityContext:
    """Return the context for a part of an activity: its progress goes from ``start`` on."""

    def progress(done: float) -> None:
        context.progress(start + share * done)

    return replace(context, progress=progress)


def record_frames(
    context: ActivityContext, ended: Callable[[TrackerFrame], bool], frames: list[TrackerFrame]
) -> bool:
    """Collect tracker frames until ``ended`` or Cancel; return whether it was cut short.

    Raises:
        DeviceError: the tracker stopped delivering frames.
    """
    for frame in context.rig.tracker.frames():
        frames.append(frame)
        context.live.put(frame=frame)
        if ended(frame):
            return False
        if context.cancel():
            context.rig.robot.stop()
            return True
    raise DeviceError("the tracker stopped delivering frames: is it connected and started?")


def finish(motion: Motion, context: ActivityContext) -> bool:
    """Let a motion end; return False if it was stopped instead."""
    clock = context.rig.clock
    while not motion.done():
        if context.cancel():
            context.rig.robot.stop()
            return False
        clock.wait_until(clock.now() + LIVE_PERIOD_S)
        context.live.put(joints=context.rig.robot.state())
    clock.wait_until(clock.now() + ARRIVAL_S)
    context.live.put(joints=context.rig.robot.state())
    return True
