"""A tracker that moves between registration and strokes: kept, carried over, or refused by name."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.app.dependencies.judge import step_states
from rona_core.app.dependencies.references import placed_reason, reference_of
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.overview.predicted_accuracy import predict_surface
from rona_core.app.runtime.handling import handle
from rona_core.app.steps.path.messages import BuildPath
from rona_core.app.steps.pointer.messages import StartPointerCapture
from rona_core.app.steps.setup.messages import (
    MoveTracker,
    SetRobot,
    SetToolVisible,
    SetTracker,
    SetUseBaseMarker,
)
from rona_core.app.steps.surface.messages import BuildSurface, StartSurfaceCapture
from rona_core.app.steps.tool.derivation import delay_words, measured_times_s, tracker_delay
from rona_core.app.steps.tool.messages import RegisterTool, StartToolCapture
from rona_core.calibration.timing.time_offset import TimeOffset
from rona_core.compose import new_workbench
from rona_core.devices.settings import DeviceSettings, RobotSettings, TrackerPlace
from rona_core.errors import InvalidInputError, RonaError, StaleResultError, StepBlockedError
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.captures import imported_digest
from rona_core.session.document import Session, Setup
from tests.helpers.session_file import reopened

MOVE = MoveTracker((30.0, -20.0, 10.0), 1.0)
TOOL = StartToolCapture(n_pivot=8, n_translate=3)
STROKE = StartSurfaceCapture(duration_s=10.0)
SINGLE = BuildSurface(average_s=0.0)  # fast strokes at 20 frames a second suffer from averaging


PROMPT = DeviceSettings(robot=RobotSettings(latency_ms=0.0))  # so that the tracker alone is late


def bench_with(profile, **tracker):
    bench = new_workbench(Session(setup=Setup(devices=PROMPT)))
    bench.dispatch(SetTracker(profile=profile, rate_hz=20.0, occlusion=False, **tracker))
    bench.dispatch(SetRobot(errors=False))
    return bench


def registered(profile, **tracker):
    bench = bench_with(profile, **tracker)
    bench.run(TOOL)
    bench.run(StartPointerCapture(duration_s=5.0))
    return bench


@pytest.fixture(scope="module")
def ideal():
    bench = registered("ideal")
    yield bench
    bench.close()


@pytest.fixture(scope="module")
def before(ideal):
    """Tool and pointer calibrated, the tracker where it was."""
    return ideal.session


def _refused(bench):
    bench.dispatch(SetUseBaseMarker(use_base_marker=False))
    bench.dispatch(BuildSurface())


def opened(session):
    return new_workbench(session)


def state(session, name):
    return next(step for step in step_states(session) if step.name == name)


def test_the_base_marker_is_recorded_and_remembered(before):
    capture, tool = before.captures.tool, before.results.tool.value
    assert capture.base.tool == "basemarker"
    assert len(capture.base.times_s) == capture.base.n_frames == capture.marker.n_frames
    found = tool.T_base_tracker @ tool.base.seen.T_tracker_basemarker
    np.testing.assert_allclose(found.matrix(), tool.base.T_base_basemarker.matrix())
    assert before.captures.pointer.base.n_frames == before.captures.pointer.marker.n_frames


def test_at_rest_the_registration_is_kept_to_the_last_bit(before):
    session = opened(before).run(STROKE)
    found = reference_of(session, session.captures.surface[0])
    assert found.state == "kept"
    assert found.T_base_tracker is session.results.tool.value.T_base_tracker
    assert found.added_mm == 0.0


def test_a_moved_tracker_is_found_again_exactly_without_noise(before):
    bench = opened(before)
    bench.dispatch(MOVE)
    session = bench.run(STROKE)
    found = reference_of(session, session.captures.surface[0])
    assert found.state == "carried"
    true = bench.rig().display.T_base_tracker()
    registered_off = before.results.tool.value.T_base_tracker.inv() @ true
    assert np.linalg.norm(registered_off.translation) > 30.0
    np.testing.assert_allclose(found.T_base_tracker.matrix(), true.matrix(), atol=1e-6)
    bench.dispatch(SINGLE)
    figures = bench.figures()
    assert figures["surface_tip_3d_rms_mm"] < 0.01
    assert figures["tracker_registration_tre_mm"] < 0.01  # judged where the tracker stood then
    assert state(session, "tool").state == state(session, "surface").state == "done"
    assert state(session, "surface").reason.endswith("points, tracker found again (+0.00 mm)")


def test_what_the_move_costs_is_said_and_is_about_what_it_costs():
    bench = registered("polaris")
    bench.run(STROKE)
    bench.dispatch(SINGLE)
    at_rest = bench.session
    rms_at_rest = bench.figures()["surface_tip_3d_rms_mm"]
    assert reference_of(at_rest, at_rest.captures.surface[0]).state == "kept"
    bench.dispatch(MOVE)
    bench.run(STROKE)
    bench.dispatch(SINGLE)
    session = bench.session
    found = reference_of(session, session.captures.surface[0])
    rms = bench.figures()["surface_tip_3d_rms_mm"]
    bench.close()
    assert found.state == "carried"
    assert f"{found.added_mm:.2f} mm" in found.sentence
    assert "moved by" in found.sentence
    assert 0.02 < found.added_mm < 1.0
    assert f"found again (+{found.added_mm:.2f} mm)" in state(session, "surface").reason
    assert abs(rms - rms_at_rest) < 3.0 * found.added_mm
    before, after = predict_surface(at_rest), predict_surface(session)
    assert before is not None
    assert after is not None
    assert after.registration_mm >= found.added_mm
    assert after.registration_mm > before.registration_mm
    head_base = session.results.surface.value.points_base[:1]
    assert found.sigma_mm(head_base)[0] > at_rest.results.tool.value.tip_sigma_mm / 10.0


def test_without_the_base_marker_a_moved_tracker_is_refused_by_name(before):
    bench = opened(before)
    bench.run(STROKE)
    bench.dispatch(MOVE)
    bench.run(STROKE)
    with pytest.raises(StaleResultError, match=r"moved by 37\.\d mm and 1° .* register again, or"):
        _refused(bench)
    session = bench.session
    assert state(session, "tool").state == "stale"
    assert "register again" in state(session, "tool").reason
    assert "use of the base marker" in stale_reason("surface", session)
    with pytest.raises(StepBlockedError, match="register again"):
        bench.run(STROKE)
    bench.dispatch(MoveTracker())
    assert placed_reason(bench.session) is None
    assert bench.run(STROKE).results.surface is not None


def test_strokes_from_before_the_move_stay_as_good_as_they_were(before):
    bench = opened(before)
    old = bench.run(STROKE)
    bench.dispatch(MOVE)
    assert stale_reason("surface", bench.session) is None
    assert stale_reason("capture surface", bench.session) is None
    bench.dispatch(SetUseBaseMarker(use_base_marker=False))
    bench.dispatch(BuildSurface())
    again = bench.session
    np.testing.assert_array_equal(
        again.results.surface.value.points_base, old.results.surface.value.points_base
    )


def test_a_hidden_base_marker_is_named(before):
    bench = opened(before)
    bench.dispatch(SetToolVisible("basemarker", False))
    session = bench.run(STROKE)
    found = reference_of(session, session.captures.surface[0])
    assert (found.state, found.movement) == ("unchecked", None)
    assert "hidden (seen in 0 of" in found.sentence
    bench.dispatch(MOVE)
    with pytest.raises(StepBlockedError, match="base marker is covered: uncover it"):
        bench.run(STROKE)
    bench.dispatch(SetToolVisible("basemarker", True))
    session = bench.run(STROKE)
    covered = replace(session.captures.surface[-1], base=None)
    with pytest.raises(StaleResultError, match="base marker was not recorded: uncover it"):
        reference_of(session, covered)


def test_a_stroke_out_of_a_file_is_mapped_as_registered_wherever_the_tracker_is(before):
    bench = opened(before)
    bench.dispatch(MOVE)
    stroke = bench.run(STROKE).captures.surface[0]
    imported = replace(stroke, setup_digest=imported_digest([b"file"]), base=None)
    found = reference_of(bench.session, imported)
    assert (found.state, found.added_mm) == ("unchecked", 0.0)
    assert found.T_base_tracker is before.results.tool.value.T_base_tracker
    assert "not recorded" in found.sentence


def test_a_moved_base_makes_everything_stale(before):
    session = opened(before).run(STROKE)
    moved = handle(SetRobot(errors=False, base_shift_mm=(40.0, 0.0, 0.0)), session)
    for name in ("tool", "surface"):
        assert "the base of the robot" in stale_reason(name, moved)
    assert stale_reason("pointer", moved) is None


def test_a_session_with_a_moved_tracker_is_saved_and_loaded(before):
    bench = opened(before)
    bench.dispatch(MOVE)
    back = reopened(bench.run(STROKE))
    assert back.setup.devices.tracker.place == TrackerPlace(MOVE.shift_mm, MOVE.turn_deg)
    assert back.captures.surface[0].tracker_place == back.setup.devices.tracker.place
    assert reference_of(back, back.captures.surface[0]).state == "carried"


@pytest.mark.parametrize("value", [((600.0, 0.0, 0.0), 0.0), ((0.0, 0.0, 0.0), 21.0)])
def test_a_tracker_is_not_carried_away(value):
    with pytest.raises(InvalidInputError):
        MoveTracker(*value)


def with_latency(latency_ms):
    bench = bench_with("polaris", latency_ms=latency_ms)
    session, figures = bench.run(TOOL), bench.figures()
    bench.close()
    return session, figures


@pytest.fixture(scope="module")
def prompt():
    """Step 2 with a tracker that is never late."""
    return with_latency(0.0)


def test_a_tracker_that_is_not_late_is_left_as_it_is(prompt):
    capture, delay = prompt[0].captures.tool, prompt[0].results.tool.value.delay
    assert abs(delay.offset_s) <= 3.0 * delay.sigma_s
    assert measured_times_s(capture, robot_model("rx90")) is capture.marker.times_s


@pytest.mark.parametrize("latency_ms", [14.0, 40.0])
def test_the_delay_of_the_tracker_is_told_and_put_right(latency_ms, prompt):
    session, figures = with_latency(latency_ms)
    capture, delay = session.captures.tool, session.results.tool.value.delay
    assert 0.0 < delay.sigma_s < 0.001
    assert abs(delay.offset_s - latency_ms / 1000.0) <= 3.0 * delay.sigma_s
    times = measured_times_s(capture, robot_model("rx90"))
    np.testing.assert_allclose(times, capture.marker.times_s - delay.offset_s, atol=1e-12)
    for name in ("tracker_registration_tre_mm", "tool_tip_error_mm"):
        assert figures[name] == pytest.approx(prompt[1][name], abs=0.1)


def test_a_motion_that_tells_no_delay_leaves_the_times_alone(before):
    capture = before.captures.tool
    resting = replace(
        capture.joints,
        qs_rad=np.repeat(capture.joints.qs_rad[:1], len(capture.joints.qs_rad), axis=0),
    )
    still = replace(capture, joints=resting)
    assert tracker_delay(still, robot_model("rx90")) is None
    assert measured_times_s(still, robot_model("rx90")) is still.marker.times_s


def test_a_delay_reads_as_people_write_it():
    late = ("Tracker latency (compensated)", "14.2 ± 0.4 ms")
    assert delay_words(TimeOffset(0.01423, 0.0004, 1.0, 9.0)) == late
    early = ("Robot joint latency (compensated)", "7.9 ± 0.1 ms")
    assert delay_words(TimeOffset(-0.0079, 0.00002, 1.0, 9.0)) == early
    none = ("Robot-tracker latency", "none, ± 0.4 ms")
    assert delay_words(TimeOffset(-0.001, 0.0004, 1.0, 9.0)) == none


def test_a_registration_without_a_base_marker_says_so(before):
    capture = replace(before.captures.tool, base=None)
    session = replace(before, captures=replace(before.captures, tool=capture))
    session = handle(RegisterTool(), session)
    assert session.results.tool.value.base is None
    moved = handle(MOVE, session)
    assert "not seen then" in placed_reason(moved)
    with pytest.raises(RonaError):
        handle(BuildPath(), moved)
