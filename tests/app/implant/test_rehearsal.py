"""The rehearsal of the demo's milling: asked for, kept, the same again, stale."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.app.dependencies.judge import blocked
from rona_core.app.runtime.workbench import Workbench
from rona_core.app.steps.implant.messages import RehearseMilling
from rona_core.app.steps.implant.rehearsal import (
    FloorScan,
    RaisedMilling,
    floor_detector,
    milling_task,
    rehearsal_ok,
    rehearsal_stale,
    rehearsal_verdict,
)
from rona_core.app.steps.implant.view import milling_view, require_certified
from rona_core.app.steps.setup.messages import SetProbe
from rona_core.compose import milling_site, new_workbench, virtual_services
from rona_core.errors import CancelledError, StepBlockedError
from rona_core.evaluation.metrics import evaluate
from rona_core.evaluation.milling_metrics import milled_again
from rona_core.planning.rehearsal.rehearse import STEP_MM, rehearse
from rona_core.session.codec import digest
from rona_core.virtual.milling.milling_site import true_centers_bed
from tests.helpers.result_differences import assert_alike
from tests.helpers.session_file import reopened
from tests.helpers.ui.beds import bed_only
from tests.scenes import demo_parts


def rehearsal_of(session):
    return session.results.more["rehearsal"].value


def raiser(session):
    plan, _ = require_certified(session)
    return RaisedMilling(session, plan.verdicts[plan.chosen].roll_deg)


@pytest.fixture(scope="module")
def milled():
    return demo_parts.demo().with_result("rehearsal", None)


@pytest.fixture(scope="module")
def rehearsed():
    return demo_parts.demo()


def test_before_a_plan_there_is_nothing_to_rehearse(milled):
    demo = bed_only(milled)
    assert blocked(RehearseMilling, demo) is not None
    assert blocked(RehearseMilling, milled) is None
    bench = new_workbench(demo)
    with pytest.raises(StepBlockedError):
        bench.run(RehearseMilling())
    bench.close()


def test_the_floor_is_heard_and_the_verdict_says_what_followed(rehearsed):
    found = rehearsal_of(rehearsed)
    assert len(found.scans) >= 0.5 * found.asked > 0
    assert found.residual_mm > found.limit_mm
    assert found.most_n > 0.5
    said = rehearsal_verdict(found)
    assert f"scanned again at {found.asked} places in a certified motion of" in said
    assert ("higher than planned" in said) == (found.raised_mm > 0.0)
    assert rehearsal_ok(found) == (found.ceiling_mm is None and not found.stopped)


@pytest.mark.slow
def test_the_same_number_gives_the_same_rehearsal_and_another_gives_another(milled, rehearsed):
    bench = new_workbench(milled)
    bench.run(RehearseMilling())
    assert_alike(rehearsal_of(bench.session), rehearsal_of(rehearsed), "rehearsal")
    bench.run(RehearseMilling(number=2))
    assert digest(rehearsal_of(bench.session)) != digest(rehearsal_of(rehearsed))
    bench.close()


def test_a_file_keeps_it(rehearsed):
    loaded = reopened(rehearsed)
    assert digest(rehearsal_of(loaded)) == digest(rehearsal_of(rehearsed))
    assert rehearsal_stale(loaded) is None


def test_another_probe_makes_it_stale(rehearsed):
    bench = new_workbench(rehearsed)
    bench.dispatch(SetProbe(name="1MHz"))
    assert rehearsal_stale(bench.session) is not None
    bench.close()


def test_it_can_be_cancelled_and_leaves_nothing(milled):
    bench = new_workbench(milled)
    with pytest.raises(CancelledError):
        bench.run(RehearseMilling(), cancel=lambda: True)
    assert "rehearsal" not in bench.session.results.more
    bench.close()


def test_the_burr_goes_where_it_is_told_but_for_the_errors_of_a_robot(milled):
    way = milling_task(milled, raiser(milled), FloorScan(milled)).way
    site = milling_site(milled, 1)
    site.follow(way)
    path = milling_view(milled).path
    assert way.bottoms_bed[:, 2].min() == pytest.approx(path.bottoms_bed()[:, 2].min(), abs=1e-6)
    steps = np.linalg.norm(np.diff(way.bottoms_bed, axis=0), axis=1)
    assert np.median(steps) == pytest.approx(STEP_MM, rel=0.1)
    middles = way.bottoms_bed + way.radii_mm[:, None] * (0.0, 0.0, 1.0)
    scene = site._scene
    off = np.linalg.norm(true_centers_bed(scene, site._model, way, site._ordinal) - middles, axis=1)
    assert 0.0 < np.median(off) < 3.0
    # errors of one place change little: the burr does not jump about
    assert np.median(np.abs(np.diff(off))) < 0.05


def test_without_a_virtual_patient_there_is_no_bone_to_rehearse_on(milled, tmp_path):
    services = replace(virtual_services(), rehearse=None)
    bench = Workbench(milled, services, tmp_path)
    with pytest.raises(StepBlockedError, match="no virtual bone"):
        bench.run(RehearseMilling())
    bench.close()


@pytest.mark.slow
def test_the_burr_goes_the_same_way_once_more_for_the_figures(rehearsed):
    found, site = rehearsal_of(rehearsed), milling_site(rehearsed, 1)
    task = milling_task(rehearsed, raiser(rehearsed), FloorScan(rehearsed))
    rehearse(task, site, floor_detector(rehearsed, task.way.T_base_bed))
    again = milled_again(rehearsed, found, site._scene)
    np.testing.assert_array_equal(again.least_mm, site.least_mm)
    np.testing.assert_array_equal(again.left_bone().top_mm, site.left_bone().top_mm)
    figures = evaluate(rehearsed, site._scene)
    assert figures["rehearsal_residual_true_mm"] == min(site.least_mm) > 0.0
    assert figures["rehearsal_residual_mm"] == found.residual_mm
    assert abs(figures["rehearsal_implant_high_mm"] - figures["rehearsal_raised_mm"]) < 1.0
    assert 0.0 <= figures["rehearsal_rock_mm"] < 0.3
