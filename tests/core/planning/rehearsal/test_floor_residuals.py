"""Draws moved by what was measured: against closed forms of normal errors."""

import numpy as np
import pytest

from rona_core.planning.rehearsal.milled_floor import (
    LEAST_SIGMA_MM,
    CorrectedBone,
    MeasuredFloor,
)

DRAWS = 4000


def measured(places, off_mm, drawn, *, sigma=0.0, common=0.0, residual=3.0):
    count = len(places)
    return MeasuredFloor(
        np.arange(count),
        np.column_stack((places, np.zeros(len(places)))),
        np.full(count, residual + off_mm),
        np.full(count, sigma),
        common,
        np.full(count, residual),
        drawn,
    )


def test_an_error_common_to_all_places_is_found_everywhere():
    random = np.random.default_rng(1)
    shift = random.normal(0.0, 0.3, DRAWS)
    places = random.uniform(-4.0, 4.0, (20, 2))
    bone = CorrectedBone(
        measured(places, -0.4, 3.0 + np.tile(shift, (20, 1))), np.random.default_rng(0)
    )
    found = bone.draws(np.zeros((1, 3)), 2.0 + shift[None])
    precision = 1.0 / 0.3**2 + 20.0 / LEAST_SIGMA_MM**2
    wanted = -0.4 * (20.0 / LEAST_SIGMA_MM**2) / precision
    assert found.mean() == pytest.approx(2.0 + wanted, abs=0.02)
    assert found.std() == pytest.approx(precision**-0.5, rel=0.25)


def test_what_is_tied_to_nothing_that_was_heard_stays():
    random = np.random.default_rng(2)
    places = random.uniform(-4.0, 4.0, (10, 2))
    bone = CorrectedBone(
        measured(places, -0.4, 3.0 + random.normal(0.0, 0.3, (10, DRAWS))), np.random.default_rng(0)
    )
    own = 2.0 + random.normal(0.0, 0.3, (1, DRAWS))
    found = bone.draws(np.zeros((1, 3)), own)
    assert found.mean() == pytest.approx(2.0, abs=0.1)
    assert found.std() == pytest.approx(0.3, rel=0.1)


def test_an_error_of_the_speed_stays_however_many_places_were_heard():
    random = np.random.default_rng(3)
    shift = random.normal(0.0, 1.0, DRAWS)
    places = random.uniform(-1.0, 1.0, (60, 2))
    drawn = 3.0 + np.tile(shift, (60, 1))
    bone = CorrectedBone(measured(places, 0.0, drawn, common=0.05), np.random.default_rng(0))
    found = bone.draws(np.zeros((1, 3)), 3.0 + shift[None])
    assert found.std() == pytest.approx(0.15, rel=0.15)


def test_one_place_that_is_far_off_the_others_is_left_out():
    random = np.random.default_rng(4)
    floor = measured(random.uniform(-4, 4, (10, 2)), 0.1, 3.0 + random.normal(0, 0.2, (10, 100)))
    floor.residual_mm[3] += 1.5
    kept = floor.without_outliers()
    assert kept.scans.tolist() == [0, 1, 2, 4, 5, 6, 7, 8, 9]
