"""The burr of step 10: registered in its seat, used by the milling, stale, and missed in words."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.app.dependencies.judge import blocked, judge_part
from rona_core.app.dependencies.staleness import required, stale_reason
from rona_core.app.steps.implant.burr.derivation import KNOWN_BURR
from rona_core.app.steps.implant.burr.messages import RegisterBurr, StartBurrCapture
from rona_core.app.steps.implant.burr.step import burr_words
from rona_core.app.steps.implant.derivation import EXECUTION
from rona_core.app.steps.implant.messages import PlaceBed
from rona_core.app.steps.implant.rehearsal import FloorScan, RaisedMilling, milling_task
from rona_core.app.steps.implant.view import (
    UNREGISTERED,
    milling_model,
    milling_view,
    placed_turns,
    verdict,
)
from rona_core.app.steps.setup.messages import SetSeed, SetWorld
from rona_core.app.steps.tool.messages import RegisterTool, StartToolCapture
from rona_core.compose import build_virtual_rig, new_workbench
from rona_core.errors import InvalidInputError
from rona_core.session.codec import digest
from rona_core.session.document import Session
from rona_core.virtual.milling.milling_site import true_centers_bed
from tests.helpers.derived import derived
from tests.helpers.session_file import reopened


def burr_of(session):
    return session.results.get("burr").value


def again(session):
    """Return the command that lays the bed where it lies."""
    bed = session.results.get("bed").value
    at = bed.placed.placement
    return PlaceBed(at.u_mm, at.v_mm, implant=bed.implant, **placed_turns(bed))


def registered(seed, **world):
    bench = new_workbench(Session())
    bench.dispatch(SetSeed(seed))
    bench.dispatch(SetWorld(**world))
    bench.run(StartToolCapture(n_pivot=12, n_translate=4))
    bench.run(StartBurrCapture())
    truth = bench.rig().scene.world.spindle_off_tip
    made = bench.session
    bench.close()
    return made, truth


@pytest.mark.slow
def test_the_seat_tells_where_the_tip_is_as_surely_as_it_says():
    squares = []
    for seed in range(33000, 33004):
        session, truth = registered(seed, spindle_mm=1.5)
        found = burr_of(session)
        off = found.offset_tip - truth
        squares.append(off @ np.linalg.solve(found.covariance, off) / 3.0)
        assert np.linalg.norm(off) < 3.0 * found.tip_sigma_mm
        assert found.tip_sigma_mm < 0.25 * np.linalg.norm(truth)
        assert found.verdict == "good"
        assert found.tracker_mm < 2.5 * found.tracker_sigma_mm
    assert 0.1 < np.mean(squares) < 3.0


def test_a_perfect_robot_and_an_exact_spindle_leave_chuck_and_seat_alone():
    session, _ = registered(33010, profile="nominal", robot_mm=0.0, spindle_mm=0.0)
    assert np.linalg.norm(burr_of(session).offset_tip) < 0.3
    assert burr_of(session).rmse_mm < 0.15


def test_it_is_kept_in_a_file_and_computed_from_it_again(bench):
    bench.dispatch(RegisterBurr())  # computed here: another processor rounds otherwise
    made = bench.session
    back = reopened(made)
    assert digest(back.captures.get("burr")) == digest(made.captures.get("burr"))
    assert digest(burr_of(back)) == digest(burr_of(made))
    assert stale_reason("burr", back) is None
    assert digest(derived("burr", back, RegisterBurr())) == digest(burr_of(back))


def test_the_milling_goes_where_the_registered_tip_is(demo):
    view, offset = milling_view(demo), burr_of(demo).offset_tip
    model = milling_model(demo, view)
    assert model.tool.burr_offset_tip == pytest.approx(tuple(offset))
    plain = milling_model(demo.with_result("burr", None), view)
    assert plain.tool.burr_offset_tip == (0.0, 0.0, 0.0)
    moved = plain.T_flange_tip.inv() @ model.T_flange_tip
    np.testing.assert_allclose(moved.translation, offset, atol=1e-12)
    # in truth the burr is off by what the registration does not know, instead of all of it
    way, scene = (
        milling_task(demo, RaisedMilling(demo, 0.0), FloorScan(demo)).way,
        build_virtual_rig(demo.setup).scene,
    )
    truth = scene.world.spindle_off_tip
    corrected, drawn = (true_centers_bed(scene, one, way, 100_001) for one in (model, plain))
    shifts = np.linalg.norm(corrected - drawn, axis=1)
    np.testing.assert_allclose(shifts, np.linalg.norm(offset), atol=1e-6)
    assert np.linalg.norm(truth - offset) < 3.0 * burr_of(demo).tip_sigma_mm


def test_without_it_a_bed_is_less_sure_and_the_verdict_says_why(demo, bench):
    bench.dispatch(again(demo))
    known = bench.session.results.get("bed").value
    other = new_workbench(demo.with_result("burr", None))
    other.dispatch(again(demo))
    missed = other.session.results.get("bed").value
    other.close()
    assert missed.placed.probability + 0.005 < 0.99 < known.placed.probability
    assert UNREGISTERED in verdict(missed)
    assert UNREGISTERED not in verdict(known)
    assert known.burr_sigma_mm == burr_of(demo).tip_sigma_mm
    assert missed.burr_sigma_mm is None
    assert required(EXECUTION, other.session).depth_mm > 2.0 * required(EXECUTION, demo).depth_mm


def test_registering_it_again_makes_bed_and_milling_stale(bench):
    for name in ("bed", "milling", "rehearsal"):
        assert stale_reason(name, bench.session) is None
    bench.dispatch(RegisterBurr(exclude=(0, 1)))
    assert not burr_of(bench.session).used[:2].any()
    for name in ("bed", "milling", "rehearsal"):
        assert "the registration of the burr was computed anew" in stale_reason(name, bench.session)


def test_a_bed_of_a_file_that_knew_of_no_burr_stays_fresh_until_there_is_one(demo):
    def before(name, session):
        held = session.results.get(name)
        inputs = {key: value for key, value in held.inputs.items() if key != "burr"}
        return session.with_result(name, replace(held, inputs=inputs))

    old = demo.with_result("burr", None)
    for name in ("bed", "milling", "rehearsal"):
        old = before(name, old)
    assert stale_reason("bed", old) is None
    later = old.with_result("burr", demo.results.get("burr"))
    assert "placed without the registration of the burr" in stale_reason("bed", later)


def test_a_bad_or_stale_registration_is_not_used_and_says_so(demo, bench):
    assert KNOWN_BURR.read(demo) is burr_of(demo)
    assert "corrected" in burr_words(demo)
    slipped = replace(burr_of(demo), verdict="bad", reasons=("the tip left its seat",))
    bad = demo.with_result("burr", replace(demo.results.get("burr"), value=slipped))
    assert KNOWN_BURR.read(bad) is None
    assert "Not used: the tip left its seat" in burr_words(bad)
    bench.dispatch(RegisterTool(exclude=(3,)))
    assert KNOWN_BURR.read(bench.session) is None
    assert judge_part("burr", bench.session).state == "stale"
    assert burr_words(Session()) == ""


def test_a_slipped_pin_is_bad_and_too_few_poses_are_refused(demo, bench):
    with pytest.raises(InvalidInputError, match="at least 5 poses in its seat"):
        bench.dispatch(RegisterBurr(exclude=tuple(range(26))))
    with pytest.raises(InvalidInputError, match="there is no pose 99"):
        bench.dispatch(RegisterBurr(exclude=(99,)))
    capture = demo.captures.get("burr")
    qs = capture.joints.qs_rad.copy()
    qs[len(qs) // 2 :, 0] += np.deg2rad(0.5)  # about 5 mm from there on
    slipped = replace(capture, joints=replace(capture.joints, qs_rad=qs))
    other = new_workbench(demo.with_capture("burr", slipped))
    other.dispatch(RegisterBurr())
    assert burr_of(other.session).verdict == "bad"
    assert "left its seat" in " ".join(burr_of(other.session).reasons)
    other.close()


def test_it_asks_for_the_tool_first():
    assert "tool" in blocked(StartBurrCapture, Session()).reason
    assert blocked(RegisterBurr, Session()) is not None
