"""A head that moves in its clamp: seen by its marker, led back to step 4, told, or flagged."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.app.dependencies.judge import step_states
from rona_core.app.dependencies.references import watch_head
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.overview.acceptance import quality_rows
from rona_core.app.procedure import run_procedure, stages
from rona_core.app.steps.path.messages import StartPathCapture
from rona_core.app.steps.pointer.messages import StartPointerCapture
from rona_core.app.steps.roll.messages import StartRollSearch
from rona_core.app.steps.scan.derivation import POSES
from rona_core.app.steps.scan.messages import StartScan
from rona_core.app.steps.scan.view import HeadShift, head_report, head_sentence, unwatched
from rona_core.app.steps.setup.messages import (
    MoveTracker,
    SetContact,
    SetRegion,
    SetToolVisible,
    SetWorld,
)
from rona_core.app.steps.surface.messages import StartSurfaceCapture
from rona_core.app.steps.tool.messages import StartToolCapture
from rona_core.compose import build_virtual_rig, new_session, new_workbench
from rona_core.evaluation.truth import head_place_base
from rona_core.session.codec import encode
from tests.helpers.session_file import reopened

STROKE = StartSurfaceCapture(duration_s=20.0)
MESSAGES = (
    StartToolCapture(n_pivot=12, n_translate=4),
    StartPointerCapture(duration_s=6.0),
    STROKE,
    StartPathCapture(duration_s=12.0, spacing_mm=5.0),
    StartRollSearch(n_rolls=24),
)
SMALL = stages("detection", *MESSAGES, skip=("gauge",))
TO_SCAN = stages("scan", *MESSAGES, skip=("gauge",))
BEFORE_SCAN = stages("roll", *MESSAGES)


def made(among, **world):
    """A bench with a small region and a world that is nominal but for its head."""
    bench = new_session("head", seed=12)
    bench.dispatch(SetWorld(profile="nominal", **world))
    bench.dispatch(SetRegion(radius_mm=12.0))
    assert run_procedure(bench, among).failed_step in (None, "scan", "detection")
    return bench


@pytest.fixture(scope="module")
def restless():
    """A head that creeps by up to 0.6 mm and breathes."""
    bench = made(SMALL, head_drift_mm=0.6, breathing_mm=0.05)
    yield bench
    bench.close()


@pytest.fixture(scope="module")
def planned():
    """A head that is at rest, as far as the plan."""
    bench = made(BEFORE_SCAN)
    yield bench
    bench.close()


def without_marker(session):
    """The session as an older version had recorded it."""
    held = session.captures
    return replace(
        session,
        captures=replace(
            held,
            surface=tuple(replace(s, head=None) for s in held.surface),
            path=replace(held.path, head=None),
            scan=replace(held.scan, head=None),
        ),
    )


def true_shift(session):
    """The shift (n, 3) of the head since step 4 at each A-scan."""
    scene, scan = build_virtual_rig(session.setup).scene, session.captures.scan
    rest = head_place_base(session, scene)
    return scene.head_shift_base(scan.ordinal, scan.scans.times_s) - rest


def row(session, key):
    return next(r for r in quality_rows({}, session) if r.key == key)


@pytest.mark.ci
def test_poses_are_led_back_to_where_the_head_lay_in_step_4(restless):
    session = restless.session
    moved = true_shift(session)
    assert np.linalg.norm(moved.mean(axis=0)) > 0.2  # a case that is worth it
    raw = POSES.read(without_marker(session)).translations
    found = raw - POSES.read(session).translations
    assert np.linalg.norm((found - moved).mean(axis=0)) < 0.02
    assert np.sqrt(((found - moved) ** 2).mean()) < 0.05
    figures = restless.figures()
    assert figures["head_shift_error_mm"] < 0.02
    assert figures["outer_same_robot_rms_mm"] < 0.08
    assert figures["surface_tip_3d_rms_mm"] < 0.5


@pytest.mark.ci
def test_what_was_seen_is_told_capture_by_capture(restless):
    session = restless.session
    report = head_report(session)
    assert [s.capture for s in report.shifts] == ["surface", "path", "scan"]
    assert {s.state for s in report.shifts} == {"moved"}
    scan = report.shifts[-1]
    np.testing.assert_allclose(scan.shift_mm, true_shift(session).mean(axis=0), atol=0.03)
    assert 0.0 < np.linalg.norm(scan.sigma_mm) < 0.03
    assert "since step 4" in report.sentence
    assert "corrected" in report.sentence
    assert row(session, "head_motion_mm").verdict == "none"  # asked of the figures, not of these
    figures = restless.figures()
    assert figures["head_motion_mm"] == scan.range_mm
    assert figures["head_shift_mm"] == pytest.approx(np.linalg.norm(scan.shift_mm))
    assert unwatched(session) is None


@pytest.mark.ci
def test_a_head_that_moves_too_far_within_the_scan_does_not_pass(restless):
    rows = quality_rows({"head_motion_mm": 0.6}, restless.session)
    assert next(r for r in rows if r.key == "head_motion_mm").verdict == "fail"


@pytest.mark.ci
def test_saved_and_opened_it_is_the_same_and_older_files_stay_as_they_are(restless):
    session = restless.session
    opened = reopened(session)
    np.testing.assert_array_equal(POSES.read(opened).translations, POSES.read(session).translations)
    assert stale_reason("maps", opened) is None
    older = without_marker(session)
    assert "head" not in encode(older.captures.scan, "scan", {})
    assert head_report(reopened(older)) is None
    assert unwatched(older) is None


@pytest.mark.ci
def test_a_new_reference_makes_stale_what_rests_on_the_old_one(restless):
    bench = new_workbench(restless.session)
    assert stale_reason("path", bench.session) is None
    bench.run(STROKE)
    assert stale_reason("path", bench.session) == (
        "the record of the head marker was changed since the scan path was computed"
    )
    assert stale_reason("detection", bench.session) is not None
    bench.close()


@pytest.mark.slow
def test_at_rest_nothing_changes_by_a_bit(planned):
    bench = new_workbench(planned.session)
    bench.run(StartScan())
    session = bench.session
    report = head_report(session)
    assert {s.state for s in report.shifts} == {"still"}
    assert "has not moved" in report.sentence
    np.testing.assert_array_equal(
        POSES.read(session).translations,
        POSES.read(without_marker(session)).translations,
    )
    bench.close()


@pytest.mark.slow
def test_by_position_alone_the_head_is_watched_too(planned):
    bench = new_workbench(planned.session)
    bench.dispatch(SetContact(pressed=False))
    bench.run(StartScan())
    assert watch_head(bench.session, bench.session.captures.scan).state == "still"
    bench.close()


@pytest.mark.ci
@pytest.mark.sweep(1)
@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (SetToolVisible("headmarker", False), "the head marker was seen in 0 of"),
        (SetToolVisible("basemarker", False), "the base marker was seen in 0 frames"),
        (MoveTracker((30.0, -20.0, 10.0), 1.0), "the tracker was moved since step 4"),
    ],
)
def test_where_nobody_knows_the_scan_is_flagged(planned, message, reason):
    bench = new_workbench(planned.session)
    bench.dispatch(message)
    bench.run(StartScan())
    session = bench.session
    assert unwatched(session).startswith(reason)
    assert head_report(session).sentence.startswith("It is not known whether the head moved")
    flagged = row(session, "head_motion_mm")
    assert flagged.verdict == "review"
    assert flagged.sentence.startswith(f"Head, motion during the scan: {reason}")
    line = next(step for step in step_states(session) if step.name == "scan")
    assert "head not watched" in line.reason
    bench.close()


def test_a_shift_that_rounds_to_nothing_has_no_minus():
    shift = HeadShift("scan", "moved", (-0.0004, 0.012, -0.3), (0.01, 0.01, 0.01), range_mm=0.03)
    assert "(+0.000, +0.012, -0.300 along x, y, z)" in head_sentence(shift)
