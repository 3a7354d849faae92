"""Verification on landmarks before the robot scans: the gate, what it catches, the override."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.app.dependencies.judge import blocked, step_states
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.steps.maps.messages import StartTiltScan
from rona_core.app.steps.scan.landmarks.messages import (
    OverrideLandmarks,
    StartLandmarkCapture,
    VerifyLandmarks,
)
from rona_core.app.steps.scan.landmarks.step import verification
from rona_core.app.steps.scan.landmarks.view import landmark_report
from rona_core.app.steps.scan.messages import StartScan
from rona_core.app.steps.setup.messages import SetPointer, SetToolVisible
from rona_core.app.steps.tool.messages import RegisterTool
from rona_core.compose import new_workbench
from rona_core.errors import (
    CancelledError,
    DegenerateGeometryError,
    InvalidInputError,
    StepBlockedError,
)
from rona_core.geometry.pose import Pose
from rona_core.session.codec import digest
from tests.helpers.session_file import reopened
from tests.scenes import demo_parts


def opened():
    """Return a bench with the demo session before anything was verified, its plan ready."""
    demo = demo_parts.demo().with_capture("landmarks", None).with_result("landmarks", None)
    return new_workbench(demo)


@pytest.fixture
def bench():
    bench = opened()
    yield bench
    bench.close()


def bumped(bench, shift_mm):
    """Bump the tracker after the registration, while its marker on the base is covered.

    Neither session nor program is told.
    """
    bench.dispatch(SetToolVisible("basemarker", False))
    rig = bench.rig()
    rig.begin(bench.session.setup.devices, 0)
    before = rig.scene.T_base_tracker
    rig.scene.T_base_tracker = Pose(before.rotation, before.translation + shift_mm)


def state(bench):
    return {one.name: one for one in step_states(bench.session)}["scan"]


def test_tracker_and_robot_agree_on_the_landmarks(bench):
    bench.run(StartLandmarkCapture())
    found, report = verification(bench.session), landmark_report(bench.session)
    assert found.state == "passed"
    assert len(report.rows) == 5
    assert all(row.distance_mm < 3.0 * row.sigma_mm for row in report.rows)
    assert 0.1 < report.sigma_mm < 0.8
    assert stale_reason("landmarks", bench.session) is None
    again = reopened(bench.session)
    assert digest(verification(again).check) == digest(found.check)


def test_the_same_landmarks_are_measured_again_by_the_same_seed(bench):
    bench.run(StartLandmarkCapture())
    other = opened()
    other.run(StartLandmarkCapture())
    assert digest(bench.session.captures.get("landmarks")) == digest(
        other.session.captures.get("landmarks")
    )
    other.close()


@pytest.mark.sweep(1)
@pytest.mark.parametrize("shift_mm", [(3.0, 0.0, 0.0), (0.0, -2.0, 1.5), (0.0, 0.0, 3.0)])
def test_a_tracker_that_was_bumped_is_caught_before_the_robot_moves(bench, shift_mm):
    bumped(bench, np.array(shift_mm))
    stood, scans = bench.rig().robot.state().q_rad, bench.session.captures.scan
    with pytest.raises(StepBlockedError, match="the robot has not moved: the verification on"):
        bench.run(StartScan())
    np.testing.assert_array_equal(bench.rig().robot.state().q_rad, stood)
    assert bench.session.captures.scan is scans
    assert verification(bench.session).state == "failed"
    assert bench.session.captures.get("landmarks") is bench.session.archive[-1]
    for kind in (StartScan, StartTiltScan):
        assert "verification on landmarks failed" in blocked(kind, bench.session).reason
    assert "override it with a reason" in state(bench).blocked


def test_a_bump_that_the_base_marker_sees_is_corrected_and_passes(bench):
    rig = bench.rig()
    rig.begin(bench.session.setup.devices, 0)
    before = rig.scene.T_base_tracker
    rig.scene.T_base_tracker = Pose(before.rotation, before.translation + (3.0, 0.0, 0.0))
    bench.run(StartLandmarkCapture())
    assert verification(bench.session).state == "passed"


def test_an_override_opens_the_gate_is_logged_and_ends_with_the_next_verification(bench):
    bumped(bench, np.array((3.0, 0.0, 0.0)))
    bench.run(StartLandmarkCapture())
    assert blocked(StartScan, bench.session) is not None
    bench.dispatch(OverrideLandmarks("the frame was bent, the region is fine"))
    assert verification(bench.session).state == "overridden"
    assert blocked(StartScan, bench.session) is None
    assert bench.session.log[-1].message == "OverrideLandmarks"
    assert bench.session.log[-1].arguments["reason"].startswith("the frame was bent")
    bench.run(StartLandmarkCapture())
    assert verification(bench.session).state == "failed"
    with pytest.raises(InvalidInputError, match="3 to 300 characters"):
        OverrideLandmarks(" ")


def test_a_new_registration_is_to_be_verified_again(bench):
    bench.run(StartLandmarkCapture())
    bench.dispatch(RegisterTool("paper"))
    assert verification(bench.session).state == "stale"
    assert blocked(VerifyLandmarks, bench.session) is None
    bench.dispatch(SetPointer("pointer5d"))
    assert "pointer" in blocked(StartLandmarkCapture, bench.session).reason


def test_a_pointer_that_is_not_seen_verifies_nothing(bench):
    pointer = bench.session.setup.devices.pointer
    bench.dispatch(SetToolVisible(pointer, False))
    with pytest.raises(DegenerateGeometryError, match="on 0 of 5 landmarks"):
        bench.run(StartScan())
    assert verification(bench.session).state == "missing"


def test_stopped_on_the_landmarks_nothing_is_scanned(bench):
    with pytest.raises(CancelledError, match="robot has not moved"):
        bench.run(StartScan(), cancel=lambda: True)
    assert verification(bench.session).state == "missing"


@pytest.mark.slow
def test_a_scan_verifies_first_and_once(bench):
    session = bench.session
    probe = replace(session.setup.devices.probe, pitch_mm=5.0)
    devices = replace(session.setup.devices, probe=probe)
    short = new_workbench(replace(session, setup=replace(session.setup, devices=devices)))
    for expected in (["StoreCapture", "VerifyLandmarks", "StoreCapture"], ["StoreCapture"]):
        before = len(short.session.log)
        short.run(StartScan())
        assert [entry.message for entry in short.session.log[before:]] == expected
    assert verification(short.session).state == "passed"
    assert short.session.captures.scan is short.session.archive[-1]
    assert short.session.captures.scan.ordinal == len(short.session.archive)
    short.close()
