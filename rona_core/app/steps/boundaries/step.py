"""Boundaries: the A-scans of all scans, and how boundaries are corrected by hand."""

from dataclasses import replace

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.staleness import made_of, required
from rona_core.app.steps.acoustics.derivation import HELD_PROBE, ROBOT_PROBE
from rona_core.app.steps.boundaries.messages import ClearBoundaryCorrections, CorrectBoundary
from rona_core.app.steps.handheld.derivation import POSED
from rona_core.app.steps.scan.derivation import joined_scans
from rona_core.app.steps.scan.inputs import Passes
from rona_core.devices.samples import AScanTrack
from rona_core.errors import InvalidInputError, StepBlockedError
from rona_core.session.captures import ScanCapture, SonoCapture
from rona_core.session.document import Session
from rona_core.session.memo import Memo
from rona_core.ultrasound.detection.detect import Detection
from rona_core.ultrasound.detection.manual_corrections import BoundaryEdits, ScanName, corrected
from rona_core.ultrasound.detection.seen_scans import NOT_SEEN, spread

CAPTURES = {"first": "scan", "second": "second", "hand": "sono_scan"}
DETECTIONS = {"first": "detection", "second": "second_detection", "hand": "sono_detection"}

_SPREAD: Memo[Detection | None] = Memo(4)


def scans_of(session: Session, scan: ScanName) -> AScanTrack | None:
    """Return the A-scans of the first pass, of all further ones or by hand; None before them."""
    held: ScanCapture | SonoCapture | Passes | None = session.captures.get(CAPTURES[scan])
    if isinstance(held, tuple):
        return joined_scans(held) if held else None
    return None if held is None else held.scans


def detection_of_scan(session: Session, scan: ScanName = "first") -> Detection | None:
    """Return what was detected in a pass, with what was set by hand in its place.

    None where nothing was, or where the A-scans were taken again since. Of a scan by hand all
    A-scans are there; where the tracker did not see the probe, nothing counts.
    """
    derived = session.results.get(DETECTIONS[scan])
    capture = session.captures.get(CAPTURES[scan])
    if derived is None or not capture or not made_of(derived, "capture", capture):
        return None
    found: Detection | None = derived.value
    if isinstance(capture, SonoCapture):
        posed = required(POSED, session)
        found = _SPREAD.get((derived.value, posed), lambda: spread(derived.value, posed.known))
    if found is None:
        return None  # of other A-scans: the delay of the tracker is another one now
    probe = required(HELD_PROBE, session) if scan == "hand" else required(ROBOT_PROBE, session)
    return corrected(found, session.boundary_edits, scan, probe)


def correct_boundary(message: CorrectBoundary, session: Session) -> Session:
    """Carry out `CorrectBoundary`."""
    track = scans_of(session, message.scan)
    if track is None:
        raise StepBlockedError(f"first {REGISTRY.captures[CAPTURES[message.scan]].wanted}")
    n, edit = len(track), message.edit()
    if message.number >= n:
        raise InvalidInputError(f"there are {n} A-scans, numbered from 0: not {message.number}")
    found = detection_of_scan(session, message.scan)
    if found is None:
        raise StepBlockedError("first map the boundaries (step 9)")
    if message.scan == "second" and edit.boundary == "outer":
        raise InvalidInputError(
            "the outer boundary of a further pass is that of the map of the first: correct it "
            "in the first pass"
        )
    if found.flag[message.number] == NOT_SEEN:
        raise InvalidInputError(
            f"the tracker did not see the probe at A-scan {message.number}: it is in no map"
        )
    end_us = track.start_us + track.rf.shape[1] / track.sampling_mhz
    if edit.time_us is not None and not track.start_us <= edit.time_us <= end_us:
        raise InvalidInputError(
            f"the A-scan lasts from {track.start_us:.2f} to {end_us:.2f} µs: "
            f"{edit.time_us:.2f} µs is not in it"
        )
    after = replace(session, boundary_edits=session.boundary_edits.put(edit))
    _require_order(after, message.scan, message.number, edit.time_us is not None)
    return after


def _require_order(session: Session, scan: ScanName, i: int, placed: bool) -> None:
    """Raise InvalidInputError where an inner boundary lies above the outer one, or alone."""
    found = detection_of_scan(session, scan)
    if found is None or not placed:
        return
    mine = session.boundary_edits.of(scan, "inner").changes
    by_hand = any(edit.number == i and edit.time_us is not None for edit in mine)
    if by_hand and scan != "second" and not found.outer_ok[i]:
        raise InvalidInputError(
            f"A-scan {i} has no outer boundary to count bone from: set that first"
        )
    if (by_hand or found.inner_ok[i]) and not found.inner_us[i] > found.outer_us[i]:
        raise InvalidInputError(
            f"the inner boundary lies behind the outer one: {found.inner_us[i]:.2f} µs is not "
            f"later than {found.outer_us[i]:.2f} µs"
        )


def clear_boundary_corrections(message: ClearBoundaryCorrections, session: Session) -> Session:
    """Carry out `ClearBoundaryCorrections`."""
    if message.scan is None:
        return replace(session, boundary_edits=BoundaryEdits())
    left = session.boundary_edits.without(message.scan, message.number)
    return replace(session, boundary_edits=left)


STEP = declare.Step(
    "boundaries",
    commands=(
        declare.Command(CorrectBoundary, correct_boundary, done="a boundary was corrected by hand"),
        declare.Command(
            ClearBoundaryCorrections,
            clear_boundary_corrections,
            done="the corrections of boundaries were removed",
        ),
    ),
)
