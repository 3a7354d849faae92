"""The whole procedure on a virtual set-up: figures, replay, honesty about ground truth."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rona_core.app.dependencies.judge import step_states
from rona_core.app.procedure import TO_MAPS, run_procedure
from rona_core.app.runtime.session_step import replay
from rona_core.app.runtime.workbench import Workbench
from rona_core.app.steps.path.messages import StartPathCapture
from rona_core.app.steps.roll.messages import ChooseRoll, StartRollSearch
from rona_core.app.steps.roll.view import joint_curves
from rona_core.app.steps.scan.messages import StartScan
from rona_core.app.steps.setup.messages import SetRobot, SetToolVisible, SetTracker
from rona_core.app.steps.surface.messages import StartSurfaceCapture
from rona_core.app.steps.tool.messages import StartToolCapture
from rona_core.compose import build_virtual_rig, evaluate_virtual, new_workbench, run_demo
from rona_core.errors import NotReachableError, RonaError, StepBlockedError
from rona_core.evaluation.map_metrics import outer_errors_mm
from rona_core.evaluation.truth import Truth, scan_postures
from rona_core.session.codec import digest
from rona_core.session.document import Session
from rona_core.session.files import load_session, save_session
from tests.scenes import demo_parts

pytestmark = pytest.mark.slow

BLOCKED = """
import sys
class Wall:
    def find_spec(self, name, path=None, target=None):
        if name.startswith(("rona_core.virtual", "rona_core.evaluation", "rona_core.compose")):
            raise ImportError(f"{name} must not be needed here")
