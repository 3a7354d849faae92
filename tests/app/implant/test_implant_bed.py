"""Step 10 in a session: searched, laid by hand, refused, stale, milled."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.app.declarations.figures import percent
from rona_core.app.dependencies.judge import blocked, step_states
from rona_core.app.dependencies.staleness import required, stale_reason
from rona_core.app.messages.message import message_from
from rona_core.app.steps.implant.derivation import EXECUTION
from rona_core.app.steps.implant.messages import BURRS_MM, PlaceBed, StartBedSearch
from rona_core.app.steps.implant.view import floor_base, milling_view, verdict
from rona_core.app.steps.setup.messages import SetProbe
from rona_core.errors import (
    CancelledError,
    InvalidInputError,
    StaleResultError,
    StepBlockedError,
)
from rona_core.mapping.accuracy.probe_place import repeatability_mm
from rona_core.planning.implants.implant import implant_named
from rona_core.planning.milling.plan_milling import milling_settings
from rona_core.session.codec import digest
from rona_core.session.document import Session
from tests.helpers.derived import derived
from tests.helpers.session_file import reopened


def bed_of(session):
    return session.results.get("bed").value


def again(bed, **other):
    """Return the command that lays a bed where it lies."""
    p = bed.placed.placement
    turns = np.rad2deg((p.angle_rad, p.tilt_x_rad, p.tilt_y_rad)).tolist()
    named = dict(
        zip(("u_mm", "v_mm", "angle_deg", "tilt_x_deg", "tilt_y_deg"),
            (p.u_mm, p.v_mm, *turns), strict=True)
    )  # fmt: skip
    return PlaceBed(**{**named, "implant": bed.implant, "lift_mm": bed.lift_mm, **other})


def test_a_bed_laid_by_hand_where_the_search_found_it_is_judged_alike(demo, bench):
    found = bed_of(demo)
    bench.dispatch(again(found))
    laid = bed_of(bench.session)
    assert laid.placed.probability == pytest.approx(found.placed.probability, abs=1e-6)
    assert laid.placed.residual_mm == pytest.approx(found.placed.residual_mm, abs=1e-6)
    T_a_b = laid.placed.T_base_bed.inv() @ found.placed.T_base_bed
    np.testing.assert_allclose(T_a_b.matrix(), np.eye(4), atol=1e-9)
    assert (laid.refusal, laid.burr_mm) == (None, found.burr_mm)
    assert step_states(bench.session)[-1].state == "done"


def test_a_better_lift_or_a_lower_limit_never_makes_a_bed_less_sure(demo, bench):
    found = bed_of(demo)
    sure = []
    for lift_mm, limit_mm in ((0.0, 1.0), (0.0, 0.5), (1.0, 0.5), (2.0, 0.5)):
        bench.dispatch(again(found, lift_mm=lift_mm, limit_mm=limit_mm))
        sure.append(bed_of(bench.session).placed.probability)
    assert sure == sorted(sure)
    assert sure[0] < sure[-1]


def test_a_bed_beyond_the_maps_is_refused_and_the_step_stays_open(demo, bench):
    bench.dispatch(again(bed_of(demo), u_mm=60.0))
    bed, state = bed_of(bench.session), step_states(bench.session)[-1]
    assert "both boundaries are mapped" in bed.refusal
    assert (bed.placed.residual_mm, bed.placed.probability, bed.placed.lacks) == (None, 0.0, "maps")
    assert state.state == "ready"
    assert state.reason == f"{bed.implant} does not fit safely"
    with pytest.raises(StepBlockedError, match="choose another place"):
        milling_view(bench.session)
    assert "does not fit safely" in verdict(bed)


def test_bone_that_is_too_thin_is_told_with_its_figures(demo, bench):
    bench.dispatch(again(bed_of(demo), implant="BCI 601", lift_mm=0.0))
    bed = bed_of(bench.session)
    assert bed.placed.lacks == "bone"
    assert f"{bed.placed.residual_mm:.2f} mm would be left" in bed.refusal


@pytest.mark.parametrize(
    "shape",
    [lambda u, v: ((u, v),), lambda u, v: ((u - 9, v - 9), (u + 9, v + 9)),
     lambda u, v: ((u - 2, v), (u + 2, v), (u, v + 2), (u - 2, v))],
    ids=["point", "line", "area"],
)  # fmt: skip
def test_a_bed_keeps_away_from_what_is_to_be_avoided(demo, bench, shape):
    p = bed_of(demo).placed.placement
    bench.dispatch(again(bed_of(demo), avoid=(shape(p.u_mm, p.v_mm),)))
    bed = bed_of(bench.session)
    assert bed.placed.lacks == "distance"
    assert "to be avoided" in bed.refusal
    bench.dispatch(again(bed_of(demo), avoid=(shape(p.u_mm + 60.0, p.v_mm),)))
    assert bed_of(bench.session).refusal is None
    held = bench.session.results.get("bed")
    assert message_from(held.message, dict(held.arguments)).avoid == (shape(p.u_mm + 60.0, p.v_mm),)


def test_a_search_can_be_cancelled(demo):
    held = demo.results.get("bed")
    message = message_from(held.message, dict(held.arguments))
    with pytest.raises(CancelledError):
        derived("bed", demo, message, cancel=lambda: True)


@pytest.mark.slow
def test_the_same_search_finds_the_same_bed(demo):
    held = demo.results.get("bed")
    message = message_from(held.message, dict(held.arguments))
    shares = []
    found = derived("bed", demo, message, progress=shares.append)
    np.testing.assert_allclose(found.probability, held.value.probability, atol=1e-6)
    assert found.placed.placement == held.value.placed.placement
    assert [one.lift_mm for one in found.tried] == [one.lift_mm for one in held.value.tried]
    assert shares == sorted(shares)


def test_it_is_saved_and_becomes_stale_with_the_maps(demo, bench):
    back = reopened(demo)
    assert digest(back.results) == digest(demo.results)
    assert stale_reason("bed", back) is None
    bench.dispatch(SetProbe(name="1MHz"))
    assert stale_reason("bed", bench.session) is not None
    assert step_states(bench.session)[-1].state == "stale"
    with pytest.raises(StaleResultError, match="stale"):
        milling_view(bench.session)
    with pytest.raises(StepBlockedError):
        bench.dispatch(again(bed_of(demo)))


def test_without_maps_it_says_what_to_do_first():
    assert "compute the maps (step 9)" in blocked(StartBedSearch, Session()).reason
    with pytest.raises(StepBlockedError, match="place the implant bed"):
        milling_view(Session())


def test_the_milled_bed_takes_the_implant_and_nothing_is_cut_below_it(demo):
    shown, bed = milling_view(demo), bed_of(demo)
    assert shown.fit.goes_in
    assert shown.duration_s > 60.0
    depth_mm = implant_named(bed.implant).lifted(bed.lift_mm).terraces()[-1].depth_mm
    settings = milling_settings(shown.implant, bed.burr_mm)
    lowest = shown.path.bottoms_bed()[:, 2].min()
    assert lowest == pytest.approx(-depth_mm - settings.over_depth_mm, abs=1e-6)
    assert shown.path.bottoms_bed()[:, 2].max() > 0.0  # it begins in the air
    floor_bed = bed.placed.T_base_bed.inv() @ floor_base(bed)
    assert floor_bed[:, 2].min() == pytest.approx(lowest, abs=1e-6)
    mesh = shown.implant_base()
    assert np.isfinite(mesh.vertices).all()


def test_the_burr_is_the_largest_that_goes_in_or_the_one_that_was_asked_for():
    wide, hole = implant_named("BCI 602"), implant_named("Osia/Baha screw")
    assert milling_settings(wide, None).burr.diameter_mm == BURRS_MM[0]
    assert milling_settings(hole, None).burr.diameter_mm == BURRS_MM[1]
    assert milling_settings(wide, 3.0).burr.diameter_mm == 3.0
    with pytest.raises(InvalidInputError, match="smaller burr"):
        milling_settings(hole, 6.0)


def test_the_burr_counts_as_known_as_it_was_registered(demo):
    burr = demo.results.get("burr")
    error = required(EXECUTION, demo)
    again_mm = repeatability_mm(demo.setup.devices.robot.model)
    along_mm = burr.value.tip_sigma_mm / np.sqrt(3.0)
    assert error.depth_mm == pytest.approx(np.hypot(along_mm, again_mm))
    assert error.lateral_mm == error.depth_mm
    doubled = replace(burr.value, tip_sigma_mm=2.0 * burr.value.tip_sigma_mm)
    other = demo.with_result("burr", replace(burr, value=doubled))
    assert required(EXECUTION, other).depth_mm > 1.9 * error.depth_mm


@pytest.mark.parametrize(
    "wrong", [{"limit_mm": -0.1}, {"lift_mm": 5.0}, {"probability": 1.0}, {"burr_mm": 40.0}]
)
def test_values_outside_their_range_are_refused(wrong):
    with pytest.raises(InvalidInputError, match=next(iter(wrong))):
        StartBedSearch(**wrong)


def test_words_never_round_to_certainty(demo):
    assert [percent(p) for p in (0.5, 0.9951, 0.99999)] == ["50.0 %", "99.5 %", "over 99.9 %"]
    bed = bed_of(demo)
    assert verdict(bed).startswith(f"{bed.implant} on a lift of {bed.lift_mm:g} mm fits: at least")
