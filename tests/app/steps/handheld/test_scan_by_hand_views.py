"""The A-scans of a scan by hand: looked at, corrected and mapped again like the robot's."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.app.dependencies.staleness import required, stale_reason
from rona_core.app.messages.message import StoreCapture
from rona_core.app.runtime.handling import handle
from rona_core.app.runtime.session_step import replay
from rona_core.app.steps.boundaries.ascan_view import (
    ascan_plot,
    scan_marks,
    scan_number_at,
    scan_picture,
    scan_poses,
    share_of_scan,
)
from rona_core.app.steps.boundaries.messages import ClearBoundaryCorrections, CorrectBoundary
from rona_core.app.steps.boundaries.step import detection_of_scan
from rona_core.app.steps.handheld.derivation import POSED
from rona_core.app.steps.handheld.messages import (
    StartHandheldCalibration,
    StartHandheldMapping,
    StartHandheldScan,
)
from rona_core.app.steps.maps.inputs import HAND_TERMS, map_accuracy
from rona_core.compose import new_workbench
from rona_core.devices.trackers import ACCURACY_MM
from rona_core.errors import InvalidInputError, StepBlockedError
from rona_core.session.codec import digest
from rona_core.session.document import Session
from rona_core.ultrasound.detection.detect import NOMINAL_SPEED_MM_PER_US
from rona_core.ultrasound.detection.seen_scans import NOT_SEEN, gathered, spread
from tests.helpers.recordings import track_rows

GAP = slice(40, 70)  # A-scans at which the tracker does not see the probe


@pytest.fixture(scope="module")
def bench():
    made = new_workbench(Session())
    quick = StartHandheldScan(duration_s=11.0, rate_hz=20.0, spacing_mm=5.5)
    for activity in (StartHandheldCalibration(pivot_s=8.0, spin_s=8.0), quick):
        made.run(activity)
    capture = made.session.captures.sono_scan
    first, last = capture.scans.times_s[[GAP.start, GAP.stop - 1]]
    track = capture.marker
    seen = (track.times_s < first - 0.03) | (track.times_s > last + 0.03)
    gone = track_rows(track, seen)
    session = handle(StoreCapture("sono_scan", replace(capture, marker=gone)), made.session)
    made.close()
    made = new_workbench(session)
    made.run(StartHandheldMapping())
    yield made
    made.close()


@pytest.fixture
def session(bench):
    return bench.session


def sure(session):
    """Return the number of an A-scan behind the gap with both boundaries."""
    found = detection_of_scan(session, "hand")
    return int(next(i for i in np.flatnonzero(found.inner_ok) if i > GAP.stop))


def test_what_was_found_stands_at_the_numbers_of_the_capture(session):
    capture, held = session.captures.sono_scan, session.results.sono_detection.value
    known = required(POSED, session).known
    assert not known[GAP].any()
    assert len(held) == known.sum() < len(capture.scans)
    found = detection_of_scan(session, "hand")
    assert len(found) == len(capture.scans)
    assert (found.flag[~known] == NOT_SEEN).all()
    assert not found.outer_ok[~known].any()
    np.testing.assert_array_equal(found.inner_us[known], held.inner_us)
    assert digest(gathered(found, known)) == digest(held)
    assert spread(held, known[:-1] if known[-1] else known[1:]) is None


def test_image_graph_and_places_have_all_ascans(session):
    n = len(session.captures.sono_scan.scans)
    picture, marks = scan_picture(session, "hand"), scan_marks(session, "hand")
    poses = scan_poses(session, "hand")
    assert len(picture) == len(marks.flagged) == len(poses) == n
    assert picture.image.level_db.shape[1] == n
    assert (np.diff(picture.path_mm) >= 0.0).all()
    assert marks.flagged[GAP].all()
    i = sure(session)
    plot = ascan_plot(session, i, scan="hand")
    assert plot.fine
    assert plot.remark.startswith(f"A-scan {i + 1} of {n}: bone ")
    lost = ascan_plot(session, GAP.start + 5, scan="hand")
    assert not lost.fine
    assert "did not see the probe" in lost.remark
    assert lost.inner_us is None
    for k in (0, i, n - 1):
        assert scan_number_at(session, share_of_scan(session, k, "hand"), "hand") == k
    assert share_of_scan(session, n, "hand") is None


def test_without_a_scan_by_hand_there_is_nothing_to_look_at():
    empty = Session()
    assert scan_picture(empty, "hand") is None
    assert ascan_plot(empty, 0, scan="hand") is None
    assert scan_number_at(empty, 0.5, "hand") is None
    with pytest.raises(StepBlockedError, match="scan by hand"):
        handle(CorrectBoundary(0, "hand", inner_us=20.0), empty)


def test_the_maps_by_hand_are_as_sure_as_tracker_and_face(session):
    made, found = session.results.sono_maps.value, map_accuracy(session, hand=True)
    for part, boundary in ((found.outer, made.maps.outer), (found.inner, made.maps.inner)):
        assert np.isfinite(part.total_mm()).all()
        assert part.total_mm().shape == boundary.height_mm.shape
    tracker = ACCURACY_MM[session.setup.devices.tracker.profile]
    # the registration, which holds tracker and robot, takes the place of the base marker
    second = tracker
    if made.frame == "base":
        second = session.results.tool.value.registration_sigma_mm
    squares = tracker**2 + second**2 + session.results.sono.value.face_sigma_mm**2
    np.testing.assert_allclose(found.outer.robot_shared_mm, np.sqrt(squares / 3.0))
    assert not found.thickness.robot_shared_mm.any()
    other = replace(session, results=replace(session.results, sono_detection=None))
    assert map_accuracy(other, hand=True) is None


def test_how_a_hand_tilts_the_probe_makes_no_bone_rough(session):
    rough = HAND_TERMS.read(session).rough.own_mm
    assert np.ptp(session.results.sono_detection.value.outer_quality) > 0.1
    assert np.ptp(rough) < 1e-9
    assert rough.min() > 0.0


def test_a_correction_makes_the_maps_by_hand_stale_and_goes_into_them(bench):
    session, i = bench.session, sure(bench.session)
    at_us = float(detection_of_scan(session, "hand").inner_us[i]) + 0.5
    before = session.results.sono_maps.value.maps
    bench.dispatch(CorrectBoundary(i, "hand", inner_us=at_us))
    assert "correction of boundaries by hand" in stale_reason("sono_maps", bench.session)
    assert stale_reason("sono_detection", bench.session) is None
    assert ascan_plot(bench.session, i, scan="hand").inner_us == at_us
    assert ascan_plot(bench.session, i, scan="hand").by_hand
    bench.run(StartHandheldMapping())
    after = bench.session.results.sono_maps.value.maps
    assert stale_reason("sono_maps", bench.session) is None
    moved = np.linalg.norm(after.inner_points_base - before.inner_points_base, axis=1)
    assert np.flatnonzero(moved > 1e-6).tolist() == [
        int(np.count_nonzero(required(POSED, session).known[:i]))
    ]
    assert moved.max() == pytest.approx(0.5 * NOMINAL_SPEED_MM_PER_US / 2.0, rel=1e-6)
    assert all(row.same for row in replay(bench.session))
    bench.dispatch(ClearBoundaryCorrections("hand", i))
    assert stale_reason("sono_maps", bench.session) is not None
    bench.run(StartHandheldMapping())
    assert digest(bench.session.results.sono_maps.value.maps) == digest(before)


def test_what_cannot_be_corrected_is_refused(session):
    n, i = len(session.captures.sono_scan.scans), sure(session)
    with pytest.raises(InvalidInputError, match="did not see the probe"):
        handle(CorrectBoundary(GAP.start + 5, "hand", inner_us=25.0), session)
    with pytest.raises(InvalidInputError, match=f"there are {n} A-scans"):
        handle(CorrectBoundary(n, "hand", inner_us=25.0), session)
    front_us = float(detection_of_scan(session, "hand").outer_us[i])
    with pytest.raises(InvalidInputError, match="behind the outer"):
        handle(CorrectBoundary(i, "hand", inner_us=front_us - 1.0), session)


def test_the_outer_boundary_by_hand_takes_the_inner_one_with_it(session):
    i = sure(session)
    after = detection_of_scan(handle(CorrectBoundary(i, "hand", remove="outer"), session), "hand")
    assert not after.outer_ok[i]
    assert not after.inner_ok[i]


def test_corrections_of_each_scan_go_with_that_scan_alone(session):
    i = sure(session)
    at_us = float(detection_of_scan(session, "hand").inner_us[i]) + 0.1
    edited = handle(CorrectBoundary(i, "hand", inner_us=at_us), session)
    robot = StoreCapture("scan", session.captures.sono_scan)  # any capture will do here
    assert len(handle(robot, edited).boundary_edits) == 1, "the robot's scan is another one"
    again = handle(StoreCapture("sono_scan", session.captures.sono_scan), edited)
    assert len(again.boundary_edits) == 0
