"""Step 9 by hand: corrected boundaries go into the maps, are undone, saved and reproduced."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.messages.message import StoreCapture
from rona_core.app.runtime.handling import derive_all, handle
from rona_core.app.runtime.session_step import Undo
from rona_core.app.runtime.store import Store
from rona_core.app.steps.acoustics.derivation import KNOWN_SPEED, with_known_speed
from rona_core.app.steps.boundaries.ascan_view import (
    ascan_plot,
    scan_number_at,
    scan_poses,
    share_of_scan,
)
from rona_core.app.steps.boundaries.messages import ClearBoundaryCorrections, CorrectBoundary
from rona_core.app.steps.boundaries.step import detection_of_scan
from rona_core.app.steps.maps.messages import StartMapping
from rona_core.app.steps.maps.view import second_cells, second_view
from rona_core.app.steps.scan.planned_motion import joints_at, plan_of
from rona_core.errors import InvalidInputError, StepBlockedError
from rona_core.mapping.build_maps import boundary_points
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.codec import digest
from rona_core.session.document import Session
from rona_core.ultrasound.acoustic_calibration.speed_calibration import speed_at
from tests.helpers.session_file import reopened

TESTS = Path(__file__).resolve().parents[2]


def sure(session: Session) -> int:
    """Return the number of an A-scan with both boundaries."""
    return int(np.flatnonzero(session.results.detection.value.flag == 0)[20])


def test_a_correction_makes_the_maps_stale_and_keeps_what_was_detected(demo):
    i = sure(demo)
    at_us = float(demo.results.detection.value.inner_us[i]) + 0.7
    after = handle(CorrectBoundary(i, inner_us=at_us), demo)
    assert after.results is demo.results
    assert stale_reason("detection", after) is None
    assert "correction of boundaries by hand (step 9) was changed" in (
        stale_reason("maps", after) or ""
    )
    assert detection_of_scan(after).inner_us[i] == at_us
    assert after.results.detection.value.inner_us[i] == at_us - 0.7
    plot = ascan_plot(after, i)
    assert plot.by_hand
    assert plot.inner_us == at_us
    assert "set by hand" in plot.remark


def test_only_an_outer_boundary_makes_the_second_pass_detect_again(demo):
    i = sure(demo)
    found = demo.results.detection.value
    inner = handle(CorrectBoundary(i, inner_us=float(found.inner_us[i]) + 0.3), demo)
    outer = handle(CorrectBoundary(i, outer_us=float(found.outer_us[i]) + 0.01), demo)
    assert stale_reason("second_detection", inner) is None
    assert stale_reason("second_detection", outer) is not None


def test_the_maps_take_the_corrected_boundary_and_nothing_is_detected_twice(demo):
    i, found = sure(demo), demo.results.detection.value
    after = handle(CorrectBoundary(i, inner_us=float(found.inner_us[i]) + 0.5), demo)
    mapped = derive_all(after, StartMapping())
    assert mapped["detection"] is found
    assert mapped["second_detection"] is demo.results.second_detection.value
    before = demo.results.maps.value
    moved = mapped["maps"].inner_points_base - before.inner_points_base
    axis = scan_poses(demo)[i].rotation[:, 2]
    speed = speed_at(demo.results.speed.value, scan_poses(demo).translations[i : i + 1])[0][0]
    np.testing.assert_allclose(moved[i], 0.5 * speed / 2 * axis, atol=0.01)
    # the others move with the offset of their pass, which one A-scan hardly changes
    assert np.abs(np.delete(moved, i, axis=0)).max() < 0.01
    corrected = with_known_speed(
        detection_of_scan(after), scan_poses(after), KNOWN_SPEED.read(after), None
    )
    expected = boundary_points(corrected, scan_poses(after))[1]
    late = mapped["maps"].inner_points_base[: len(found)] - expected
    assert np.linalg.norm(late, axis=1).max() < 0.2  # the curvature of the bone, alike for all


@pytest.mark.slow
def test_a_boundary_that_was_taken_away_is_not_mapped(demo):
    i = int(np.flatnonzero(demo.results.maps.value.inner_used)[30])
    mapped = derive_all(handle(CorrectBoundary(i, remove="inner"), demo), StartMapping())
    assert not mapped["maps"].inner_used[i]


def test_corrections_are_undone_saved_and_loaded(demo):
    store, i = Store(demo), sure(demo)
    at_us = float(demo.results.detection.value.inner_us[i]) + 0.2
    store.dispatch(CorrectBoundary(i, inner_us=at_us))
    changed = store.session
    store.dispatch(CorrectBoundary(i + 1, remove="outer"))
    store.dispatch(Undo())
    assert digest(store.session.boundary_edits) == digest(changed.boundary_edits)
    loaded = reopened(changed)
    assert loaded.boundary_edits == changed.boundary_edits
    store.dispatch(ClearBoundaryCorrections())
    assert len(store.session.boundary_edits) == 0
    assert stale_reason("maps", store.session) is None
    store.close()


def test_corrections_of_one_a_scan_are_forgotten_alone(demo):
    i = sure(demo)
    two = handle(
        CorrectBoundary(i + 1, remove="outer"), handle(CorrectBoundary(i, remove="inner"), demo)
    )
    left = handle(ClearBoundaryCorrections("first", i), two)
    assert [edit.number for edit in left.boundary_edits.changes] == [i + 1]


def test_a_new_scan_forgets_the_corrections_of_the_old_one(demo):
    both = handle(
        CorrectBoundary(2, "second", remove="inner"),
        handle(CorrectBoundary(1, remove="inner"), demo),
    )
    taken = demo.captures.second[0]
    again = handle(StoreCapture("second", replace(taken)), both)
    assert [edit.scan for edit in again.boundary_edits.changes] == ["first", "second"]
    other = replace(taken, setup_digest="another")
    stale = both.with_capture("second", (other,))
    replaced = handle(StoreCapture("second", taken), stale)
    assert replaced.captures.second == (taken,)
    assert [edit.scan for edit in replaced.boundary_edits.changes] == ["first"]
    assert len(handle(StoreCapture("scan", replace(demo.captures.scan)), both).boundary_edits) == 0


def test_what_cannot_be_corrected_is_refused(demo):
    i, found = sure(demo), demo.results.detection.value
    with pytest.raises(InvalidInputError, match="there are"):
        handle(CorrectBoundary(len(found), remove="inner"), demo)
    with pytest.raises(InvalidInputError, match="is not in it"):
        handle(CorrectBoundary(i, inner_us=3.0), demo)
    with pytest.raises(InvalidInputError, match="lies behind the outer one"):
        handle(CorrectBoundary(i, inner_us=float(found.outer_us[i]) - 0.1), demo)
    with pytest.raises(InvalidInputError, match="correct it in the first pass"):
        handle(CorrectBoundary(1, "second", outer_us=20.0), demo)
    gone = handle(CorrectBoundary(i, remove="outer"), demo)
    with pytest.raises(InvalidInputError, match="set that first"):
        handle(CorrectBoundary(i, inner_us=float(found.inner_us[i])), gone)
    with pytest.raises(StepBlockedError, match="first scan"):
        handle(CorrectBoundary(0, remove="inner"), Session())
    bare = replace(demo, results=replace(demo.results, detection=None))
    with pytest.raises(StepBlockedError, match="first map the boundaries"):
        handle(CorrectBoundary(0, remove="inner"), bare)


@pytest.mark.parametrize(
    "fields", [{}, {"outer_us": 16.0, "remove": "inner"}, {"inner_us": float("nan")}]
)
def test_a_correction_says_one_thing(fields):
    with pytest.raises(InvalidInputError):
        CorrectBoundary(0, **fields)


@pytest.mark.parametrize("scan", ["first", "second"])
def test_every_a_scan_is_found_again_from_its_share_of_the_motion(demo, scan):
    n = len(demo.captures.scan.scans if scan == "first" else demo.captures.second[0].scans)
    for i in range(0, n, 7):
        share = share_of_scan(demo, i, scan)
        assert scan_number_at(demo, share, scan) == i


@pytest.mark.parametrize("scan", ["first", "second"])
def test_the_planned_motion_brings_the_probe_to_where_the_a_scan_was_taken(demo, scan):
    second = scan == "second"
    model = robot_model(plan_of(demo, second=second).model)
    poses = scan_poses(demo, scan)
    for i in range(3, len(poses), 40):
        q_rad = joints_at(demo, share_of_scan(demo, i, scan), second=second)
        planned = (model.forward(q_rad[None]) @ model.T_flange_probe)[0]
        # pressing on moves it along its axis alone; the two clocks agree to a fraction of a step
        off = poses[i].translation - planned.translation
        aside = off - (off @ planned.rotation[:, 2]) * planned.rotation[:, 2]
        assert np.linalg.norm(aside) < 1.0


@pytest.mark.slow
def test_the_second_pass_says_what_it_brought(demo):
    view, cells = second_view(demo), second_cells(demo)
    maps = demo.results.maps.value
    assert view.blocked is None
    assert view.length_mm == pytest.approx(demo.results.second.value.way.path.arc_length_mm()[-1])
    assert 0.0 < cells.before < cells.after <= 1.0
    assert cells.after == pytest.approx((maps.outer.ok & maps.inner.ok).sum() / maps.outer.ok.sum())
    n = len(demo.results.detection.value)
    used = maps.inner_points_base[n:][maps.inner_used[n:]]
    gaps = [np.linalg.norm(used - cell, axis=1).min() for cell in cells.points_base]
    assert max(gaps) < 5.0  # a sample of a tilted pass lies beside each of them
    alone = derive_all(demo.with_capture("second", ()), StartMapping())["maps"]
    lost = maps.inner.ok.sum() - alone.inner.ok.sum()
    assert len(cells.points_base) == pytest.approx(int(lost), abs=0.03 * maps.outer.ok.sum())
