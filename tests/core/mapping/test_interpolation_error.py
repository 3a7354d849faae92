"""Error of a thin plate away from its samples: told by left-out ones, held against the truth."""

import numpy as np
import pytest

from rona_core.mapping.interpolation_error import interpolation_error
from rona_core.mapping.thin_plate_spline import fit_plate


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def field(seed):
    """A random field (places (n, 2) -> heights (n,)) of waves about 14 mm long, 0.22 mm RMS."""
    rng = np.random.default_rng(seed)
    ways, turns = rng.normal(0.0, 0.45, (2, 40)), rng.uniform(0.0, 2.0 * np.pi, 40)
    return lambda places: 0.05 * np.cos(places @ ways + turns).sum(axis=1)


def rows_of_a_scan():
    """Samples 1 mm apart in rows 4 mm apart, 40 by 40 mm."""
    rows = np.stack(np.meshgrid(np.arange(-20.0, 21), np.arange(-20.0, 21, 4)), -1)
    return rows.reshape(-1, 2)


def test_it_is_as_large_as_the_true_error_on_a_row_between_rows_and_beyond_the_last():
    rows = rows_of_a_scan()
    told, true = [], []
    for seed in range(6):
        rng, heights = np.random.default_rng(seed), field(seed)
        noisy = heights(rows) + rng.normal(0.0, 0.01, len(rows))
        at = rng.uniform(-18.0, 18.0, (2000, 2))
        beyond = np.column_stack((rng.uniform(-18.0, 18.0, 300), np.full(300, 22.5)))
        away = np.abs((at[:, 1] + 22.0) % 4.0 - 2.0)  # to the nearest row
        parts = at[away < 0.5], at[(away > 0.9) & (away < 1.4)], at[away > 1.7], beyond
        plate, found = fit_plate(rows, noisy), interpolation_error(rows, noisy)
        true.append([rms(plate.heights(part) - heights(part)) for part in parts])
        told.append([rms(found.at(part)) for part in parts])
        assert found.scatter_mm < 0.02
    true, told = (np.sqrt(np.mean(np.square(found), axis=0)) for found in (true, told))
    assert true[3] > 2.0 * true[2] > 2.0 * true[0]
    np.testing.assert_allclose(told[1:], true[1:], rtol=0.45)


def test_it_knows_where_a_plate_is_bad():
    heights, rng = field(3), np.random.default_rng(3)
    scattered = rng.uniform(-20.0, 20.0, (160, 2))
    at = rng.uniform(-19.0, 19.0, (3000, 2))
    off = fit_plate(scattered, heights(scattered)).heights(at) - heights(at)
    told = interpolation_error(scattered, heights(scattered)).at(at)
    surest = told < np.quantile(told, 0.3)
    assert rms(off[surest]) < 0.4 * rms(off[~surest])


def test_noise_about_a_plane_is_scatter_and_no_error_of_interpolation():
    rng = np.random.default_rng(4)
    places = rng.uniform(-15.0, 15.0, (400, 2))
    found = interpolation_error(places, 0.1 * places[:, 0] + rng.normal(0.0, 0.2, 400))
    assert 0.18 < found.scatter_mm < 0.24
    assert rms(found.at(rng.uniform(-14.0, 14.0, (200, 2)))) < 0.08


@pytest.mark.parametrize("n", [0, 1, 4, 7, 9])
def test_a_few_samples_tell_no_error(n):
    places = np.random.default_rng(n).uniform(-5, 5, (n, 2))
    found = interpolation_error(places, places.sum(axis=1))
    assert np.isinf(found.at(np.zeros((2, 2)))).all()


def test_rows_so_far_apart_that_one_speaks_alone_are_no_error_of_the_program():
    """The nearest samples of a place then lie on one line, which carries no plane."""
    rows = np.stack(np.meshgrid(np.arange(0.0, 41.0), (0.0, 60.0)), -1).reshape(-1, 2)
    told = interpolation_error(rows, np.sin(0.2 * rows[:, 0])).at(rows[:5] + (0.0, 1.0))
    assert np.isfinite(told).all()


def test_it_is_the_same_wherever_the_samples_lie():
    rng = np.random.default_rng(9)
    places, heights = rng.uniform(-15, 15, (300, 2)), rng.normal(0.0, 0.1, 300)
    turn, shift = np.array(((0.6, -0.8), (0.8, 0.6))), np.array((40.0, -7.0))
    moved = places @ turn + shift
    here, there = interpolation_error(places, heights), interpolation_error(moved, heights)
    at = rng.uniform(-14.0, 14.0, (50, 2))
    np.testing.assert_allclose(there.at(at @ turn + shift), here.at(at), rtol=1e-5)
