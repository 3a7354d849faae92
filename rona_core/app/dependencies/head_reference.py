"""Pose of the head during a capture, relative to the first stroke of step 4."""

from dataclasses import dataclass
from functools import cache
from typing import Literal

from rona_core.app.declarations.inputs import Input
from rona_core.app.dependencies.base_reference import found_again, reference_of, seen_base
from rona_core.calibration.hand_eye.reference_markers import (
    HeadMotion,
    detect_tracker_movement,
    head_motion,
    head_reference,
)
from rona_core.errors import DegenerateGeometryError, RonaError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose, Poses
from rona_core.session.captures import PointerCapture, ScanCapture
from rona_core.session.document import Session
from rona_core.session.memo import remember

Watched = PointerCapture | ScanCapture  # captures on the head, with the marker on it


@dataclass(frozen=True, slots=True, eq=False)
class HeadWatch:
    """Motion of the head in a capture, by its marker."""

    state: Literal["still", "moved", "unchecked"]
    motion: HeadMotion | None = None  # None where it is unchecked
    reason: str = ""  # why it is unchecked

    def back(self, times_s: Floats) -> Poses | None:
        """Return what leads things measured at times (n,) back to step 4; None: as they are."""
        return self.motion.back(times_s) if self.motion and self.state == "moved" else None


@dataclass(frozen=True, slots=True, eq=False)
class HeadReference:
    """How the head lay in the first stroke of step 4, by the marker on it."""

    first: PointerCapture | None  # None where the marker was not recorded
    T_base_tracker: Pose | None  # None where it is not known, for a reason
    reason: str = ""

    def watch(self, capture: Watched) -> HeadWatch | None:
        """Return what the head did during a capture; None where its marker was not recorded."""
        if capture.head is None:
            return None
        if self.first is None:
            return HeadWatch("unchecked", reason="the head marker was not recorded in step 4")
        if self.T_base_tracker is None:
            return HeadWatch("unchecked", reason=self.reason)
        return _watch(self.first, capture, self.T_base_tracker)


def head_of(session: Session) -> HeadReference:
    """Return how the head lay in the first stroke of step 4."""
    first = session.captures.surface[0] if session.captures.surface else None
    if first is None or first.head is None:
        return HeadReference(None, None)
    try:
        return HeadReference(first, reference_of(session, first).T_base_tracker)
    except RonaError as error:
        return HeadReference(first, None, str(error))


def watch_head(session: Session, capture: Watched | None) -> HeadWatch | None:
    """Return what the head did during a capture; None where its marker was not recorded."""
    return None if capture is None else head_of(session).watch(capture)


@remember(16)  # captures never change
def _watch(first: PointerCapture, capture: Watched, T_base_tracker: Pose) -> HeadWatch:
    if first.head is None or capture.head is None:
        return HeadWatch("unchecked", reason="the head marker was not recorded")
    times_s = capture.scans.times_s if isinstance(capture, ScanCapture) else capture.marker.times_s
    if not len(times_s):
        return HeadWatch("unchecked", reason="nothing was recorded")
    reason = None if capture is first else _tracker_moved(first, capture)
    if reason is not None:
        return HeadWatch("unchecked", reason=reason)
    try:
        motion = head_motion(
            head_reference(first.head),
            capture.head,
            T_base_tracker,
            (float(times_s[0]), float(times_s[-1])),
        )
    except DegenerateGeometryError as error:
        return HeadWatch("unchecked", reason=str(error))
    return HeadWatch("moved" if motion.moved else "still", motion)


def _tracker_moved(first: PointerCapture, capture: Watched) -> str | None:
    """Return why head and tracker cannot be separated; None where the tracker stood still."""
    if first.base is None or capture.base is None:
        return "the base marker was not recorded"
    try:
        seen = [seen_base(track.Ts_tracker_marker) for track in (first.base, capture.base)]
    except DegenerateGeometryError as error:
        return str(error)
    if detect_tracker_movement(*seen).moved:
        return "the tracker was moved since step 4"
    return None


def _held(session: Session, names: tuple[str, ...]) -> list[Watched]:
    """Return the captures of these names; of those that add up, each."""
    found: list[Watched] = []
    for name in names:
        held = session.captures.get(name)
        found += held if isinstance(held, tuple) else () if held is None else (held,)
    return found


@cache
def head_input(*captures: str) -> Input[HeadReference]:
    """Return how the head lay, for captures of these names: one object for each set of names.

    It counts by what the motion in those captures is computed from: the last bits of the motion
    depend on the processor.
    """

    def recorded(session: Session) -> object:
        watched = [capture for capture in _held(session, captures) if capture.head]
        if not watched:
            return ()
        strokes, tool = session.captures.surface, session.results.tool
        first = (strokes[0].head, strokes[0].base) if strokes else ()
        registered = () if tool is None else (tool.value, found_again(session, strokes[:1]))
        tracks = [track for capture in watched for track in (capture.head, capture.base)]
        return (*registered, *first, *tracks)

    return Input(head_of, "watch the head marker", optional=True, counts=recorded)
