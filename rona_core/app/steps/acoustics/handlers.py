"""What the messages about sound do to a session; imported so that its handlers are registered."""

from dataclasses import replace

import numpy as np

from rona_core.app.dependencies.capture_setup import capture_setup_digest
from rona_core.app.dependencies.inputs import require_result
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.runtime.handling import compute_result
from rona_core.app.steps.acoustics.derivation import entry_points, require_point
from rona_core.app.steps.acoustics.messages import (
    MAX_POINTS,
    AddReferencePoint,
    CalibrateDelayLine,
    RemoveReferencePoint,
)
from rona_core.errors import InvalidInputError, StepBlockedError
from rona_core.geometry.arrays import readonly
from rona_core.session.captures import ReferenceCapture
from rona_core.session.document import Session


def add_reference_point(message: AddReferencePoint, session: Session) -> Session:
    """Carry out `AddReferencePoint`."""
    place = np.array(message.place_base_mm or (0.0, 0.0, 0.0))
    if message.scan is not None:
        detection = require_result(session.results.detection, "map the boundaries (step 9)").value
        if stale_reason("detection", session) is not None:
            raise StepBlockedError("AddReferencePoint is blocked: map the boundaries again first")
        require_point(detection, message.scan)
        place = entry_points(session, detection)[message.scan]
    elif np.abs(place).max() > 1e4:
        raise InvalidInputError("place_base_mm must lie within 10 m of the robot base")
    held = _held(session)
    points = 0 if held is None else len(held.thickness_mm)
    if points >= MAX_POINTS:
        raise InvalidInputError(f"at most {MAX_POINTS} reference points, please")
    one = ReferenceCapture(
        0 if held is None else held.ordinal,
        capture_setup_digest("references", session),
        readonly(place[None, :].astype(np.float64)),
        readonly(np.array([float(message.thickness_mm)])),
        readonly(np.array([float(message.sigma_mm)])),
    )
    return _with(session, one if held is None else joined(held, one))


def remove_reference_point(message: RemoveReferencePoint, session: Session) -> Session:
    """Carry out `RemoveReferencePoint`."""
    held = session.captures.references
    if held is None:
        raise InvalidInputError("there is no reference point to remove")
    n = len(held.thickness_mm)
    if message.index is None or n == 1:
        if message.index not in (None, 0):
            raise InvalidInputError("there is 1 reference point, numbered 0")
        return _with(session, None)
    if message.index >= n:
        raise InvalidInputError(f"there are {n} reference points, numbered from 0")
    kept = np.arange(n) != message.index
    return _with(
        session,
        replace(
            held,
            places_base=readonly(held.places_base[kept]),
            thickness_mm=readonly(held.thickness_mm[kept]),
            sigma_mm=readonly(held.sigma_mm[kept]),
        ),
    )


def calibrate_delay_line(message: CalibrateDelayLine, session: Session) -> Session:
    """Carry out `CalibrateDelayLine`."""
    if message.use:
        return compute_result(message, session)
    return replace(session, results=replace(session.results, line=None))


def place_references(session: Session, capture: ReferenceCapture, append: bool) -> object:
    """Return the reference points after a recording, which replaces the earlier ones or adds."""
    held = _held(session) if append else None
    return capture if held is None else joined(held, capture)


def joined(first: ReferenceCapture, more: ReferenceCapture) -> ReferenceCapture:
    """Return the points of both."""
    return ReferenceCapture(
        more.ordinal,
        more.setup_digest,
        readonly(np.vstack((first.places_base, more.places_base))),
        readonly(np.concatenate((first.thickness_mm, more.thickness_mm))),
        readonly(np.concatenate((first.sigma_mm, more.sigma_mm))),
    )


def _held(session: Session) -> ReferenceCapture | None:
    """Return the points so far; those of another head are left behind."""
    held = session.captures.references
    return None if held is None or stale_reason("capture references", session) else held


def _with(session: Session, references: ReferenceCapture | None) -> Session:
    return replace(session, captures=replace(session.captures, references=references))
