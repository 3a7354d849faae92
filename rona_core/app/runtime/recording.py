"""Recording: what every capture shares. Stop ends it early; what came so far is kept."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from rona_core.app.declarations.declarations import ActivityContext
from rona_core.app.dependencies.staleness import capture_setup_digest
from rona_core.app.messages.message import Point
from rona_core.devices.protocols import Motion, never
from rona_core.devices.samples import ToolTrack, TrackerFrame
from rona_core.errors import DeviceError
from rona_core.session.captures import PointerCapture
from rona_core.session.document import Session

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
