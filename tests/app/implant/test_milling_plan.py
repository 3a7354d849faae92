"""The milling of the demo's bed through the robot: planned, kept, stale, given away."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator
from scipy.ndimage import maximum_filter, minimum_filter

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.judge import blocked, step_states
from rona_core.app.dependencies.staleness import session_obstacles, stale_reason
from rona_core.app.steps.implant import view as milling_motion_module
from rona_core.app.steps.implant.export import EXPORTS, MOTIONS, offered
from rona_core.app.steps.implant.messages import PlanMilling
from rona_core.app.steps.implant.milling import robot_path_of
from rona_core.app.steps.implant.milling_plan import (
    milling_summary,
    milling_verdict,
    why_no_milling,
)
from rona_core.app.steps.implant.view import (
    bone_left_mm,
    bone_over_bed,
    layer_at,
    milling_duration_s,
    milling_joints_at,
    milling_model,
    milling_motion,
    milling_plan_of,
    milling_view,
    require_certified,
    way_at,
)
from rona_core.app.steps.setup.messages import SetWorkcell
from rona_core.compose import new_workbench
from rona_core.errors import InvalidInputError, StaleResultError, StepBlockedError
from rona_core.planning.milling.milling_path import Move
from rona_core.planning.milling.removal import RIDGE_MM
from rona_core.planning.robot_milling import milling_obstacles
from rona_core.robot.verification.tolerances import CuttingTolerances
from tests.helpers.session_file import reopened
from tests.helpers.ui.beds import bed_only, laid_astray
from tests.scenes import demo_parts


@pytest.fixture(scope="module")
def demo():
    return bed_only(demo_parts.demo())


@pytest.fixture(scope="module", params=["kept", pytest.param("made", marks=pytest.mark.slow)])
def milled(request, demo):
    """The milling of the demo session as it is kept, and one planned now."""
    if request.param == "kept":
        yield demo_parts.demo().with_result("rehearsal", None)
        return
    bench = new_workbench(demo)
    bench.run(PlanMilling())
    yield bench.session
    bench.close()


def with_plan(session, plan):
    held = replace(session.results.get("milling"), value=plan)
    return replace(session, results=session.results.with_("milling", held))


def test_the_demo_is_milled_with_a_certificate_for_what_stands_around(milled):
    plan, path = milling_plan_of(milled), robot_path_of(milling_view(milled)).cutting
    around = milling_obstacles(session_obstacles(milled), path)
    model = milling_model(milled, milling_view(milled))
    assert plan.certificate.certifies(plan.trajectory, model, around, CuttingTolerances())
    assert "certified" in milling_verdict(plan)
    assert milling_summary(plan) in step_states(milled)[-1].reason
    assert step_states(milled)[-1].state == "done"


def test_every_layer_ends_in_the_air_in_order(milled):
    plan, path = milling_plan_of(milled), milling_view(milled).path
    assert len(plan.layer_ends_s) == path.layers[-1] + 1
    assert (np.diff(plan.layer_ends_s) > 0.0).all()
    for layer, time_s in enumerate(plan.layer_ends_s):
        share = float(time_s) / milling_duration_s(milled)
        assert layer_at(milled, share) == (layer + 1, len(plan.layer_ends_s))
    ends = np.append(np.flatnonzero(np.diff(path.layers)), len(path) - 1)
    assert (path.moves[ends] == Move.RETRACT).all()
    (change,) = plan.changes_s
    first_rim = int(path.layers[np.flatnonzero(path.tools == 1)[0]])
    assert plan.layer_ends_s[first_rim - 1] < change < plan.layer_ends_s[first_rim]


def test_the_burr_is_where_its_place_is(milled):
    motion, view = milling_motion(milled), milling_view(milled)
    tips = view.tips_base()
    before = np.maximum(motion.places - 1, 0)
    cut = view.path.moves[motion.places] != Move.RETRACT
    a, b = tips[before[cut]], tips[motion.places[cut]]
    share = np.einsum("ij,ij->i", motion.tips_base[cut] - a, b - a)
    share /= np.maximum(np.einsum("ij,ij->i", b - a, b - a), 1e-12)
    nearest = a + np.clip(share, 0.0, 1.0)[:, None] * (b - a)
    assert np.linalg.norm(motion.tips_base[cut] - nearest, axis=1).max() < 0.1
    np.testing.assert_allclose(np.linalg.norm(motion.axes_base, axis=1), 1.0, atol=1e-9)
    assert (np.diff(motion.places) >= 0).all()
    assert motion.times_s[-1] == milling_duration_s(milled)


def test_joints_at_a_share_of_the_motion(milled):
    motion = milling_plan_of(milled).trajectory
    np.testing.assert_allclose(milling_joints_at(milled, 0.0), motion.qs_rad[0])
    row = len(motion.times_s) // 2
    share = float(motion.times_s[row] / motion.times_s[-1])
    np.testing.assert_allclose(milling_joints_at(milled, share), motion.qs_rad[row], atol=1e-9)


def test_the_bone_disappears_where_the_burr_has_been_and_is_gone_down_to_the_bed_at_last(milled):
    bone, view = bone_over_bed(milled), milling_view(milled)
    whole, done = bone_left_mm(milled, 0.0), bone_left_mm(milled, 1.0)
    np.testing.assert_array_equal(whole, bone.surface_mm)
    before = whole
    for share in np.linspace(0.0, 1.0, 12):
        left = bone_left_mm(milled, float(share))
        assert (left <= before + 2.0 * RIDGE_MM).all()  # cut at other places along a move
        before = left
    x, y = np.meshgrid(bone.x_mm, bone.y_mm, indexing="ij")
    depth = RegularGridInterpolator(
        (view.bed.x_mm, view.bed.y_mm), view.bed.depth_mm, bounds_error=False, fill_value=0.0
    )((x, y))
    flat = (maximum_filter(depth, 5) - minimum_filter(depth, 5) < 1e-9) & (depth > 0.0)
    assert flat.sum() > 100  # of the floor, away from walls
    np.testing.assert_allclose(-done[flat], depth[flat], atol=0.2)  # ridges between rings
    np.testing.assert_array_equal(done[depth == 0.0], whole[depth == 0.0])


def test_under_way_the_bone_is_cut_under_the_burr_and_not_ahead_of_it(milled):
    motion, view, bone = milling_motion(milled), milling_view(milled), bone_over_bed(milled)
    tips_bed = view.placed.T_base_bed.inv() @ motion.tips_base
    first = view.path.layers[motion.places] == 0
    cutting = np.flatnonzero(first & (view.path.moves[motion.places] == Move.CUT))
    row = int(cutting[len(cutting) // 2])
    left = bone_left_mm(milled, float(motion.times_s[row] / motion.times_s[-1]))
    i, j = (
        np.abs(a - p).argmin()
        for a, p in zip((bone.x_mm, bone.y_mm), tips_bed[row][:2], strict=True)
    )
    assert left[i, j] == pytest.approx(min(tips_bed[row][2], bone.surface_mm[i, j]), abs=0.1)
    end = bone.lowest_mm[1]
    assert np.count_nonzero(left > np.minimum(end, bone.surface_mm) + 0.05) > 50  # still to come


def test_a_session_file_keeps_the_plan_and_its_certificate(milled):
    again = reopened(milled)
    assert stale_reason("milling", again) is None
    plan = milling_plan_of(again)
    assert plan.may_move
    np.testing.assert_array_equal(plan.trajectory.qs_rad, milling_plan_of(milled).trajectory.qs_rad)


def test_other_surroundings_make_it_stale_and_the_bed_not(milled):
    bench = new_workbench(milled)
    surroundings = milled.setup.surroundings
    bench.dispatch(
        SetWorkcell(
            **{
                name: getattr(surroundings, name)
                for name in SetWorkcell.__dataclass_fields__
                if hasattr(surroundings, name)
            }
            | {"margin_mm": 21.0}
        )
    )
    session = bench.session
    bench.close()
    assert stale_reason("milling", session) is not None
    assert "milled in" not in step_states(session)[-1].reason
    assert set(offered(session)).isdisjoint(MOTIONS)
    with pytest.raises(StaleResultError):
        require_certified(session)


def test_the_motion_is_given_away_for_the_robot_it_was_certified_for_alone(milled, monkeypatch):
    known = milling_model(milled, milling_view(milled))
    longer = replace(known, arm=replace(known.arm, forearm_mm=500.0))
    plan = milling_plan_of(milled)
    other = with_plan(milled, replace(plan))  # what is remembered of the first is not asked
    monkeypatch.setattr(milling_motion_module, "milling_model", lambda *_: longer)
    assert set(offered(other)).isdisjoint(MOTIONS)
    with pytest.raises(StaleResultError, match="another robot"):
        REGISTRY.export(other, "milling_motion.csv")


def test_nothing_is_planned_for_a_bed_that_is_not_safe(demo):
    unsafe = laid_astray(demo)
    assert "safe" in blocked(PlanMilling, unsafe).reason
    assert blocked(PlanMilling, demo) is None


def test_what_is_not_certified_is_not_given_away_and_says_why(demo, milled):
    with pytest.raises(StepBlockedError, match="plan the milling"):
        REGISTRY.export(demo, "milling_motion.csv")
    plan = milling_plan_of(milled)
    refused = replace(plan, certificate=replace(plan.certificate, certified=False))
    with pytest.raises(StepBlockedError, match="the verifier refuses"):
        REGISTRY.export(with_plan(milled, refused), "milling_motion.csv")
    assert milling_summary(refused) == "milling refused by the verifier"
    stopped = tuple(
        replace(v, feasible=False, reason="reach", sentence="too far") for v in plan.verdicts
    )
    none = replace(plan, verdicts=stopped, chosen=-1, trajectory=None, certificate=None)
    assert f"none of {len(stopped)} rolls works ({len(stopped)} by reach)" in why_no_milling(none)
    assert milling_verdict(none).startswith("The robot cannot mill this bed: none of")
    assert milling_summary(none) == "no roll reaches it"
    session = with_plan(milled, none)
    assert milling_joints_at(session, 0.5) is None
    assert layer_at(session, 1.0) is None
    assert way_at(session, 1.0) is None
    assert bone_left_mm(session, 1.0) is None
    with pytest.raises(StepBlockedError, match="too far"):
        milling_motion(session)


def test_the_table_has_a_row_for_each_sample_and_urscript_is_for_ur_arms(milled):
    assert offered(milled) == tuple(
        one.name for one in EXPORTS if one.name != "milling_motion.script"
    )
    lines = REGISTRY.export(milled, "milling_motion.csv").decode().splitlines()
    lines = [line for line in lines if not line.startswith("#")]
    assert len(lines) == len(milling_plan_of(milled).trajectory.times_s) + 1
    assert lines[0].endswith("layer,burr_diameter_mm")
    layers, burrs_mm = zip(*(line.split(",")[-2:] for line in lines[1:]), strict=True)
    assert (layers[0], burrs_mm[0], burrs_mm[-1]) == ("0", "5", "2")
    assert sorted({int(layer) for layer in layers}) == list(range(int(layers[-1]) + 1))
    with pytest.raises(InvalidInputError, match="Universal Robots"):
        REGISTRY.export(milled, "milling_motion.script")
