"""A step behind stale ones is refused before anything starts, with what is to be done first."""

from dataclasses import replace

import pytest

from rona_core.app.declarations.inputs import is_missing
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.judge import step_states
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.runtime.handling import handle
from rona_core.app.runtime.workbench import Workbench
from rona_core.app.steps.maps.messages import StartMapping, StartTiltScan
from rona_core.app.steps.path.messages import GenerateScanPattern, StartPathCapture
from rona_core.app.steps.roll.messages import ChooseRoll, StartRollSearch
from rona_core.app.steps.scan.messages import StartScan
from rona_core.app.steps.setup.messages import SetRobot, SetSeed
from rona_core.app.steps.smoothing.messages import SmoothScanPath
from rona_core.app.steps.surface.messages import BuildSurface, StartSurfaceCapture
from rona_core.app.steps.tool.messages import StartToolCapture
from rona_core.compose import virtual_services
from rona_core.errors import StepBlockedError
from rona_core.session.codec import digest
from tests.helpers.session_file import reopened


@pytest.fixture(scope="module")
def other_robot(demo):
    return handle(SetRobot(model="ur10"), demo)


@pytest.fixture
def bench(other_robot, tmp_path):
    bench = Workbench(other_robot, virtual_services(), tmp_path)
    yield bench
    bench.close()


@pytest.mark.parametrize(
    "message",
    [
        StartSurfaceCapture(),
        StartPathCapture(),
        StartRollSearch(),
        StartScan(),
        StartMapping(),
        StartTiltScan(),
        SmoothScanPath(),
        BuildSurface(),
        GenerateScanPattern(),
        ChooseRoll(0),
    ],
    ids=lambda message: type(message).__name__,
)
def test_what_rests_on_another_robot_is_refused_before_a_job_begins(bench, other_robot, message):
    start = bench.start if type(message).__name__.startswith("Start") else bench.dispatch
    with pytest.raises(StepBlockedError, match=r"first record the tool motion \(step 2\) again"):
        start(message)
    assert bench.jobs.all() == ()
    assert bench.session is other_robot


def test_the_steps_say_themselves_that_they_cannot_be_started(demo, other_robot):
    assert all(state.blocked is None for state in step_states(demo))
    found = {state.name: state for state in step_states(other_robot)}
    for name in ("surface", "path", "smoothing", "roll", "scan", "maps"):
        assert found[name].state == "stale"
        assert found[name].blocked.startswith("first record the tool motion (step 2) again: ")
    assert found["tool"].state == "stale"
    assert found["tool"].blocked is None, "here it begins"


def test_a_step_not_done_yet_behind_a_stale_one_is_blocked(demo):
    results = replace(demo.results, roll=None, maps=None, detection=None)
    captures = replace(demo.captures, scan=None, second=())
    session = handle(SetSeed(5), replace(demo, results=results, captures=captures))
    state = {state.name: state for state in step_states(session)}["roll"]
    assert state.state == "blocked"
    assert "again" in state.reason


def test_the_first_step_that_is_stale_may_be_done_again(bench):
    bench.run(StartToolCapture(n_pivot=8, n_translate=3))
    assert bench.session.results.tool.inputs["robot"] == digest("ur10")
    assert stale_reason("tool", bench.session) is None


def test_a_file_that_was_stale_stays_so(demo):
    results = replace(
        demo.results,
        tool=replace(demo.results.tool, inputs={**demo.results.tool.inputs, "robot": "x"}),
    )
    loaded = reopened(replace(demo, results=results))
    assert "the robot (step 1) was changed" in stale_reason("tool", loaded)


def test_an_input_that_an_older_version_did_not_know_makes_stale_where_it_has_a_value(demo):
    """One that is optional and missing changes nothing."""
    told = {True: 0, False: 0}
    for name in REGISTRY.replayed:
        held = demo.results.get(name)
        if held is None or stale_reason(name, demo) is not None:
            continue
        for key, item in REGISTRY.result(name, held.message).inputs.items():
            known = {k: digest for k, digest in held.inputs.items() if k != key}
            older = demo.with_result(name, replace(held, inputs=known))
            without = item.optional and is_missing(item.counted(demo))
            reason = stale_reason(name, older)
            assert (reason is None) == without, (name, key, reason)
            assert without or "without" in reason
            told[without] += 1
    assert min(told.values()) > 2, told
