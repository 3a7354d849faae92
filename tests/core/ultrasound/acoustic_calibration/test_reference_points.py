"""Where a caliper is put, and the time of flight there."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import readonly
from rona_core.ultrasound.acoustic_calibration.reference_points import (
    CYCLE_SLIP_PROBABILITY,
    EchoDepths,
    at_speed,
    lags_at,
    propose_references,
    speed_prior_for,
)
from rona_core.ultrasound.acoustic_calibration.speed_calibration import calibrate_speed, speed_at
from rona_core.ultrasound.acoustic_calibration.speed_prior import PUBLISHED
from rona_core.ultrasound.detection.detect import Detection

SPEED = 2.6
SAME_EVERYWHERE = replace(PUBLISHED, local_log_sd=0.0)


def disc(n=400, radius=25.0, seed=0):
    rng = np.random.default_rng(seed)
    angle, r = rng.uniform(0, 2 * np.pi, n), radius * np.sqrt(rng.uniform(0, 1, n))
    return np.column_stack((r * np.cos(angle), r * np.sin(angle), np.full(n, 400.0)))


def detection(thickness, ok=None, speed=SPEED):
    n = len(thickness)
    zero, lag = np.zeros(n), 2.0 * np.asarray(thickness) / speed
    good = np.ones(n, dtype=np.bool_) if ok is None else ok
    return Detection(
        outer_us=readonly(zero + 20.0),
        inner_us=readonly(zero + 20.0 + lag),
        outer_ok=readonly(np.ones(n, dtype=np.bool_)),
        inner_ok=readonly(good),
        outer_quality=readonly(zero + 1.0),
        inner_quality=readonly(zero + 1.0),
        flag=readonly(np.where(good, 0, 6)),
        standoff_mm=readonly(zero),
        thickness_mm=readonly(np.array(thickness, dtype=float)),
        outer_sigma_mm=readonly(zero + 0.01),
        thickness_sigma_mm=readonly(zero + 0.02),
        inner_sigma_us=readonly(zero + 0.015),
        alternative_us=readonly(zero),
        alternative_quality=readonly(zero),
        probe="2.25MHz",
        excitation="chirp",
        method="subtract",
        sound_speed_mm_per_us=speed,
    )


def depths(places, thickness, ok=None, quality=1.0):
    rows = np.arange(len(places)) if ok is None else np.flatnonzero(ok)
    return EchoDepths(
        scans=readonly(rows),
        places_base=readonly(places[rows]),
        axes_base=readonly(np.tile((0.0, 0.0, -1.0), (len(rows), 1))),
        depth_mm=readonly(np.array(thickness, dtype=float)[rows]),
        quality=readonly(np.broadcast_to(quality, len(places))[rows].astype(float)),
        sound_speed_mm_per_us=SPEED,
    )


def test_the_places_are_spread_thick_and_among_the_sure_ones():
    places = disc()
    thickness = np.where(places[:, 0] > 10.0, 2.5, 6.0)  # one side is too thin
    ok = places[:, 1] > -15.0
    found = depths(places, thickness, ok)
    rows = found.scans[propose_references(found, 3).rows]
    assert len(set(rows.tolist())) == 3
    assert ok[rows].all()
    assert (thickness[rows] >= 3.0).all()
    chosen = places[rows]
    apart = np.linalg.norm(chosen[:, None] - chosen[None], axis=2)[np.triu_indices(3, 1)]
    assert apart.min() > 8.0
    far = np.linalg.norm(places[ok][:, None] - chosen[None], axis=2).min(axis=1)
    assert far.max() < 35.0


def test_a_parallel_place_is_preferred_to_a_wedge_beside_it():
    places = disc(800)
    slope = np.where(places[:, 0] > 0.0, 0.25, 0.0)
    rows = propose_references(depths(places, 6.0 + slope * places[:, 0]), 1).rows
    assert places[rows[0], 0] < 0.0


def test_a_place_whose_echo_disagrees_with_all_around_it_is_not_chosen():
    places = disc()
    middle = int(np.argmin(np.linalg.norm(places[:, :2], axis=1)))
    thickness = np.full(len(places), 6.0)
    thickness[middle] = 4.0
    assert propose_references(depths(places, thickness), 1).rows[0] != middle


def test_the_lag_is_that_of_the_plane_around_it_whatever_one_stray_echo_says():
    places = disc()
    thickness = 6.0 + 0.05 * places[:, 0]
    stray = int(np.argmin(np.linalg.norm(places - (5.0, 5.0, 400.0), axis=1)))
    thickness[stray] += 2.0
    wanted = np.array([(5.0, 5.0, 400.0), (-8.0, 0.0, 400.0)])
    lag, sigma = lags_at(wanted, depths(places, thickness))
    np.testing.assert_allclose(lag, 2.0 * (6.0 + 0.05 * wanted[:, 0]) / SPEED, atol=0.02)
    assert (sigma > 0.005).all()
    assert (sigma < 0.06).all()
    turn = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
    moved = lags_at(wanted @ turn.T + 7.0, depths(places @ turn.T + 7.0, thickness))
    np.testing.assert_allclose(moved[0], lag, atol=1e-9)


def test_a_steeper_wedge_is_less_sure():
    places = disc()
    sigmas = [
        lags_at(np.array([(0.0, 0.0, 400.0)]), depths(places, 8.0 + s * places[:, 0]))[1][0]
        for s in (0.0, 0.1, 0.2)
    ]
    assert sigmas[0] < sigmas[1] < sigmas[2]


def test_thickness_is_proportional_to_the_speed_place_by_place():
    found = detection(np.array([4.0, 6.0]))
    faster = at_speed(found, np.array([SPEED * 1.1, SPEED]))
    np.testing.assert_allclose(faster.thickness_mm, (4.4, 6.0))
    np.testing.assert_allclose(faster.thickness_sigma_mm, (0.022, 0.02))
    assert faster.sound_speed_mm_per_us == pytest.approx(1.05 * SPEED)
    np.testing.assert_array_equal(faster.inner_us, found.inner_us)


def test_what_tells_nothing_is_refused_by_name():
    places = disc(50)
    none = np.zeros(50, dtype=np.bool_)
    with pytest.raises(InvalidInputError, match="no A-scan"):
        lags_at(places[:1], depths(places, np.full(50, 6.0), none))
    with pytest.raises(InvalidInputError, match="reference point 2"):
        lags_at(np.vstack((places[:1], places[:1] + 60.0)), depths(places, np.full(50, 6.0)))
    with pytest.raises(DegenerateGeometryError, match="0 A-scans"):
        propose_references(depths(places, np.full(50, 2.0)), 3)


def test_no_other_place_lowers_the_error_more_and_the_gain_is_as_promised():
    places = disc(60, seed=3)
    found = depths(places, 6.0 + 0.04 * places[:, 0])
    proposal = propose_references(found, 1)
    then = {}
    for i in range(60):
        lag, sigma = lags_at(places[[i]], found)
        depth = lag * SPEED / 2.0
        known = calibrate_speed(
            depth, lag, lag_sigma_us=sigma, positions_mm=places[[i]], prior=SAME_EVERYWHERE
        )
        then[i] = float(np.sqrt(np.mean((found.depth_mm * speed_at(known, places)[1]) ** 2)))
    best = min(then, key=then.__getitem__)
    assert then[proposal.rows[0]] <= 1.02 * then[best]
    assert proposal.then_mm * SPEED == pytest.approx(then[proposal.rows[0]], rel=0.1)
    assert proposal.then_mm < proposal.now_mm


def test_points_that_are_known_already_are_not_asked_for_again():
    places = disc()
    found = depths(places, np.full(len(places), 6.0))
    first = propose_references(found, 3)
    assert first.then_mm < 0.5 * first.now_mm
    lag, sigma = lags_at(places[first.rows], found)
    known = calibrate_speed(
        np.full(3, 6.0), lag, lag_sigma_us=sigma, positions_mm=places[first.rows]
    )
    more = propose_references(found, 1, known)
    away = np.linalg.norm(places[first.rows] - places[more.rows], axis=1)
    assert away.min() > 10.0
    assert more.now_mm == pytest.approx(first.then_mm, rel=0.1)
    assert more.then_mm < more.now_mm


def test_an_echo_that_is_hardly_sure_is_not_chosen():
    places = disc()
    doubtful = places[:, 0] > 0.0
    unsure = depths(places, np.full(len(places), 6.0), quality=np.where(doubtful, 0.9, 1.0))
    assert not doubtful[propose_references(unsure, 3).rows].any()


@pytest.mark.parametrize(
    ("quality", "slipped"), [(1.0, 0.0), (0.96, 0.0), (0.95, CYCLE_SLIP_PROBABILITY)]
)
def test_where_echoes_are_less_likely_than_usual_all_lags_may_be_a_period_off(quality, slipped):
    prior = speed_prior_for(depths(disc(60), np.full(60, 6.0), quality=quality), centre_mhz=2.0)
    shared_us = np.sqrt(slipped) / 2.0
    assert prior.timing_us == pytest.approx(np.hypot(PUBLISHED.timing_us, shared_us))
    assert replace(prior, timing_us=PUBLISHED.timing_us) == PUBLISHED


def test_a_calibration_with_lags_that_may_be_a_period_late_is_weak_and_says_so():
    thickness, slipped_us = np.full(3, 7.0), 0.45
    lags = 2.0 * thickness / 2.7 + slipped_us
    doubted = depths(disc(100), np.full(100, 7.0), quality=0.93)
    places = 25.0 * np.eye(3)
    prior = speed_prior_for(doubted, centre_mhz=2.25)
    known = calibrate_speed(thickness, lags, positions_mm=places, region_mm=places, prior=prior)
    assert known.verdict == "weak"
    assert "all echoes may be early or late together" in known.reasons[-1]
    assert abs(known.speed_mm_per_us - 2.7) < 2.0 * known.sigma_mm_per_us


def test_a_probe_of_the_lowest_frequency_has_a_prior_too():
    doubted = depths(disc(9), np.full(9, 6.0), quality=0.9)
    assert speed_prior_for(doubted, centre_mhz=0.5).timing_us > 1.0


def test_what_all_depths_are_off_together_makes_all_lags_late_together():
    found = depths(disc(60), np.full(60, 6.0))
    prior = speed_prior_for(replace(found, common_sigma_mm=0.13), centre_mhz=2.0)
    assert prior.timing_us == pytest.approx(np.hypot(PUBLISHED.timing_us, 0.26 / SPEED))
