"""Further passes add up: stored, detected, mapped, planned and replayed one after the other."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree

from rona_core.app.dependencies.staleness import required, stale_reason
from rona_core.app.messages.message import StoreCapture
from rona_core.app.runtime.handling import derive_again, derive_all, handle
from rona_core.app.steps.boundaries.ascan_view import (
    ascan_plot,
    scan_number_at,
    scan_picture,
    scan_poses,
    share_of_scan,
)
from rona_core.app.steps.boundaries.handlers import scans_of
from rona_core.app.steps.boundaries.messages import CorrectBoundary
from rona_core.app.steps.maps.accuracy import map_accuracy
from rona_core.app.steps.maps.error_budget import error_budgets
from rona_core.app.steps.maps.further_passes import (
    joined_poses,
    joined_scans,
    usable_second,
)
from rona_core.app.steps.maps.messages import StartGapPlan, StartMapping
from rona_core.app.steps.maps.view import second_cells, second_view
from rona_core.app.steps.scan.derivation import PLACES
from rona_core.app.steps.scan.planned_motion import joints_at, motion_times, replayed
from rona_core.app.steps.scan.view import head_report
from rona_core.devices.protocols import never, silent
from rona_core.devices.samples import AScanTrack
from rona_core.errors import InvalidInputError, StepBlockedError
from rona_core.evaluation.truth import scan_postures
from rona_core.geometry.arrays import readonly
from rona_core.geometry.pose import Poses
from rona_core.mapping.accuracy.probe_place import OTHER_POSTURE
from rona_core.mapping.second_pass import standoffs_mm
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.link_errors import alike
from rona_core.robot.redundancy.scan_postures import with_other_roll
from rona_core.session.codec import digest
from rona_core.session.files import load_session, session_bytes, session_from_bytes
from tests.app.maps.further import half_of, mapped_again
from tests.helpers.derived import derived

SMALL = Path(__file__).parents[2] / "sessions" / "whole.rona"


@pytest.fixture(scope="module")
def small():
    return load_session(SMALL)


@pytest.fixture(scope="module")
def two(small):
    """Return a small session with the first half of its second pass once more, stopped there."""
    part = replace(half_of(small.captures.second[0]), partial=True, ordinal=77)
    return handle(StoreCapture("second", part), small)


@pytest.fixture(scope="module")
def mapped(two):
    return mapped_again(two)


def test_a_pass_that_was_stopped_adds_to_the_one_before(small, two):
    (whole,) = small.captures.second
    assert two.captures.second[0] is whole
    assert [one.ordinal for one in two.captures.second] == [whole.ordinal, 77]
    assert usable_second(two) == two.captures.second
    assert stale_reason("second_detection", two) is not None
    assert stale_reason("maps", two) is not None
    assert stale_reason("second", two) is None  # planned, and may be driven again


def test_passes_of_another_scan_give_way(two):
    other = replace(two.captures.second[0], setup_digest="of another set-up")
    stale = two.with_capture("second", (other, two.captures.second[1]))
    assert usable_second(stale) == ()
    kept = handle(StoreCapture("second", two.captures.second[0]), stale)
    assert kept.captures.second == two.captures.second[:1]


def test_each_pass_has_its_own_poses_and_its_own_place_in_detection_and_maps(small, two, mapped):
    whole, part = two.captures.second
    n, m = len(whole.scans), len(part.scans)
    poses = joined_poses(required(PLACES, two), two.captures.second)
    alone = joined_poses(required(PLACES, small), small.captures.second)
    np.testing.assert_array_equal(poses.translations[:n], alone.translations)
    np.testing.assert_array_equal(poses.translations[n:], alone.translations[:m])
    found = mapped.results.second_detection.value
    first = len(mapped.results.detection.value)
    assert len(found) == n + m
    assert len(mapped.results.maps.value.inner_used) == first + n + m
    np.testing.assert_allclose(found.standoff_mm[n:], found.standoff_mm[:m], atol=1e-9)
    assert mapped.results.maps.value.inner_used[first + n :].any()
    assert second_cells(mapped) is not None
    assert second_cells(two) is None  # not yet in the maps


def test_the_head_is_followed_in_each_pass(two):
    watched = [shift.capture for shift in head_report(two).shifts]
    assert watched.count("second") == 2


def test_further_passes_count_from_where_the_first_one_heard_the_bone(mapped):
    """Curved bone is heard too late: what is corrected in the map is not in the echoes."""
    poses = joined_poses(required(PLACES, mapped), mapped.captures.second)
    known = mapped.results.second_detection.value.standoff_mm
    late = known - standoffs_mm(mapped.results.maps.value.outer, poses)
    assert np.ptp(late) < 1e-9
    assert 0.005 < late[0] < 0.05


def test_a_boundary_of_a_later_pass_is_corrected_by_its_number_in_all_of_them(small, mapped):
    n = len(small.captures.second[0].scans)
    found = mapped.results.second_detection.value
    i = n + int(np.flatnonzero(found.inner_ok[n:])[0])
    edited = handle(CorrectBoundary(i, "second", remove="inner"), mapped)
    again = derive_all(edited, StartMapping())
    assert again["second_detection"] is found  # what was detected is kept
    first = len(mapped.results.detection.value)
    assert mapped.results.maps.value.inner_used[first + i]
    assert not again["maps"].inner_used[first + i]


def test_a_pass_is_planned_over_the_gaps_that_all_before_left(small):
    cut = small.with_capture("second", (half_of(small.captures.second[0]),))
    planned = derived("second", cut, StartGapPlan())
    before = small.results.second.value
    assert (before.n_before, planned.n_before) == (0, 1)
    assert 6 <= planned.way.gap_cells < 0.7 * before.way.gap_cells
    held = cut.with_result("second", replace(small.results.second, value=planned))
    assert not second_view(held).scanned
    after = handle(StoreCapture("second", half_of(small.captures.second[0])), held)
    assert second_view(after).scanned
    again = derive_again(
        "second", after, replace(after.results.second, arguments={}), silent, never
    )
    assert digest(again) == digest(planned)


def test_without_a_gap_that_is_left_there_is_nothing_to_plan(small):
    with pytest.raises(StepBlockedError, match="no gap is left"):
        derived("second", small, StartGapPlan())


@pytest.fixture(scope="module")
def planned_on(two):
    """Return two passes and a plan that was made between them, and one pass more than planned."""
    plan = replace(two.results.second.value, n_before=1)
    return two.with_result("second", replace(two.results.second, value=plan))


def test_the_replay_runs_through_all_passes(small, planned_on):
    before, after = planned_on.captures.second
    motion = replayed(planned_on, second=True)
    n, duration_s = len(before.scans), motion_times(small, second=True)[0]
    reported_s = float(before.joints.times_s[-1] - before.joints.times_s[0])
    assert motion.times_s[-1] == pytest.approx(reported_s + duration_s)
    assert len(motion.fired_s) == n + len(after.scans)
    assert (np.diff(motion.fired_s) > 0.0).all()
    assert (np.diff(motion.times_s) >= 0.0).all()
    for i in (0, n - 1):  # as the robot reported them
        share = share_of_scan(planned_on, i, "second")
        reported = before.joints.at(before.scans.times_s[i : i + 1])[0]
        np.testing.assert_allclose(joints_at(planned_on, share, second=True), reported, atol=1e-9)
    for i in (n, n + len(after.scans) - 1):  # as it was planned
        share = share_of_scan(planned_on, i, "second")
        alone = joints_at(small, share_of_scan(small, i - n, "second"), second=True)
        np.testing.assert_allclose(joints_at(planned_on, share, second=True), alone, atol=1e-9)


def test_every_a_scan_of_all_passes_is_reached_by_the_cursor_and_shown(planned_on):
    track = scans_of(planned_on, "second")
    assert len(scan_picture(planned_on, "second")) == len(track)
    assert len(scan_poses(planned_on, "second")) == len(track)
    for i in range(0, len(track), 29):
        assert scan_number_at(planned_on, share_of_scan(planned_on, i, "second"), "second") == i
        assert f"A-scan {i + 1} of {len(track)}" in ascan_plot(planned_on, i, scan="second").remark


def test_a_pass_that_is_planned_and_not_scanned_is_the_last_motion(small):
    plan = replace(small.results.second.value, n_before=1)
    waiting = small.with_result("second", replace(small.results.second, value=plan))
    motion = replayed(waiting, second=True)
    assert len(motion.fired_s) == len(small.captures.second[0].scans)
    assert motion.end_s > motion.fired_s[-1]
    q_rad = joints_at(waiting, 1.0, second=True)
    np.testing.assert_allclose(q_rad, plan.plan.trajectory.qs_rad[-1])


def test_a_file_keeps_all_passes(mapped):
    back = session_from_bytes(session_bytes(mapped))
    assert [digest(one) for one in back.captures.second] == [
        digest(one) for one in mapped.captures.second
    ]
    assert stale_reason("maps", back) is None


def test_one_track_and_one_batch_stay_what_they_are(small):
    (one,) = small.captures.second
    assert joined_scans((one,)) is one.scans
    poses = scan_poses(small, "second")
    assert Poses.joined([poses]) is poses


def test_tracks_that_are_sampled_differently_are_not_joined(small):
    track = small.captures.second[0].scans
    with pytest.raises(InvalidInputError, match="sampled differently"):
        AScanTrack.joined([track, replace(track, start_us=track.start_us + 1.0)])


def postures_of(capture):
    return capture.joints.at(capture.scans.times_s)


def in_another_posture(capture):
    """Return a pass as if it had reached the same places with another roll."""
    found = with_other_roll(robot_model("rx90"), capture.joints.qs_rad)
    return replace(capture, joints=replace(capture.joints, qs_rad=readonly(found[1])))


def test_a_further_pass_is_planned_in_the_posture_of_the_scan(small):
    scan = in_another_posture(small.captures.scan)
    for session in (small, small.with_capture("scan", scan)):
        alone = session.with_capture("second", ())
        planned = derived("second", alone, StartGapPlan()).plan.trajectory
        start, end = planned.scan_start_s, planned.scan_end_s
        found = planned.qs_rad[(planned.times_s >= start) & (planned.times_s <= end)]
        model = robot_model("rx90")
        faces = (model.forward(found) @ model.T_flange_probe).translations
        assert alike(found, scan_postures(session).at(faces)).all()
    assert not alike(postures_of(scan), postures_of(small.captures.scan)).any()


def test_maps_say_what_another_posture_in_a_further_pass_does_to_them(small):
    (again,) = small.captures.second
    turned = small.with_capture("second", (in_another_posture(again),))
    before, after = map_accuracy(small), map_accuracy(turned)
    causes = {row.cause for row in after.thickness.budget}
    lines = {line.title: line.predicted_mm for line in error_budgets(after, {})[1].lines}
    held = {row.cause: row for row in after.thickness.budget}
    assert OTHER_POSTURE in causes - {row.cause for row in before.thickness.budget}
    assert lines["Another posture in a further pass"] == held[OTHER_POSTURE].sigma_mm
    assert 0.02 < held[OTHER_POSTURE].sigma_mm < 0.3
    assert not held[OTHER_POSTURE].of_robot
    np.testing.assert_array_equal(before.outer.own_mm, after.outer.own_mm)
    maps, n = small.results.maps.value, len(small.captures.scan.scans.times_s)
    places = (maps.inner.T_base_map.inv() @ maps.outer_points_base)[:, :2]
    cells = np.stack(np.meshgrid(maps.inner.u_mm, maps.inner.v_mm, indexing="ij"), axis=-1)
    first, further = (
        KDTree(places[part][maps.inner_used[part]]).query(cells)[0]
        for part in (slice(None, n), slice(n, None))
    )
    grown = after.inner.same_robot_mm() > before.inner.same_robot_mm()
    assert grown[further < first].all()
    assert not grown[further > first].any()
    assert (further > first).any()
    later = turned.with_capture("second", (*turned.captures.second, again))  # not mapped yet
    np.testing.assert_array_equal(map_accuracy(later).inner.shared_mm, after.inner.shared_mm)


def test_the_robot_comes_back_as_it_came_first(small):
    assert scan_postures(small) is not None
    np.testing.assert_array_equal(scan_postures(small).qs_rad, postures_of(small.captures.scan))
    assert scan_postures(small.with_capture("scan", None)) is None