sys.meta_path.insert(0, Wall())
from rona_core.app.runtime.session_step import replay
from rona_core.session.files import load_session
results = replay(load_session(sys.argv[1]))
assert not any(name.startswith("rona_core.virtual") for name in sys.modules)
sys.stdout.write(" ".join(f"{r.result}={r.same}" for r in results))
"""


@pytest.fixture(scope="module")
def demo() -> tuple[Session, dict]:
    return run_demo(3)


@pytest.fixture(scope="module")
def registered() -> Workbench:
    """A workbench with tool and pointer calibrated."""
    return new_workbench(demo_parts.registered())


def opened(session: Session) -> Workbench:
    return new_workbench(session)


@pytest.mark.ci
def test_the_procedure_completes_within_the_goals(demo):
    session, figures = demo
    assert figures["completed"] is True
    states = [state.state for state in step_states(session)]
    assert states == ["done"] * 9 + ["ready"]  # nobody asked for an implant
    assert figures["surface_rms_mm"] <= 1.5
    assert figures["outer_rms_mm"] <= 0.6
    assert figures["thickness_rms_mm"] <= 1.0
    assert figures["inner_coverage_fraction"] >= 0.8
    assert figures["inner_coverage_fraction"] > figures["inner_coverage_one_pass_fraction"] >= 0.2
    assert len(session.captures.second) == 4
    assert figures["second_pass_points"] == sum(len(one.scans) for one in session.captures.second)
    of_loaded = {"skull_registration_tre_mm", "skull_registration_sigma_mm"}
    assert len(session.results.speed.value) == 3
    nothing = {key for key, value in figures.items() if value is None}
    by_hand = {key for key in figures if key.startswith("sono_")}  # nobody scanned by hand
    assert len(by_hand) == 7
    of_bed = {key for key in figures if key.startswith("bed_")}  # nobody asked for one
    assert len(of_bed) == 4
    of_burr = {key for key in figures if key.startswith("burr_")}  # nor registered it
    assert len(of_burr) == 2
    of_rehearsal = {key for key in figures if key.startswith("rehearsal_")}
    assert len(of_rehearsal) == 6
    assert nothing == {
        "failed_step",
        "reason",
        "second_pass_reason",
        "references_reason",
        "milling_reason",
        *of_bed,
        *of_burr,
        *of_rehearsal,
        *of_loaded,
        *by_hand,
    }


@pytest.mark.ci
def test_saving_and_loading_keeps_every_bit(demo, tmp_path):
    session, _ = demo
    back = load_session(save_session(session, tmp_path / "demo.rona"))
    assert digest(back) == digest(session)


@pytest.mark.slow
def test_every_result_follows_from_the_captures_without_the_virtual_world(demo, tmp_path):
    path = save_session(demo[0], tmp_path / "demo.rona")
    done = subprocess.run(
        [sys.executable, "-c", BLOCKED, str(path)],
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[3],
        check=False,
    )
    assert done.returncode == 0, done.stderr
    results = (
        "tool pointer surface path smoothing roll landmarks mounting speed detection second".split()
    )
    results += ["second_detection", "maps"]
    assert done.stdout.split() == [f"{name}=True" for name in results]


def test_a_changed_capture_changes_the_result(demo):
    session, _ = demo
    scans = session.captures.scan.scans
    shifted = replace(scans, rf=np.roll(scans.rf, 3, axis=1))
    captures = replace(session.captures, scan=replace(session.captures.scan, scans=shifted))
    tampered = replace(session, captures=captures)
    # a stale result is not compared: pretend that it was computed from the changed capture
    from rona_core.app.dependencies.staleness import input_digests

    found = replace(session.results.detection, inputs=input_digests("detection", tampered))
    tampered = replace(tampered, results=replace(tampered.results, detection=found, maps=None))
    replayed = {r.result: r for r in replay(tampered)}
    assert not replayed["detection"].same
    assert replayed["smoothing"].same


def test_a_covered_pointer_yields_no_points(registered):
    bench = opened(registered.session)
    bench.dispatch(SetToolVisible("pointer6d", False))
    with pytest.raises(RonaError, match="pointer"):
        bench.run(StartSurfaceCapture(duration_s=5.0))
    (stroke,) = bench.session.captures.surface
    assert stroke.marker.n_frames > 100
    assert len(stroke.marker.times_s) == 0
    assert bench.session.results.surface is None


def as_if_recorded_now(session):
    """Return the session with tool and pointer as if they had been recorded with its set-up."""
    from rona_core.app.dependencies.staleness import capture_setup_digest, input_digests

    for kind in ("tool", "pointer"):
        capture = getattr(session.captures, kind)
        capture = replace(capture, setup_digest=capture_setup_digest(kind, session))
        session = replace(session, captures=replace(session.captures, **{kind: capture}))
        made = replace(getattr(session.results, kind), inputs=input_digests(kind, session))
        session = replace(session, results=replace(session.results, **{kind: made}))
    return session


def test_the_bias_of_the_tracker_moves_the_cloud(registered):
    """The same hand, with and without the bias field: the clouds differ by what it is."""
    clouds = []
    for profile in ("polaris", "ideal"):
        set_up = opened(registered.session)
        set_up.dispatch(SetTracker(profile))
        bench = opened(as_if_recorded_now(set_up.session))
        bench.run(StartSurfaceCapture(duration_s=10.0))
        clouds.append(bench.session.results.surface.value.points_base)
    apart = clouds[0] - clouds[1]
    shift = np.linalg.norm(apart.mean(axis=0))
    assert shift > 0.05, "a bias does not average out"
    assert np.linalg.norm(apart - apart.mean(axis=0), axis=1).mean() < 3 * shift + 0.5


def test_the_error_of_the_robot_counts_absolutely_but_not_for_the_same_robot(demo):
    """The robot off and on: one figure moves by its systematic error, the other hardly."""
    session, with_error = demo
    bench = new_workbench(Session(setup=replace(Session().setup, seed=3)))
    bench.dispatch(SetRobot(errors=False))

    assert run_procedure(bench, TO_MAPS).completed
    without = bench.figures()
    bench.close()
    assert without["outer_rms_mm"] == pytest.approx(without["outer_same_robot_rms_mm"], abs=1e-9)
    points = session.results.maps.value.outer.points_base()
    truth = Truth(build_virtual_rig(session.setup).scene, scan_postures(session))
    absolute, same_robot = (outer_errors_mm(points, truth, which) for which in (False, True))
    assert np.abs(absolute - same_robot).mean() > 0.02
    same = without["outer_same_robot_rms_mm"]
    assert with_error["outer_same_robot_rms_mm"] == pytest.approx(same, abs=0.05)


def test_an_uncertified_plan_is_not_executed(demo):
    session, _ = demo
    plan = session.results.roll.value
    bent = plan.trajectory.qs_rad.copy()
    bent[len(bent) // 2, 3] += np.deg2rad(158.0)
    forged = replace(plan, trajectory=replace(plan.trajectory, qs_rad=bent))
    results = replace(session.results, roll=replace(session.results.roll, value=forged))
    bench = opened(replace(session, results=results))
    with pytest.raises(NotReachableError, match="another motion"):
        bench.run(StartScan())
    assert bench.session.captures.scan is session.captures.scan
    bench.close()


def test_another_roll_is_planned_and_a_failing_one_refused_with_its_reason(demo):
    session, _ = demo
    bench = opened(session)
    verdicts = session.results.roll.value.search.verdicts
    works = session.results.roll.value.search.ranked[3].index
    fails = next(i for i, v in enumerate(verdicts) if not v.feasible)
    bench.dispatch(ChooseRoll(works))
    assert bench.session.results.roll.value.search.chosen == works
    assert bench.session.results.roll.value.may_move
    states = {s.name: s.state for s in step_states(bench.session)}
    assert (states["roll"], states["scan"], states["maps"]) == ("done", "stale", "stale")
    assert {r.result: r.same for r in replay(bench.session)}["roll"]
    pair = next(p for p in bench.session.results.roll.value.search.ranked if p.branch != 0)
    bench.dispatch(ChooseRoll(pair.index, pair.branch))
    taken = bench.session.results.roll.value
    assert (taken.search.chosen, taken.search.branch) == (pair.index, pair.branch)
    assert {r.result: r.same for r in replay(bench.session)}["roll"]
    bench.dispatch(ChooseRoll(works))
    with pytest.raises(NotReachableError, match=r"joint|reach|singular"):
        bench.dispatch(ChooseRoll(fails))
    assert bench.session.results.roll.value.search.chosen == works
    bench.close()


def test_a_varying_roll_is_planned_replayed_drawn_and_executed(demo):
    session, _ = demo
    bench = opened(session)
    bench.run(StartRollSearch(mode="variable"))
    plan = bench.session.results.roll.value
    assert (plan.search.mode, plan.search.chosen) == ("variable", -1)
    assert plan.may_move
    assert {r.result: r.same for r in replay(bench.session)}["roll"]
    state = next(s for s in step_states(bench.session) if s.name == "roll")
    assert f"varying over {plan.search.roll_variation_deg:.0f}°" in state.reason
    curves = joint_curves(bench.session, None)
    assert curves.feasible
    np.testing.assert_allclose(
        curves.joints_deg, np.rad2deg(plan.search.chosen_curve_rad), atol=1e-4
    )
    other = joint_curves(bench.session, 0)
    np.testing.assert_allclose(other.joints_deg, np.rad2deg(plan.search.curves_rad[0]), atol=1e-4)
    bench.run(StartScan())
    assert len(bench.session.captures.scan.scans) > 100
    figures = evaluate_virtual(bench.session, bench.rig())
    assert figures["roll_mode"] == "variable"
    assert figures["roll_variation_deg"] == plan.search.roll_variation_deg
    assert figures["min_joint_margin_deg"] > 0.0
    bench.dispatch(ChooseRoll(plan.search.ranked[0].index))
    assert bench.session.results.roll.value.search.mode == "constant"
    bench.close()


def test_registering_again_makes_what_follows_stale(demo):
    session, _ = demo
    bench = opened(session)
    bench.run(StartToolCapture(n_pivot=20))
    states = {s.name: s.state for s in step_states(bench.session)}
    assert states["tool"] == "done"
    assert {states[s] for s in ("surface", "path", "smoothing", "roll", "scan", "maps")} == {
        "stale"
    }
    bench.close()


def test_stopping_a_capture_keeps_what_came(registered):
    bench = opened(registered.session)
    asked = {"n": 0}

    def cancel() -> bool:
        asked["n"] += 1
        return asked["n"] > 100

    bench.run(StartPathCapture(), cancel=cancel)
    capture = bench.session.captures.path
    assert capture.partial
    assert 50 < capture.marker.n_frames < 150
    assert bench.session.results.path is None
    bench.close()


def test_steps_are_blocked_until_their_turn():
    bench = new_workbench(Session())
    states = {s.name: (s.state, s.reason) for s in step_states(bench.session)}
    assert [states[s][0] for s in ("setup", "tool", "pointer")] == ["done", "ready", "ready"]
    assert states["surface"] == ("blocked", "first register the tool (step 2)")
    for activity in (StartSurfaceCapture(), StartPathCapture(), StartRollSearch(), StartScan()):
        with pytest.raises(StepBlockedError, match="first"):
            bench.run(activity)
    assert bench.session.log == ()
    bench.close()
