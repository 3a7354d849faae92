"""Draws of the maps: as wide as what is stated, hanging together, and never inside out."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from rona_core.app.runtime.session_step import Undo
from rona_core.app.steps.maps.inputs import MOST_DRAWS, TERMS, drawn_maps, map_accuracy
from rona_core.app.steps.setup.messages import SetProbe
from rona_core.compose import build_virtual_rig, new_workbench
from rona_core.errors import InvalidInputError, StaleResultError, StepBlockedError
from rona_core.evaluation.map_metrics import cell_errors_mm
from rona_core.evaluation.truth import truth_of
from rona_core.mapping.accuracy.echo_terms import NO_INNER_ECHO
from rona_core.mapping.accuracy.error_terms import HIDDEN_ALIKE, HIDDEN_FROM, hidden_depths
from rona_core.mapping.build_maps import LEAST_THICKNESS_MM
from rona_core.session.document import Session

COUNT = 600  # a standard deviation of so many is known to 3 %


@pytest.fixture(scope="module", params=[False, True], ids=["absolute", "same robot"])
def drawn(request, demo):
    return request.param, drawn_maps(demo, COUNT, 5, same_robot=request.param)


def test_draws_scatter_about_the_maps_as_wide_as_is_stated(demo, drawn):
    same_robot, draws = drawn
    maps, stated = draws.maps, map_accuracy(demo)
    both = maps.outer.ok & maps.inner.ok
    thickness = draws.outer_mm - draws.inner_mm
    outer_sigma = stated.outer.same_robot_mm() if same_robot else stated.outer.total_mm()
    for values, middle, sigma in (
        (draws.outer_mm, maps.outer.height_mm, outer_sigma),
        (thickness, maps.thickness_mm(), stated.thickness.total_mm()),
    ):
        assert values.shape == (COUNT, *maps.outer.height_mm.shape)
        ratio = values.std(axis=0)[both] / sigma[both]
        assert np.median(ratio) == pytest.approx(1.0, abs=0.05)
        assert ((ratio > 0.8) & (ratio < 1.25)).mean() > 0.95
        off = (values.mean(axis=0) - middle)[both] / sigma[both]
        assert np.abs(off).max() < 6.0 / COUNT**0.5


@pytest.mark.sweep(1)
def test_what_all_cells_share_moves_the_whole_map(demo, drawn):
    same_robot, draws = drawn
    ok = draws.maps.outer.ok
    of_map = (draws.outer_mm - draws.maps.outer.height_mm)[:, ok].mean(axis=1).std()
    shared = [
        float(np.mean(np.broadcast_to(term.shared_mm, ok.shape)[ok]))
        for term in TERMS.read(demo).outer
        if not (same_robot and term.of_robot)
    ]
    # and by no more: what cells differ by has no mean of its own
    assert of_map == pytest.approx(np.linalg.norm(shared), rel=0.05)


def test_cells_differ_from_the_mean_of_their_map_by_what_is_stated(demo, drawn):
    same_robot, draws = drawn
    stated, maps = map_accuracy(demo), draws.maps
    for values, boundary, part in (
        (draws.outer_mm, maps.outer, stated.outer),
        (draws.inner_mm, maps.inner, stated.inner),
    ):
        off = (values - boundary.height_mm)[:, boundary.ok]
        off = off - off.mean(axis=1, keepdims=True)
        own = part.own_mm if same_robot else part.whole_own_mm()
        rms = np.sqrt(np.mean(own[boundary.ok] ** 2))
        assert np.sqrt(np.mean(off**2)) == pytest.approx(rms, rel=0.06)


def test_what_a_front_echo_errs_by_moves_the_thickness_and_not_the_inner_boundary(demo):
    """Both boundaries err alike by where the probe was, and by nothing else."""
    draws = drawn_maps(demo, COUNT, 8, same_robot=True)
    maps, terms = draws.maps, TERMS.read(demo)
    ok = maps.outer.ok & maps.inner.ok
    outer, inner = (
        (values - boundary.height_mm)[:, ok]
        for values, boundary in ((draws.outer_mm, maps.outer), (draws.inner_mm, maps.inner))
    )
    alike = np.mean(outer * inner)
    place, front = (
        sum(
            np.mean(
                np.broadcast_to(np.square(term.own_mm) + np.square(term.shared_mm), ok.shape)[ok]
            )
            for term in group
            if not term.of_robot
        )
        for group in (terms.place, (*terms.front, terms.rough))
    )
    assert front > 2.0 * place / 3.0  # else nothing could be told
    assert alike == pytest.approx(place, abs=0.3 * front)


def test_bone_between_two_cells_is_no_rougher_in_draws_than_their_errors_are(demo):
    """On this bone the truth may be asked, where it was heard."""
    draws = drawn_maps(demo, 100, 9, same_robot=True)
    maps = draws.maps
    truth = truth_of(demo, build_virtual_rig(demo.setup).scene)
    errors = cell_errors_mm(maps, truth)["inner_same_robot"]
    (silent_around,) = (t for t in TERMS.read(demo).thickness if t.cause == NO_INNER_ECHO)
    heard = np.isfinite(errors) & (np.hypot(silent_around.own_mm, silent_around.shared_mm) < 0.03)
    beside = heard[1:] & heard[:-1]
    assert beside.sum() > 100
    drawn = draws.inner_mm - maps.inner.height_mm

    def roughness_mm2(off):
        return np.mean(np.square((off[..., 1:, :] - off[..., :-1, :])[..., beside])) / 2.0

    assert 0.4 < roughness_mm2(drawn) / roughness_mm2(np.where(heard, errors, 0.0)) < 2.5


def test_the_inner_boundary_is_never_outside_the_outer_one(demo):
    maps = demo.results.maps.value
    thin = replace(maps.inner, height_mm=maps.outer.height_mm - 0.3)
    made = replace(demo.results.maps, value=replace(maps, inner=thin))
    draws = drawn_maps(demo.with_result("maps", made), 50)
    thickness = draws.outer_mm - draws.inner_mm
    assert thickness.min() == pytest.approx(LEAST_THICKNESS_MM)
    assert (thickness > 0.31).any()


def test_what_hides_only_takes_bone_away_where_a_bed_is_planned(demo):
    either, grooves = (
        drawn_maps(demo, 60, 3, same_robot=True, grooves=grooves) for grooves in (False, True)
    )
    np.testing.assert_array_equal(either.outer_mm, grooves.outer_mm)
    less_mm = grooves.inner_mm - either.inner_mm  # grooves in the place of crests
    assert less_mm.min() > -1e-9
    assert 15 < np.count_nonzero((less_mm > 1e-9).any(axis=(1, 2))) < 45  # of every second draw


def test_hidden_depths_have_their_rms_and_what_they_share():
    field = np.random.default_rng(0).standard_normal(2_000_000)
    depths = hidden_depths(field)
    assert depths.min() == 0.0
    assert np.count_nonzero(depths) / len(depths) == pytest.approx(ndtr(-HIDDEN_FROM), rel=0.02)
    assert np.sqrt(np.mean(depths**2)) == pytest.approx(1.0, rel=0.01)
    assert depths.mean() == pytest.approx(HIDDEN_ALIKE, rel=0.01)


def test_a_seed_gives_its_draws_again_and_another_one_others(demo):
    first, again, other = (drawn_maps(demo, 3, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.inner_mm, again.inner_mm)
    assert not np.allclose(first.inner_mm, other.inner_mm)


def test_maps_that_do_not_count_are_not_drawn(demo):
    with pytest.raises(StepBlockedError, match="first compute the maps"):
        drawn_maps(Session(), 10)
    for count in (0, MOST_DRAWS + 1):
        with pytest.raises(InvalidInputError, match=f"{count} draws are out of range: 1 to"):
            drawn_maps(demo, count)
    bench = new_workbench(demo)
    try:
        bench.dispatch(SetProbe(name="1MHz"))
        with pytest.raises(StaleResultError, match="maps are stale"):
            drawn_maps(bench.session, 10)
        bench.dispatch(Undo())
        assert len(drawn_maps(bench.session, 10).outer_mm) == 10
    finally:
        bench.close()
