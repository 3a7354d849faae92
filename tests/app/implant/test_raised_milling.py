"""Layers that end higher than planned: planned and certified anew, or milling ends before them."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.app.dependencies.staleness import session_obstacles
from rona_core.app.steps.implant import rehearsal
from rona_core.app.steps.implant.messages import RehearseMilling
from rona_core.app.steps.implant.milling import plan_view, raised_view, robot_path_of
from rona_core.app.steps.implant.rehearsal import (
    FloorScan,
    RaisedMilling,
    derive_rehearsal,
    milling_task,
    rehearsal_ok,
    rehearsal_verdict,
)
from rona_core.app.steps.implant.view import milling_model, milling_view, require_certified
from rona_core.compose import milling_site
from rona_core.devices.protocols import never, silent
from rona_core.errors import CancelledError
from rona_core.evaluation.milling_metrics import milled_again, rehearsal_figures
from rona_core.evaluation.truth import truth_of
from rona_core.planning.rehearsal.milled_floor import FloorLine
from rona_core.planning.robot_milling import milling_obstacles
from rona_core.robot.planning.plan_motion import CuttingPlanSettings
from rona_core.robot.verification.verifier import verify_cutting
from rona_core.session.codec import digest
from tests.helpers.session_file import reopened
from tests.scenes import demo_parts

THICK_MM = 1.0  # more bone than the planned bed is sure to leave


@pytest.fixture(scope="module")
def milled():
    return demo_parts.demo()


def roll_of(session):
    plan, _ = require_certified(session)
    return plan.verdicts[plan.chosen].roll_deg


def asked_for_more(monkeypatch):
    """Let a rehearsal ask for more bone than planned, and less than the layer before leaves."""

    def thicker(session, raised, floor_scan):
        task = milling_task(session, raised, floor_scan)
        residual_mm = float(np.median(task.mapped(task.way.bottoms_bed)[1].min(axis=0)))
        return replace(task, limit_mm=residual_mm + 0.3)

    monkeypatch.setattr(rehearsal, "milling_task", thicker)


def rehearsed(session):
    site = milling_site(session, 1)
    found = derive_rehearsal(session, RehearseMilling(), site, progress=silent, cancel=never)
    held = replace(session.results.more["rehearsal"], value=found)
    return session.with_result("rehearsal", held), found, site


def test_planning_of_layers_and_of_the_re_scan_can_be_cancelled(milled):
    with pytest.raises(CancelledError):
        RaisedMilling(milled, roll_of(milled), cancel=lambda: True)(-1, -2.0)
    line = FloorLine(np.array([(0.0, 0.0, 5.0), (0.0, 0.0, -2.0), (0.0, 0.0, 5.0)]), np.array([1]))
    with pytest.raises(CancelledError):
        FloorScan(milled, cancel=lambda: True)(line)


def test_a_raised_motion_is_certified_and_ends_at_its_height(milled):
    raised, view = RaisedMilling(milled, roll_of(milled)), milling_view(milled)
    ceiling = view.path.bottoms_bed()[:, 2].min() + THICK_MM
    way = raised(5, ceiling)
    assert raised.plan.may_move
    assert way.bottoms_bed[:, 2].min() == pytest.approx(ceiling, abs=1e-9)
    assert way.layers.min() > 5
    left = raised_view(view, 5, ceiling)
    model, cutting = milling_model(milled, left), robot_path_of(left).cutting
    around = milling_obstacles(session_obstacles(milled), cutting)
    assert verify_cutting(model, raised.plan.trajectory, cutting, obstacles=around).certified


def test_a_raised_motion_other_than_the_certified_one_is_refused(milled, monkeypatch):
    """The planted fault: half a degree of one joint, after the verifier has seen the motion."""
    one_roll = CuttingPlanSettings(n_rolls=1, roll_from_deg=roll_of(milled))

    def tampered(session, view, settings, **options):
        plan = plan_view(session, view, one_roll, **options)
        qs = plan.trajectory.qs_rad + np.deg2rad((0.5, 0.0, 0.0, 0.0, 0.0, 0.0))
        return replace(plan, trajectory=replace(plan.trajectory, qs_rad=qs))

    monkeypatch.setattr(rehearsal, "plan_view", tampered)
    raised = RaisedMilling(milled, roll_of(milled))
    ceiling = milling_view(milled).path.bottoms_bed()[:, 2].min() + THICK_MM
    assert raised(5, ceiling) is None
    assert not raised.plan.may_move


def test_the_verdict_tells_what_became_of_raised_layers(milled):
    plan, _ = require_certified(milled)
    higher = replace(
        milled.results.more["rehearsal"].value,
        ceiling_mm=-1.0,
        raised_mm=0.5,
        raised_plan=plan,
        stopped=False,
    )
    minutes, seconds = divmod(round(plan.trajectory.duration_s), 60)
    said = rehearsal_verdict(higher)
    assert (
        f"planned anew and certified ({minutes} min {seconds:02d} s), ended 0.50 mm higher" in said
    )
    assert not rehearsal_ok(higher)
    qs = plan.trajectory.qs_rad + np.deg2rad((0.5, 0.0, 0.0, 0.0, 0.0, 0.0))
    other = replace(plan, trajectory=replace(plan.trajectory, qs_rad=qs))
    said = rehearsal_verdict(replace(higher, raised_plan=other))
    assert "the robot cannot mill them so: the verifier refuses" in said
    assert "ended with the last finished layer, 0.50 mm higher" in said
    assert "; nothing was milled, and" in rehearsal_verdict(
        replace(higher, raised_plan=other, steps=0)
    )
    assert "planned anew" not in rehearsal_verdict(replace(higher, raised_plan=None))


@pytest.mark.slow
def test_raised_layers_are_milled_in_their_own_certified_motion(milled, monkeypatch):
    asked_for_more(monkeypatch)
    session, found, site = rehearsed(milled)
    plan = found.raised_plan
    assert plan.may_move
    assert found.raised_mm > 0.3
    assert [verdict.roll_deg for verdict in plan.verdicts] == [roll_of(milled)]  # no search
    view = milling_view(milled)
    left = raised_view(view, found.pause, found.ceiling_mm)
    lowest = left.path.bottoms_bed()[:, 2].min()
    assert lowest == pytest.approx(found.ceiling_mm, abs=1e-9)
    planned = view.path.bottoms_bed()[:, 2].min()
    assert lowest >= planned + found.raised_mm - 0.01  # layers before it may lie lower
    # the motion itself: it never goes below that height, and it is no part of the planned one
    model, cutting = milling_model(milled, left), robot_path_of(left).cutting
    around = milling_obstacles(session_obstacles(milled), cutting)
    assert verify_cutting(model, plan.trajectory, cutting, obstacles=around).certified
    tips = cutting.T_base_bed.inv() @ (
        (model.forward(plan.trajectory.qs_rad) @ model.T_flange_tip).translations
    )
    assert lowest - 0.05 <= tips[:, 2].min() <= lowest + 0.2
    planned_path = robot_path_of(view).cutting
    assert not verify_cutting(model, plan.trajectory, planned_path, obstacles=around).certified
    # what is told of it
    minutes, seconds = divmod(round(plan.trajectory.duration_s), 60)
    said = rehearsal_verdict(found)
    assert f"planned anew and certified ({minutes} min {seconds:02d} s)" in said
    assert not rehearsal_ok(found)
    # a file keeps it, and the figures are those of this way
    loaded = reopened(session)
    assert digest(loaded.results.more["rehearsal"].value) == digest(found)
    again = milled_again(loaded, found, site._scene)
    np.testing.assert_array_equal(again.least_mm, site.least_mm)
    figures = rehearsal_figures(loaded, truth_of(loaded, site._scene))
    assert figures["rehearsal_raised_s"] == plan.trajectory.duration_s
    assert figures["rehearsal_residual_true_mm"] == min(site.least_mm)


@pytest.mark.slow
def test_a_motion_other_than_the_certified_one_is_not_milled(milled, monkeypatch):
    """The planted fault: half a degree of one joint, after the verifier has seen the motion."""

    def tampered(*args, **kwargs):
        plan = plan_view(*args, **kwargs)
        qs = plan.trajectory.qs_rad + np.deg2rad((0.5, 0.0, 0.0, 0.0, 0.0, 0.0))
        return replace(plan, trajectory=replace(plan.trajectory, qs_rad=qs))

    asked_for_more(monkeypatch)
    monkeypatch.setattr(rehearsal, "plan_view", tampered)
    session, found, site = rehearsed(milled)
    heights = milling_view(milled).path.bottoms_bed()[:, 2]
    layers = milling_view(milled).path.layers
    finished = heights[layers <= found.pause].min()
    assert not found.raised_plan.may_move
    assert found.steps == len(site.least_mm)
    assert found.raised_mm == pytest.approx(finished - heights.min(), abs=1e-6)
    said = rehearsal_verdict(found)
    assert "the robot cannot mill them so" in said
    assert "ended with the last finished layer" in said
    np.testing.assert_array_equal(milled_again(session, found, site._scene).least_mm, site.least_mm)
    figures = rehearsal_figures(session, truth_of(session, site._scene))
    assert figures["rehearsal_raised_s"] is None
    whole = replace(found, steps=0)
    assert "so: the verifier refuses" in rehearsal_verdict(whole)
    assert "; nothing was milled, and" in rehearsal_verdict(whole)
    assert milled_again(session, whole, site._scene) is None


@pytest.mark.slow
def test_where_the_planned_roll_fails_another_one_is_searched(milled):
    plan, _ = require_certified(milled)
    fails = min(plan.verdicts, key=lambda verdict: verdict.margin)
    raised = RaisedMilling(milled, fails.roll_deg)
    ceiling = milling_view(milled).path.bottoms_bed()[:, 2].min() + THICK_MM
    way = raised(5, ceiling)
    assert len(raised.plan.verdicts) == len(plan.verdicts)
    assert raised.plan.may_move
    assert way.bottoms_bed[:, 2].min() == pytest.approx(ceiling, abs=1e-9)
    assert way.layers.min() > 5


def test_nothing_left_to_mill_is_no_motion(milled):
    raised = RaisedMilling(milled, roll_of(milled))
    assert raised(-1, milling_view(milled).surface_mm) is None
    assert raised.plan is None


@pytest.mark.slow
def test_files_of_earlier_versions_have_raised_layers_without_a_plan(milled, monkeypatch):
    asked_for_more(monkeypatch)
    session, found, site = rehearsed(milled)
    earlier = replace(found, raised_plan=None)
    held = replace(session.results.more["rehearsal"], value=earlier)
    loaded = reopened(session.with_result("rehearsal", held))
    assert loaded.results.more["rehearsal"].value.raised_plan is None
    assert "planned anew" not in rehearsal_verdict(earlier)
    figures = rehearsal_figures(loaded, truth_of(loaded, site._scene))
    assert figures["rehearsal_raised_mm"] == found.raised_mm
    assert "rehearsal_residual_true_mm" not in figures
