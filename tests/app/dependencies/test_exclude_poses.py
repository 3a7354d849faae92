"""Leaving single poses out of a calibration: pure, to be undone, and reproduced by a replay."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.app.runtime.session_step import Undo, replay
from rona_core.app.steps.pointer.messages import CalibratePointer, ExcludePoses
from rona_core.app.steps.tool.calibration_view import EXCLUDED, REJECTED, USED, calibration_view
from rona_core.app.steps.tool.derivation import tool_poses
from rona_core.app.steps.tool.messages import RegisterTool
from rona_core.compose import new_workbench
from rona_core.errors import DegenerateGeometryError, InvalidInputError, StepBlockedError
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.codec import digest
from rona_core.session.document import Session
from tests.scenes import demo_parts


def poses_of(session):
    return tool_poses(session.captures.tool, robot_model(session.setup.devices.robot.model))


@pytest.fixture(scope="module")
def bench():
    bench = new_workbench(demo_parts.registered())
    yield bench
    bench.close()


@pytest.mark.parametrize(
    ("step", "command"), [("tool", RegisterTool), ("pointer", CalibratePointer)]
)
def test_left_out_poses_do_not_count_and_undo_counts_them_again(bench, step, command):
    before = getattr(bench.session.results, step)
    method = "paper" if step == "tool" else "sphere"
    bench.dispatch(command(method=method))
    bench.dispatch(ExcludePoses(step, (7, 2)))
    after = getattr(bench.session.results, step)
    assert after.message == command.__name__
    assert after.arguments == {"method": method, "exclude": [2, 7]}
    assert not after.value.used[[2, 7]].any()
    assert len(after.value.residuals_mm) == len(before.value.residuals_mm)
    assert (after.value.residuals_mm[[2, 7]] > 0.0).all()
    assert {row.result: row.same for row in replay(bench.session)}[step]
    view = calibration_view(bench.session, step)
    assert view.excluded == (2, 7)
    assert set(np.flatnonzero(view.marks == EXCLUDED)) == {2, 7}
    assert view.n_used == int(after.value.used.sum())
    for _ in range(2):
        bench.dispatch(Undo())
    assert getattr(bench.session.results, step) is before


@pytest.mark.parametrize("method", ["joint", "paper"])
def test_a_pose_left_out_has_no_say_in_the_tool(bench, method):
    """The result is that of the same poses without it."""
    from rona_core.calibration.hand_eye.tool_registration import register_tool

    robot, marker, phases = poses_of(bench.session)
    out = np.zeros(len(phases), dtype=bool)
    out[[1, 33]] = True
    masked = register_tool(robot, marker, phases, method=method, exclude=out)
    without = register_tool(robot.select(~out), marker.select(~out), phases[~out], method=method)
    np.testing.assert_array_equal(masked.T_base_tracker.matrix(), without.T_base_tracker.matrix())
    np.testing.assert_array_equal(masked.covariance, without.covariance)
    np.testing.assert_array_equal(masked.used[~out], without.used)
    np.testing.assert_allclose(masked.residuals_mm[~out], without.residuals_mm, atol=1e-12)
    assert (masked.rmse_mm, masked.verdict) == (pytest.approx(without.rmse_mm), without.verdict)


def test_counting_all_again_gives_the_first_result(bench):
    bench.dispatch(ExcludePoses("pointer"))  # computed here: another processor rounds otherwise
    before = digest(bench.session.results.pointer)
    bench.dispatch(ExcludePoses("pointer", (0,)))
    assert digest(bench.session.results.pointer) != before
    bench.dispatch(ExcludePoses("pointer"))
    assert digest(bench.session.results.pointer) == before


def test_what_cannot_be_left_out_is_refused_by_name(bench):
    n = len(bench.session.results.tool.value.residuals_mm)
    held = bench.session
    with pytest.raises(InvalidInputError, match=f"there is no pose {n}: they are 0 to {n - 1}"):
        bench.dispatch(ExcludePoses("tool", (n,)))
    rows = tuple(range(5, len(held.results.pointer.value.residuals_mm)))
    with pytest.raises(InvalidInputError, match="needs at least"):
        bench.dispatch(ExcludePoses("pointer", rows))
    assert bench.session is held
    with pytest.raises(InvalidInputError, match="indices must be 0 to"):
        ExcludePoses("tool", (-1,))
    with pytest.raises(InvalidInputError, match="once only"):
        ExcludePoses("tool", (3, 3))
    empty = new_workbench(Session())
    with pytest.raises(StepBlockedError, match="first calibrate"):
        empty.dispatch(ExcludePoses("pointer", (1,)))
    empty.close()


def test_the_view_tells_verdict_coverage_and_the_next_pose(bench):
    assert calibration_view(Session(), "tool") is None
    view = calibration_view(bench.session, "pointer")
    found = bench.session.results.pointer.value
    assert view.verdict == found.verdict
    assert [(one.sigma_mm, one.limit_mm) for one in view.expected] == [(found.tip_sigma_mm, 0.5)]
    assert len(view.marks) == len(found.used) == len(view.swing.marks)
    assert set(np.flatnonzero(view.marks == REJECTED)) == {row.index for row in found.rejected}
    assert view.swing.next_sigma_mm < found.tip_sigma_mm
    assert view.swing.next_words.startswith("tilt the markers")
    tool = calibration_view(bench.session, "tool")
    assert len(tool.marks) == 50
    assert len(tool.swing.marks) == 30, "the poses that pivot"
    assert (tool.swing.marks == USED).sum() >= 20
    assert float(np.quantile(tool.swing.tilts_deg, 0.9)) > 10.0


def test_a_newer_motion_that_was_stopped_before_anything_was_seen_has_no_picture(bench):
    capture = bench.session.captures.tool
    nothing = replace(capture, dwell_end_s=capture.dwell_start_s)
    session = bench.session
    session = replace(session, captures=replace(session.captures, tool=nothing))
    with pytest.raises(DegenerateGeometryError):
        poses_of(session)
    view = calibration_view(session, "tool")
    assert view.swing is None
    assert view.n_used == calibration_view(bench.session, "tool").n_used
