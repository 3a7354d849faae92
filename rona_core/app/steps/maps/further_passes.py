"""Further passes of step 9: they add up, and their A-scans count one pass after the other."""

from dataclasses import replace

from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.steps.scan.derivation import ProbePlaces
from rona_core.devices.samples import AScanTrack
from rona_core.geometry.pose import Poses
from rona_core.session.captures import ScanCapture
from rona_core.session.document import Session
from rona_core.session.memo import remember

Passes = tuple[ScanCapture, ...]


def usable_second(session: Session) -> Passes:
    """Return the further passes; none where they are of another scan or set-up."""
    held = session.captures.second
    return () if not held or stale_reason("capture second", session) else held


def with_pass(session: Session, capture: ScanCapture, append: bool) -> object:
    """Return the further passes with one more; it replaces those of another scan or set-up.

    Each adds to what is there: that message knows no ``append``.
    """
    return (*usable_second(session), capture)


def forget_corrections(before: Session, after: Session) -> Session:
    """Return ``after`` without corrections of boundaries in passes that were replaced.

    Corrections name A-scans by their numbers, which a pass that adds to others leaves as they were.
    """
    if len(after.captures.second) > len(before.captures.second):
        return after
    return replace(after, boundary_edits=before.boundary_edits.without("second"))


@remember(4)  # what is made of the A-scans is remembered by their identity
def joined_scans(passes: Passes) -> AScanTrack:
    """Return the A-scans of at least one pass, one pass after the other."""
    return AScanTrack.joined([one.scans for one in passes])


def joined_poses(places: ProbePlaces, passes: Passes) -> Poses:
    """Return the pose of the probe in ``base`` at each A-scan of at least one pass.

    Each pass has its own joint angles, clock and motion of the head.
    """
    return _joined(tuple(places.poses(one) for one in passes))


@remember(4)
def _joined(parts: tuple[Poses, ...]) -> Poses:
    return Poses.joined(parts)
