"""Ends that help: too little inner boundary or no bed, its reason, and what is best done next."""

from dataclasses import asdict, replace

import pytest

from rona_core.app.dependencies.judge import blocked, judge_part
from rona_core.app.dependencies.staleness import input_digests
from rona_core.app.overview.acceptance import quality_rows
from rona_core.app.procedure import OFFERED, next_stage, run_procedure, stages
from rona_core.app.report.report import session_report
from rona_core.app.steps.implant.messages import StartBedSearch
from rona_core.app.steps.implant.step import other_bed
from rona_core.app.steps.maps.further_passes import LEAST_COVERAGE, judge_maps
from rona_core.app.steps.maps.inputs import MAPS
from rona_core.app.steps.scan.messages import StartQuickLook
from rona_core.app.steps.setup.messages import SetProbe
from rona_core.compose import new_workbench
from rona_core.ultrasound.detection.probe_choice import ProbeAdvice
from tests.app.maps.further import covering

HIDDEN = "rona_core.app.steps.maps.further_passes.probe_advice"


def advised(monkeypatch, advice):
    monkeypatch.setattr(HIDDEN, lambda session: advice)


@pytest.fixture
def poor(demo):
    return covering(demo, 0.5)


def test_maps_that_cover_enough_end_the_procedure(demo):
    assert demo.results.maps.value.inner_share >= LEAST_COVERAGE
    assert judge_part("maps", demo).state == "usable"


def test_maps_of_hidden_bone_are_used_but_weak_and_come_last(poor):
    found = judge_part("maps", poor)
    assert (found.state, found.holds) == ("weak", True)
    share = 100 * poor.results.maps.value.inner_share
    assert f"in {share:.0f} % of the outer map after 4 tilted passes" in found.reason
    assert "2.25 MHz" in found.reason
    assert blocked(StartBedSearch, poor) is None
    whole = refused(poor, None)
    assert next_stage(whole, OFFERED).name == "maps"
    no_bed = poor.with_result("bed", None)
    assert next_stage(no_bed, OFFERED).name == "implant"  # what can be done is done first


def test_without_an_inner_boundary_nothing_uses_the_maps(demo):
    bare = covering(demo, 0.0)
    assert judge_part("maps", bare).state == "bad"
    assert "in 0 % of the outer map" in judge_part("maps", bare).reason
    assert blocked(StartBedSearch, bare) is not None
    assert next_stage(bare, OFFERED).name == "maps"


def test_before_all_tilted_passes_are_scanned_the_bone_is_not_blamed(poor):
    maps = poor.results.maps.value
    for passes in ((), poor.captures.second[:2]):
        assert judge_maps(maps, poor.with_capture("second", passes)).state == "usable"


def test_the_remedy_is_a_quick_look_then_what_it_says(poor, monkeypatch):
    found = judge_part("maps", poor).remedy
    assert found.message == StartQuickLook()
    maps = poor.results.maps.value
    advised(monkeypatch, ProbeAdvice("2.25MHz", "1MHz", "Better: the 1 MHz probe."))
    found = judge_maps(maps, poor).remedy
    probe = poor.setup.devices.probe
    assert found.message == SetProbe(**{**asdict(probe), "name": "1MHz"})
    assert "choose the 1 MHz probe (step 1) and scan again" in found.words
    advised(monkeypatch, ProbeAdvice("2.25MHz", "2.25MHz", "No other."))
    found = judge_maps(maps, poor).remedy
    assert found.message is None
    assert "choose another region (step 1)" in found.words


@pytest.mark.parametrize(("share", "words"), [(0.5, "in 50 %"), (0.0, "in 0 %")])
def test_procedure_report_and_acceptance_say_the_same(demo, share, words):
    session = covering(demo, share)
    bench = new_workbench(session)
    ending = run_procedure(bench, stages("maps", skip=("gauge", "tilts", "tilted", "caliper")))
    bench.close()
    assert (ending.completed, ending.failed_step) == (False, "maps")
    found = judge_part("maps", session)
    assert words in found.reason
    assert ending.reason == f"{found.reason}. Next: {found.remedy.words}"
    (row,) = (
        row
        for row in quality_rows({"inner_coverage_fraction": share}, session)
        if row.key == "inner_coverage_fraction"
    )
    assert row.reason == found.reason
    page = session_report(session, {}, None)
    assert found.reason in page
    assert f"Next: {found.remedy.words}." in page


def refused(session, refusal="too little bone is left", **asked):
    """Return the session whose bed is not safe, as it was searched; None: it is safe."""
    held = session.results.get("bed")
    bed = replace(held.value, refusal=refusal)
    bed = replace(bed, implant=asked.get("implant", bed.implant))
    inputs = input_digests("bed", session, held.message)
    made = replace(held, value=bed, arguments={**held.arguments, **asked}, inputs=inputs)
    return session.with_result("bed", made)


def test_of_a_bed_that_is_not_safe_the_next_best_is_named(demo, poor):
    for asked, message in (
        ({"lift_mm": 1.0}, {"lift_mm": None}),
        ({"implant": "BCI 601", "burr_mm": 5.0}, {"implant": "BCI 602", "burr_mm": None}),
        ({}, {"implant": "Osia/Baha screw"}),
        ({"implant": "CI receiver"}, None),
    ):
        session = refused(demo, **asked)
        found = other_bed(session.results.get("bed").value, session)
        if message is None:
            assert found.message is None
            assert "another implant (step 10) or another region (step 1)" in found.words
        else:
            for name, value in {**asked, **message}.items():
                assert getattr(found.message, name) == value
    hidden = refused(poor)
    found = judge_part("bed", hidden)
    assert "too little bone is left" in found.reason
    assert found.remedy == judge_part("maps", hidden).remedy
    assert MAPS.read(hidden) is not None


def test_a_procedure_without_a_bed_ends_with_reason_and_next_step(demo):
    session = refused(demo)
    skip = [name for name in OFFERED if name not in ("milling", "rehearsal")]
    bench = new_workbench(session)
    ending = run_procedure(bench, stages("implant", skip=skip))
    bench.close()
    found = judge_part("bed", session)
    assert (ending.completed, ending.failed_step) == (False, "implant")
    assert ending.reason == f"{found.reason}. Next: {found.remedy.words}"
