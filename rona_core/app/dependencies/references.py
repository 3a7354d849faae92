"""References of a capture: where the tracker stood, and how the head lay."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from rona_core.app.declarations.inputs import Input, Quantity
from rona_core.app.dependencies.staleness import required, result_input
from rona_core.calibration.hand_eye.reference_markers import (
    MIN_FRAMES,
    BaseReference,
    HeadMotion,
    Movement,
    SeenBase,
    detect_tracker_movement,
    head_motion,
    head_reference,
    mean_base,
    point_sigmas_mm,
    update_registration,
)
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.calibration.tracking_error import TrackerErrorField
from rona_core.devices.samples import ToolTrack
from rona_core.devices.settings import TrackerPlace, TrackerSettings
from rona_core.devices.trackers import FIELD_MM
from rona_core.errors import DegenerateGeometryError, RonaError, StaleResultError
from rona_core.geometry.arrays import Floats, as_points
from rona_core.geometry.pose import Pose, Poses
from rona_core.session.captures import PointerCapture, ScanCapture, SonoCapture, is_imported
from rona_core.session.document import Session
from rona_core.session.memo import remember

REMEDY = "register again, or allow the base marker (step 1)"


@dataclass(frozen=True, slots=True, eq=False)
class TrackerReference:
    """The tracker in ``base`` that holds for one capture, and how well it is known."""

    state: Literal["kept", "carried", "unchecked"]
    T_base_tracker: Pose
    covariance: Floats  # (6, 6), as geometry/pose_covariance.py says
    added_mm: float  # predicted 3D RMS error that the move costs where the pointer was
    movement: Movement | None  # None where the base marker was not seen
    sentence: str

    def sigma_mm(self, points_base: ArrayLike) -> Floats:
        """Return the predicted 3D error (n,) of places (n, 3) by the registration, move included.

        What the fixed error of the tracker does to the pointer itself is not in it.
        """
        return point_sigmas_mm(self.T_base_tracker, self.covariance, as_points(points_base))


@remember(16)  # each session that holds a capture asks for it anew
def seen_base(Ts_tracker_basemarker: Poses) -> SeenBase:
    """Return the mean of a base marker that stood still, as ``mean_base`` does."""
    return mean_base(Ts_tracker_basemarker)


def base_reference(track: ToolTrack | None, T_base_tracker: Pose) -> BaseReference | None:
    """Return what the registration remembers of the base marker; None if it was not seen."""
    if track is None or len(track.times_s) < MIN_FRAMES:
        return None
    seen = seen_base(track.Ts_tracker_marker)
    return BaseReference(T_base_tracker @ seen.T_tracker_basemarker, seen)


@dataclass(frozen=True, slots=True, eq=False)
class Registered:
    """The registration of the tracker, and what shows whether it stands where it stood then."""

    tool: ToolRegistration
    place: TrackerPlace | None  # where the tracker was put for it; None: not known
    use_base_marker: bool  # to find a tracker again that was moved since
    field: TrackerErrorField

    def reference(self, capture: PointerCapture | SonoCapture) -> TrackerReference:
        """Return where the tracker was during a stroke of the pointer.

        Raises:
            StaleResultError: the tracker has moved since, and is not found again.
        """
        tool = self.tool
        registered, track, unseen = tool.base, capture.base, _unseen(tool, capture)
        if registered is None or track is None or unseen is not None:
            if self._placed_anew(capture):
                raise StaleResultError(
                    f"the tracker was moved since the tool was registered, and {unseen}: uncover "
                    "it and record the stroke again, or register again"
                )
            return _as_registered(
                tool, "unchecked", None, f"It is not known if it moved: {unseen}."
            )
        now = seen_base(track.Ts_tracker_marker)
        movement = detect_tracker_movement(registered.seen, now)
        if not movement.moved:
            return _as_registered(
                tool,
                "kept",
                movement,
                "The base marker stands where it was: the tracker has not moved.",
            )
        if not self.use_base_marker:
            words = f"{moved_words(movement)} since the tool was registered"
            raise StaleResultError(f"{words}: {REMEDY}")
        return self._carried(registered, now, movement, capture)

    def _carried(
        self,
        registered: BaseReference,
        now: SeenBase,
        movement: Movement,
        capture: PointerCapture | SonoCapture,
    ) -> TrackerReference:
        """Return the registration carried along with a tracker that was moved."""
        tool, field = self.tool, self.field
        carried = update_registration(
            tool.T_base_tracker, tool.covariance[:6, :6], registered.seen, now, field
        )
        places_tracker = capture.marker.Ts_tracker_marker.translations
        added_mm = 0.0
        if len(places_tracker):
            center = places_tracker.mean(axis=0)
            at_base = carried.added_sigma_mm((carried.T_base_tracker @ center)[None])[0]
            added_mm = float(np.hypot(at_base, _field_change_mm(center, movement.T_a_b, field)))
        return TrackerReference(
            state="carried",
            T_base_tracker=carried.T_base_tracker,
            covariance=carried.covariance,
            added_mm=added_mm,
            movement=movement,
            sentence=(
                f"{moved_words(movement).capitalize()}: found again by the base marker, which adds "
                f"an expected error of {added_mm:.2f} mm."
            ),
        )

    def _placed_anew(self, capture: PointerCapture | SonoCapture) -> bool:
        if self.place is None or is_imported(capture):  # an imported one has no known place
            return False
        return self.place != capture.tracker_place


def error_field(settings: TrackerSettings) -> TrackerErrorField:
    """Return what is assumed of the fixed error of this tracker."""
    return TrackerErrorField(FIELD_MM[settings.profile], settings.depth_ratio)


def _registered(
    tool: ToolRegistration | None,
    place: TrackerPlace | None,
    use_base_marker: bool,
    field: TrackerErrorField,
) -> Registered | None:
    return None if tool is None else Registered(tool, place, use_base_marker, field)


TRACKER_FIELD = Input(
    lambda s: error_field(s.setup.devices.tracker),
    "choose a tracker (step 1)",
    title="the tracker (step 1)",
)
_BESIDE_TOOL = {
    "place of the tracker": Input(
        lambda s: None if s.captures.tool is None else s.captures.tool.tracker_place,
        "register the tool (step 2)",
        optional=True,
        title="the place of the tracker (step 1)",
    ),
    "use of the base marker": Input(
        lambda s: s.setup.use_base_marker,
        "choose the reference (step 1)",
        title="the use of the base marker (step 1)",
    ),
    "field of the tracker": TRACKER_FIELD,
}
REGISTERED: Quantity[Registered] = Quantity(
    Registered, {"tool": result_input("tool"), **_BESIDE_TOOL}
)
ANY_REGISTERED: Quantity[Registered] = Quantity(
    _registered, {"tool": result_input("tool", optional=True), **_BESIDE_TOOL}, optional=True
)


def reference_of(session: Session, capture: PointerCapture | SonoCapture) -> TrackerReference:
    """Return where the tracker was during a stroke of the pointer.

    Raises:
        StepBlockedError: the tool is not registered.
        StaleResultError: the tracker has moved since, and is not found again by the base marker.
    """
    return required(REGISTERED, session).reference(capture)


def found_again(session: Session, captures: Sequence[PointerCapture | SonoCapture | None]) -> bool:
    """Return whether the tracker may be found again wherever that is needed to map captures.

    False where it moved between the registration and a capture, and the base marker is not to be
    used. What was captured from where the tracker was registered needs no marker.
    """
    held = session.results.tool
    if session.setup.use_base_marker or held is None:
        return True
    return not any(_has_moved(held.value, capture) for capture in captures if capture is not None)


@remember(32)  # registrations and captures never change
def _has_moved(tool: ToolRegistration, capture: PointerCapture | SonoCapture) -> bool:
    """Return whether the base marker shows that the tracker stood elsewhere in a capture."""
    if tool.base is None or capture.base is None or _unseen(tool, capture) is not None:
        return False
    return detect_tracker_movement(tool.base.seen, seen_base(capture.base.Ts_tracker_marker)).moved


def weakest_reference(
    session: Session, strokes: Sequence[PointerCapture]
) -> TrackerReference | None:
    """Return the reference of the stroke that a move of the tracker costs most.

    None without strokes, or where one cannot be mapped.
    """
    try:
        found = [reference_of(session, stroke) for stroke in strokes]
    except RonaError:
        return None
    return max(found, key=lambda reference: reference.added_mm, default=None)


def carried_remark(session: Session, strokes: Sequence[PointerCapture]) -> str:
    """Return a word for the line of a step where a tracker that had moved was found again."""
    registered = session.captures.tool
    if registered is None or all(s.tracker_place == registered.tracker_place for s in strokes):
        return ""  # spares the work: the session holds no move of it
    found = weakest_reference(session, strokes)
    if found is None or found.state != "carried":
        return ""
    return f", tracker found again (+{found.added_mm:.2f} mm)"


def moved_words(movement: Movement) -> str:
    """Return "the tracker has moved by 12 mm and 0.3°"."""
    words = f"the tracker has moved by {movement.shift_mm:.3g} mm"
    return f"{words} and {movement.turn_deg:.2g}°" if movement.turn_deg >= 0.05 else words


def placed_reason(session: Session) -> str | None:
    """Return why new strokes could not be mapped: the tracker was moved and is not found again.

    What was recorded before the move stays valid, as it was taken from the old place.
    """
    capture, tool = session.captures.tool, session.results.tool
    place = session.setup.devices.tracker.place
    if capture is None or tool is None or capture.tracker_place == place:
        return None
    words = "the tracker was moved since the tool was registered"
    if not session.setup.use_base_marker:
        return f"{words}: {REMEDY}"
    if tool.value.base is None:
        return f"{words}, and the base marker was not seen then: register again"
    if "basemarker" in session.setup.devices.tracker.hidden_tools:
        return f"{words}, and the base marker is covered: uncover it, or register again"
    return None


def _unseen(tool: ToolRegistration, capture: PointerCapture | SonoCapture) -> str | None:
    """Return why the base marker says nothing about a capture, None if it does."""
    if tool.base is None:
        return "the base marker was not seen while the tool was registered"
    if capture.base is None:
        return "the base marker was not recorded"
    if len(capture.base.times_s) < MIN_FRAMES:
        return (
            f"the base marker was hidden (seen in {len(capture.base.times_s)} of "
            f"{capture.base.n_frames} frames)"
        )
    return None


def _as_registered(
    tool: ToolRegistration,
    state: Literal["kept", "unchecked"],
    movement: Movement | None,
    sentence: str,
) -> TrackerReference:
    covariance = tool.covariance[:6, :6]
    return TrackerReference(state, tool.T_base_tracker, covariance, 0.0, movement, sentence)


def _field_change_mm(center_tracker: Floats, T_a_b: Pose, field: TrackerErrorField) -> float:
    """Return by how much (3D RMS) the error of a marker changes with the move of the tracker."""
    places = np.vstack((center_tracker, T_a_b @ center_tracker))
    spread = field.covariance(places)
    change = np.hstack((np.eye(3), -np.eye(3)))
    return float(np.sqrt(max(np.trace(change @ spread @ change.T), 0.0)))


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

    return Input(
        head_of,
        "watch the head marker",
        optional=True,
        counts=recorded,
        title="the record of the head marker",
    )
