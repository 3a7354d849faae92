"""The procedure as stages: what is next, what may be skipped, and that remedies alone lead on."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.judge import judge_part, step_states
from rona_core.app.procedure import (
    OFFERED,
    PROCEDURE,
    TO_MAPS,
    next_stage,
    run_procedure,
    stages,
)
from rona_core.app.runtime.workbench import Workbench
from rona_core.app.steps.acoustics.messages import RemoveReferencePoint
from rona_core.app.steps.maps.messages import StartMapping
from rona_core.app.steps.setup.messages import SetRobot
from rona_core.app.steps.tool.messages import StartToolCapture
from rona_core.compose import new_session, new_workbench
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.session.document import Session


@pytest.fixture
def bench_of(monkeypatch) -> Callable[[Session], Workbench]:
    """Workbenches that are closed in the end."""
    made: list[Workbench] = []

    def new(session: Session) -> Workbench:
        made.append(new_workbench(session))
        return made[-1]

    yield new
    for bench in made:
        bench.close()


def send(message, bench):
    if type(message).__name__ in REGISTRY.command_types:
        bench.dispatch(message)
    else:
        bench.run(message)
    return type(message).__name__


def test_the_stages_follow_the_list_of_steps_and_leave_out_none():
    places = [REGISTRY.step_names.index(stage.step) for stage in PROCEDURE]
    assert places == sorted(places)
    assert {stage.step for stage in PROCEDURE} == set(REGISTRY.step_names[1:])
    assert len({stage.name for stage in PROCEDURE}) == len(PROCEDURE)


def test_each_stage_sends_what_makes_its_part():
    for stage in PROCEDURE:
        kind = type(stage.message).__name__
        makes = {result.name for result in REGISTRY.results_of(kind)}
        recorded = REGISTRY.activities[kind].makes if kind in REGISTRY.activities else ()
        makes |= {f"capture {name}" for name in recorded}
        # a recording is followed by the command that computes from it
        follows = {
            result.name
            for name in REGISTRY.commands
            for result in REGISTRY.results_of(name)
            if any(item.upstream in makes for item in result.inputs.values())
        }
        assert stage.makes in makes | follows, stage.name


def test_an_empty_session_begins_at_the_first_stage_and_a_whole_one_needs_none(demo):
    assert next_stage(Session()).name == "tool"
    assert all(s.judgement(demo).holds for s in PROCEDURE if not s.offered)
    assert next_stage(demo, OFFERED) is None


@pytest.mark.parametrize("stage", PROCEDURE, ids=lambda stage: stage.name)
def test_a_stage_whose_part_is_gone_is_next_unless_it_is_skipped(demo, stage):
    kind = stage.makes.removeprefix("capture ")
    if stage.makes.startswith("capture "):
        lacking = demo.with_capture(kind, () if kind == "second" else None)
    else:
        lacking = demo.with_result(kind, None)
    found = next_stage(lacking, [name for name in OFFERED if name != stage.name])
    assert found == stage or (found.name, stage.name) == ("maps", "caliper")  # made with its speed
    assert stage.is_due(lacking)
    if stage.offered:
        skipped = next_stage(lacking, OFFERED)
        assert skipped is None or not skipped.offered


def test_what_rests_on_a_skipped_stage_is_not_proposed(demo):
    bare = demo.with_result("second", None).with_capture("second", ())
    assert next_stage(bare, ("tilts",)).name == "maps"  # made with the passes that are gone


def test_stages_are_chosen_by_name_and_a_message_takes_the_place_of_its_kind():
    chosen = stages("detection", StartToolCapture(n_pivot=12), skip=("gauge",))
    assert chosen[0].message == StartToolCapture(n_pivot=12)
    assert chosen[0].next_message(Session()) == StartToolCapture(n_pivot=12)
    assert [s.name for s in chosen][-2:] == ["scan", "detection"]
    with pytest.raises(InvalidInputError, match="one of tool, pointer"):
        stages("drilling")
    with pytest.raises(InvalidInputError, match="sends StartMapping"):
        stages("scan", StartMapping())


def test_an_offered_stage_that_fails_is_left_out_with_its_reason(demo, bench_of, monkeypatch):
    bare = demo.with_result("second", None).with_capture("second", ())
    bare = bare.with_result("speed", None).with_capture("references", None)
    bench, ran = bench_of(bare), []
    genuine = Workbench.run

    def run(self, message, *rest):
        name = type(message).__name__
        ran.append(name)
        if name in ("StartTiltPlan", "StartCaliperMeasurements"):
            raise DegenerateGeometryError(f"no {name}")
        return genuine(self, message, *rest)

    monkeypatch.setattr(Workbench, "run", run)
    ending = run_procedure(bench, TO_MAPS)
    assert ending.completed
    assert ending.left_out == {
        "tilts": "no StartTiltPlan",
        "caliper": "no StartCaliperMeasurements",
    }
    # passes are planned on maps that are not stale, and without a plan nothing is scanned
    assert ran == ["StartMapping", "StartTiltPlan", "StartCaliperMeasurements"]


def test_a_required_stage_that_fails_ends_the_run(demo, bench_of):
    before = [name for name in OFFERED if name not in ("milling", "rehearsal")]
    refused = replace(demo.results.get("bed").value, refusal="too little bone is left")
    bed = replace(demo.results.get("bed"), value=refused)
    ending = run_procedure(bench_of(demo.with_result("bed", bed)), stages("implant", skip=before))
    assert (ending.completed, ending.failed_step) == (False, "implant")
    assert "too little bone is left" in ending.reason


@pytest.mark.slow
def test_after_another_scan_speed_three_remedies_lead_back_to_usable_maps(demo, bench_of):
    bench = bench_of(demo)
    bench.dispatch(SetRobot(scan_speed_mm_per_s=30.0))
    sent = []
    while not (found := judge_part("maps", bench.session)).holds:
        sent.append(send(found.remedy.message, bench))
        assert len(sent) <= 3, sent
    assert sent == ["StartRollSearch", "StartScan", "StartMapping"]
    assert {s.name: s.state for s in step_states(bench.session)}["maps"] == "done"


@pytest.mark.slow
def test_without_its_reference_points_the_maps_and_then_the_caliper_are_next(demo, bench_of):
    bench = bench_of(demo)
    bench.dispatch(RemoveReferencePoint())
    assert next_stage(bench.session).name == "maps"
    bench.run(StartMapping())
    assert next_stage(bench.session).name == "caliper"
    assert next_stage(bench.session, OFFERED).name == "implant"


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_from_nothing_the_remedies_alone_lead_to_a_placed_bed(seed):
    bench, sent = new_session("remedies", seed=seed), []
    try:
        while not (found := judge_part("bed", bench.session)).holds:
            sent.append(send(found.remedy.message, bench))
            assert len(sent) <= 25, sent
        assert sent[:9] == [
            "StartToolCapture",
            "StartPointerCapture",
            "StartSurfaceCapture",
            "StartPathCapture",
            "SmoothScanPath",
            "StartRollSearch",
            "StartScan",
            "StartMapping",
            "StartBedSearch",
        ]
        assert bench.session.results.get("bed").value.refusal is None
    finally:
        bench.close()
