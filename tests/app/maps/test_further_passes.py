"""Further passes add up: stored, detected, mapped, planned and replayed one after the other."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree

from rona_core.app.dependencies.judge import judge_part
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
from rona_core.app.steps.boundaries.messages import CorrectBoundary
from rona_core.app.steps.boundaries.step import scans_of
from rona_core.app.steps.maps.error_budget import error_budgets
from rona_core.app.steps.maps.further_passes import all_scanned
from rona_core.app.steps.maps.inputs import map_accuracy
from rona_core.app.steps.maps.messages import StartMapping, StartTiltPlan, StartTiltScan
from rona_core.app.steps.maps.view import second_cells, second_view
from rona_core.app.steps.scan.derivation import PLACES, joined_poses, joined_scans
from rona_core.app.steps.scan.inputs import usable_second
from rona_core.app.steps.scan.planned_motion import joints_at, plan_of, replayed
from rona_core.app.steps.scan.view import head_report
from rona_core.compose import new_workbench
from rona_core.devices.protocols import never, silent
from rona_core.devices.samples import AScanTrack
from rona_core.errors import InvalidInputError, StepBlockedError
from rona_core.evaluation.truth import scan_postures
from rona_core.geometry.arrays import readonly
from rona_core.geometry.pose import Poses
from rona_core.mapping.accuracy.map_terms import BETWEEN_PASSES
from rona_core.mapping.tilted_passes import standoffs_mm
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.link_errors import alike
from rona_core.robot.redundancy.scan_postures import with_other_roll
from rona_core.session.codec import digest
from rona_core.session.files import load_session
from tests.app.maps.further import half_of, mapped_again
from tests.helpers.derived import derived
from tests.helpers.session_file import reopened

SMALL = Path(__file__).parents[2] / "sessions" / "whole.rona"


@pytest.fixture(scope="module")
def bare():
    """Return a small session that was scanned once, and mapped."""
    session = load_session(SMALL).with_result("second", None).with_capture("second", ())
    return ran(session, StartMapping())


@pytest.fixture(scope="module")
def planned(bare):
    """Return it with two tilted passes planned."""
    return ran(bare, StartTiltPlan(passes=2))


def ran(session, message):
    bench = new_workbench(session)
    try:
        bench.run(message)
        return bench.session
    finally:
        bench.close()


@pytest.fixture(scope="module")
def scanned(planned):
    """Return it with one tilted pass scanned, and with both."""
    bench, found = new_workbench(planned), []
    try:
        for _ in range(2):
            bench.run(StartTiltScan())
            found.append(bench.session)
        return tuple(found)
    finally:
        bench.close()


@pytest.fixture(scope="module")
def one(scanned):
    return scanned[0]


@pytest.fixture(scope="module")
def two(scanned):
    return scanned[1]


@pytest.fixture(scope="module")
def mapped(two):
    return mapped_again(two)


def stopped(capture):
    return replace(half_of(capture), partial=True, ordinal=77)


def with_tilted(session, *passes):
    """Return a session that holds other tilted passes."""
    return session.with_capture("second", passes)


def test_passes_that_are_not_scanned_are_missing_and_the_next_one_is_the_remedy(planned, one, two):
    for done, session in enumerate((planned, one)):
        found = judge_part("capture second", session)
        assert found.state == "missing"
        assert found.remedy.message == StartTiltScan()
        if done:
            assert found.reason == "1 of 2 tilted passes are scanned"
            assert "pass 2 of 2" in found.remedy.words
    assert judge_part("capture second", two).holds


def test_where_all_passes_are_scanned_another_one_is_blocked_with_a_reason(two):
    bench = new_workbench(two)
    try:
        with pytest.raises(StepBlockedError, match="all planned passes are scanned"):
            bench.run(StartTiltScan())
        assert bench.session.captures.second is two.captures.second
    finally:
        bench.close()


def test_each_pass_is_scanned_as_it_was_planned(two):
    plan = two.results.second.value
    assert len(plan.passes) == len(two.captures.second) == 2
    assert two.captures.scan.clock_scans is not None
    assert all(one.clock_scans is None for one in two.captures.second), "the delay is known"
    for way, capture in zip(plan.passes, two.captures.second, strict=True):
        poses = joined_poses(required(PLACES, two), (capture,))
        _, nearest = KDTree(way.way.path.points_base).query(poses.translations)
        axes = way.way.path.axes_base[nearest]
        upright = two.results.roll.value.search.path.axes_base[nearest]
        off = np.einsum("ij,ij->i", poses.rotations[:, :, 2], axes)
        assert np.median(off) > np.cos(np.deg2rad(1.0))
        assert np.median(np.einsum("ij,ij->i", axes, upright)) == pytest.approx(
            np.cos(np.deg2rad(5.0)), abs=1e-6
        )


def test_a_pass_that_was_stopped_is_scanned_again_and_takes_its_own_place(one, two):
    first, second = two.captures.second
    part = handle(StoreCapture("second", stopped(second)), one)
    assert [held.ordinal for held in part.captures.second] == [first.ordinal, 77]
    assert usable_second(part) == part.captures.second
    assert stale_reason("second", part) is None
    assert judge_part("capture second", part).reason == "1 of 2 tilted passes are scanned"
    assert (
        part.results.second.value.next_pass(part.captures.second)
        is (part.results.second.value.passes[1])
    )
    whole = handle(StoreCapture("second", second), part)
    assert whole.captures.second == (first, second)
    assert judge_part("capture second", whole).holds


def test_a_first_pass_that_was_stopped_is_scanned_again_first(planned, one):
    part = handle(StoreCapture("second", stopped(one.captures.second[0])), planned)
    plan = part.results.second.value
    assert plan.next_pass(part.captures.second) is plan.passes[0]
    assert plan.scanned(part.captures.second) == 0
    whole = handle(StoreCapture("second", one.captures.second[0]), part)
    assert whole.captures.second == one.captures.second


def test_a_pass_more_makes_what_rests_on_the_passes_stale(mapped):
    before = with_tilted(mapped, mapped.captures.second[0])
    assert stale_reason("second_detection", before) is not None
    assert stale_reason("maps", before) is not None
    assert stale_reason("maps", mapped) is None


def test_passes_of_another_scan_give_way(two):
    other = replace(two.captures.second[0], setup_digest="of another set-up")
    stale = with_tilted(two, other, two.captures.second[1])
    assert usable_second(stale) == ()
    kept = handle(StoreCapture("second", two.captures.second[0]), stale)
    assert kept.captures.second == two.captures.second[:1]


def test_passes_of_another_scan_do_not_count_as_scanned(demo):
    made = demo.results.second.value
    assert all_scanned(demo) is not None
    old = tuple(replace(one, setup_digest="of another set-up") for one in demo.captures.second)
    stale = demo.with_capture("second", old)
    assert all_scanned(stale) is None
    assert plan_of(stale, second=True) is made.plan  # that of the first pass


def test_each_pass_has_its_own_poses_and_its_own_place_in_detection_and_maps(two, mapped):
    n, m = (len(capture.scans) for capture in two.captures.second)
    places = required(PLACES, two)
    poses = joined_poses(places, two.captures.second)
    for rows, capture in zip((slice(0, n), slice(n, None)), two.captures.second, strict=True):
        alone = joined_poses(places, (capture,))
        np.testing.assert_array_equal(poses.translations[rows], alone.translations)
    found = mapped.results.second_detection.value
    first = len(mapped.results.detection.value)
    assert len(found) == n + m
    assert len(mapped.results.maps.value.inner_used) == first + n + m
    assert len(mapped.results.maps.value.offsets_mm) == 3
    assert mapped.results.maps.value.inner_used[first + n :].any()
    assert second_cells(mapped) is not None
    assert second_cells(two) is None  # not yet in the maps


def test_echoes_of_a_pass_that_all_come_late_do_not_change_its_thickness(demo):
    """A warmer line or a holder that slipped: the front echoes of the pass show it."""
    one = demo.captures.second[0]
    track = one.scans
    late = replace(one, scans=replace(track, start_us=track.start_us + 0.12))
    before, after = (
        derived("second_detection", with_tilted(demo, held), StartMapping()) for held in (one, late)
    )
    both = (after.flag == 0) & (before.flag == 0)
    assert both.sum() > 100
    off = after.thickness_mm[both] - before.thickness_mm[both]
    assert abs(np.median(off)) < 0.01  # 0.12 us are 0.16 mm of bone
    np.testing.assert_array_equal(after.standoff_mm, before.standoff_mm)


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


def test_a_boundary_of_a_later_pass_is_corrected_by_its_number_in_all_of_them(two, mapped):
    n = len(two.captures.second[0].scans)
    found, maps = mapped.results.second_detection.value, mapped.results.maps.value
    first = len(mapped.results.detection.value)
    i = n + int(np.flatnonzero(maps.inner_used[first + n :])[0])
    edited = handle(CorrectBoundary(i, "second", remove="inner"), mapped)
    again = derive_all(edited, StartMapping())
    assert again["second_detection"] is found  # what was detected is kept
    assert not again["maps"].inner_used[first + i]


def test_a_plan_of_tilted_passes_is_made_again_whatever_was_scanned_since(planned, two):
    before = planned.results.second
    again = derive_again("second", two, two.results.second, silent, never)
    assert digest(again) == digest(before.value)
    assert not second_view(planned).scanned
    assert second_view(two).scanned


def test_passes_along_lines_follow_those_that_were_scanned(mapped):
    """Lines are planned on the maps of all passes so far, and are scanned after them."""
    lines = (((-2.0, 0.0), (2.0, 0.0)),)
    further = derived("second", mapped, StartTiltPlan(rows=lines))
    assert (further.n_before, len(further.passes)) == (2, 1)
    held = mapped.with_result("second", replace(mapped.results.second, value=further))
    assert held.results.second.value.scanned(held.captures.second) == 0
    assert judge_part("capture second", held).reason == "0 of 1 tilted passes are scanned"
    first, second = mapped.captures.second
    whole = handle(StoreCapture("second", second), held)
    assert whole.captures.second == (first, second, second)
    assert judge_part("capture second", whole).holds


@pytest.fixture(scope="module")
def planned_on(two):
    """Return two passes, the newer one of a plan that was made between them."""
    plan = replace(two.results.second.value.passes[1], n_before=1)
    return two.with_result("second", replace(two.results.second, value=plan))


def test_the_replay_runs_through_all_passes(planned_on):
    before, after = planned_on.captures.second
    motion = replayed(planned_on, second=True)
    n, trajectory = len(before.scans), planned_on.results.second.value.plan.trajectory
    reported_s = float(before.joints.times_s[-1] - before.joints.times_s[0])
    assert motion.times_s[-1] == pytest.approx(reported_s + trajectory.duration_s)
    assert len(motion.fired_s) == n + len(after.scans)
    assert (np.diff(motion.fired_s) > 0.0).all()
    assert (np.diff(motion.times_s) >= 0.0).all()
    for i in (0, n - 1):  # as the robot reported them
        share = share_of_scan(planned_on, i, "second")
        reported = before.joints.at(before.scans.times_s[i : i + 1])[0]
        np.testing.assert_allclose(joints_at(planned_on, share, second=True), reported, atol=1e-9)
    for i in (n, n + len(after.scans) - 1):  # as it was planned
        share = share_of_scan(planned_on, i, "second")
        joints = joints_at(planned_on, share, second=True)
        measured = after.joints.at(after.scans.times_s[i - n : i - n + 1])[0]
        np.testing.assert_allclose(joints, measured, atol=np.deg2rad(1.0))


def test_every_a_scan_of_all_passes_is_reached_by_the_cursor_and_shown(planned_on):
    track = scans_of(planned_on, "second")
    assert len(scan_picture(planned_on, "second")) == len(track)
    assert len(scan_poses(planned_on, "second")) == len(track)
    for i in range(0, len(track), 29):
        assert scan_number_at(planned_on, share_of_scan(planned_on, i, "second"), "second") == i
        assert f"A-scan {i + 1} of {len(track)}" in ascan_plot(planned_on, i, scan="second").remark


def test_a_pass_that_is_planned_and_not_scanned_is_the_last_motion(one):
    plan = replace(one.results.second.value.passes[1], n_before=1)
    waiting = one.with_result("second", replace(one.results.second, value=plan))
    motion = replayed(waiting, second=True)
    assert len(motion.fired_s) == len(one.captures.second[0].scans)
    assert motion.end_s > motion.fired_s[-1]
    q_rad = joints_at(waiting, 1.0, second=True)
    np.testing.assert_allclose(q_rad, plan.plan.trajectory.qs_rad[-1])


def test_a_file_keeps_all_passes(mapped):
    back = reopened(mapped)
    assert [digest(one) for one in back.captures.second] == [
        digest(one) for one in mapped.captures.second
    ]
    assert stale_reason("maps", back) is None


def test_one_track_and_one_batch_stay_what_they_are(one):
    (held,) = one.captures.second
    assert joined_scans((held,)) is held.scans
    poses = scan_poses(one, "second")
    assert Poses.joined([poses]) is poses


def test_tracks_that_are_sampled_differently_are_not_joined(one):
    track = one.captures.second[0].scans
    with pytest.raises(InvalidInputError, match="sampled differently"):
        AScanTrack.joined([track, replace(track, start_us=track.start_us + 1.0)])


def postures_of(capture):
    return capture.joints.at(capture.scans.times_s)


def in_another_posture(capture):
    """Return a pass as if it had reached the same places with another roll."""
    found = with_other_roll(robot_model("rx90"), capture.joints.qs_rad)
    return replace(capture, joints=replace(capture.joints, qs_rad=readonly(found[1])))


def test_tilted_passes_are_planned_in_the_posture_of_the_scan(bare, planned):
    other = bare.with_capture("scan", in_another_posture(bare.captures.scan))
    turned = other.with_result("second", None)
    again = derived("second", turned, StartTiltPlan(passes=1)).passes
    for session, passes in ((bare, planned.results.second.value.passes), (other, again)):
        for one in passes:
            motion = one.plan.trajectory
            scanning = (motion.times_s >= motion.scan_start_s) & (
                motion.times_s <= motion.scan_end_s
            )
            found = motion.qs_rad[scanning]
            model = robot_model("rx90")
            faces = (model.forward(found) @ model.T_flange_probe).translations
            assert alike(found, scan_postures(session).at(faces)).all()
    assert not alike(postures_of(other.captures.scan), postures_of(bare.captures.scan)).any()


def test_maps_say_how_well_the_offsets_of_passes_are_known(bare, mapped):
    before, after = map_accuracy(bare), map_accuracy(mapped)
    held = {row.cause: row for row in after.thickness.budget}
    assert BETWEEN_PASSES in held
    known_mm = mapped.results.maps.value.offset_sigma_mm
    assert held[BETWEEN_PASSES].sigma_mm == pytest.approx(known_mm)
    assert 0.005 < known_mm < 0.3
    assert not held[BETWEEN_PASSES].of_robot
    lines = {line.title: line.predicted_mm for line in error_budgets(after, {})[1].lines}
    assert held[BETWEEN_PASSES].sigma_mm in lines.values()
    assert {row.cause: row.sigma_mm for row in before.thickness.budget}.get(
        BETWEEN_PASSES, 0.0
    ) == 0.0


def test_the_robot_comes_back_as_it_came_first(bare):
    assert scan_postures(bare) is not None
    np.testing.assert_array_equal(scan_postures(bare).qs_rad, postures_of(bare.captures.scan))
    assert scan_postures(bare.with_capture("scan", None)) is None
