"""A result is judged against the capture it was computed from, never against a later one."""

from dataclasses import replace
from itertools import count

import pytest

from rona_core.app.dependencies.judge import step_states
from rona_core.app.runtime.workbench import Workbench
from rona_core.app.steps.boundaries.ascan_view import ascan_plot
from rona_core.app.steps.boundaries.step import detection_of_scan
from rona_core.app.steps.path.messages import StartPathCapture
from rona_core.app.steps.pointer.messages import StartPointerCapture
from rona_core.app.steps.scan.messages import StartScan
from rona_core.app.steps.surface.messages import StartSurfaceCapture
from rona_core.app.steps.tool.messages import StartToolCapture
from rona_core.compose import virtual_services
from rona_core.errors import CancelledError

AFTER_A_SCAN = (
    "detection_failure_fraction",
    "unflagged_failure_fraction",
    "flagged_fraction",
    "sound_speed_error_percent",
    "scan_thickness_rms_mm",
)
IN_THE_TOOL_MOTION = 400  # times that a capture has asked whether to stop, when poses come
IN_THE_SCAN = 1500  # times that a scan has asked whether to stop, when A-scans come


@pytest.fixture(scope="module")
def shared(demo, tmp_path_factory):
    bench = Workbench(demo, virtual_services(), tmp_path_factory.mktemp("bench"))
    yield bench
    bench.close()


@pytest.fixture(scope="module")
def before(shared):
    """Figures of the demo session."""
    return shared.figures()


@pytest.fixture
def bench(shared, demo):
    """A bench with the demo session as it is on file."""
    shared.store._session = demo
    return shared


@pytest.mark.sweep(1)
@pytest.mark.parametrize(
    ("activity", "asked"),
    [
        (StartScan(), IN_THE_SCAN),
        (StartPathCapture(), 0),
        (StartSurfaceCapture(), 0),
        (StartSurfaceCapture(append=True), 0),
        (StartToolCapture(), IN_THE_TOOL_MOTION),
        (StartPointerCapture(), 0),
    ],
    ids=lambda value: type(value).__name__ if not isinstance(value, int) else "",
)
def test_a_repeat_that_was_cut_short_leaves_captures_states_and_figures_as_they_were(
    bench, demo, before, activity, asked
):
    questions = count()
    bench.run(activity, cancel=lambda: next(questions) >= asked)
    session = bench.session
    assert session.captures is demo.captures
    assert session.results is demo.results
    assert session.boundary_edits is demo.boundary_edits
    assert session.archive[-1].partial, "what came is kept"
    assert step_states(session) == step_states(demo)
    assert bench.figures() == before


def test_a_scan_stopped_before_it_touched_leaves_all_figures_as_they_were(bench, before):
    with pytest.raises(CancelledError, match="earlier is kept"):
        bench.run(StartScan(), cancel=lambda: True)
    assert bench.figures() == before


def test_a_capture_of_the_same_length_is_another_one_all_the_same(bench, demo):
    scan = demo.captures.scan
    shifted = replace(scan, ordinal=scan.ordinal + 1)
    bench.store._session = replace(demo, captures=replace(demo.captures, scan=shifted))
    assert all(bench.figures()[key] is None for key in AFTER_A_SCAN)
    assert detection_of_scan(demo) is demo.results.detection.value
    assert detection_of_scan(bench.session) is None
    assert ascan_plot(demo, 0).outer_us is not None
    assert ascan_plot(bench.session, 0).outer_us is None
