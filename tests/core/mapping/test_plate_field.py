"""Plate through samples as a Gaussian field: against a second implementation, and the truth."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import RBFInterpolator

from rona_core.mapping.fitting.field_grid import STEP_MM
from rona_core.mapping.fitting.plate_field import (
    ROUGHNESS_MM,
    SurfaceSamples,
    fit_field,
    joined,
)


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def field(seed):
    """A random field (places (n, 2) -> heights (n,)) of waves about 14 mm long, 0.22 mm RMS."""
    rng = np.random.default_rng(seed)
    ways, turns = rng.normal(0.0, 0.45, (2, 40)), rng.uniform(0.0, 2.0 * np.pi, 40)
    return lambda places: 0.05 * np.cos(places @ ways + turns).sum(axis=1)


def rows_of_a_scan(apart_mm=4):
    """Samples 1 mm apart in rows, 40 by 40 mm."""
    rows = np.stack(np.meshgrid(np.arange(-20.0, 21), np.arange(-20.0, 21, apart_mm)), -1)
    return rows.reshape(-1, 2)


@pytest.mark.parametrize("stiffness", [0.05, 1.0, 50.0, 2000.0])
def test_it_is_the_thin_plate_spline_of_scipy(stiffness):
    """That one has no grid and no end: inside the samples both are one."""
    rng = np.random.default_rng(5)
    places, at = rng.uniform(-20, 20, (500, 2)), rng.uniform(-16, 16, (300, 2))
    heights = field(5)(places)
    found = fit_field(places, heights, stiffness=stiffness)
    over = heights - found.trend.heights(places)
    spline = RBFInterpolator(places, over, smoothing=stiffness, kernel="thin_plate_spline")
    off = found.heights(at) - found.trend.heights(at) - spline(at)
    assert rms(off) < 0.08 * rms(spline(at))


@pytest.mark.parametrize("seed", range(4))
def test_a_quadric_is_reproduced_whatever_the_stiffness(seed):
    rng = np.random.default_rng(seed)
    places, at = rng.uniform(-15, 15, (80, 2)), rng.uniform(-20, 20, (30, 2))
    (a, b, c, d, e) = rng.normal(0, (0.3, 0.3, 0.01, 0.01, 0.01))

    def quadric(p):
        u, v = p.T
        return 3.0 + a * u + b * v + c * u * u + d * u * v + e * v * v

    plate = fit_field(places, quadric(places), stiffness=float(10.0 ** rng.uniform(-2, 3)))
    np.testing.assert_allclose(plate.heights(at), quadric(at), atol=1e-7)
    slope = a + 2.0 * c * at[:, 0] + d * at[:, 1]
    np.testing.assert_allclose(plate.heights(at, (1, 0)), slope, atol=1e-7)


def test_it_is_as_unsure_as_it_errs_on_a_row_between_rows_and_beyond_the_last():
    rows = rows_of_a_scan()
    told, true = [], []
    for seed in range(8):
        rng, heights = np.random.default_rng(seed), field(seed)
        noisy = heights(rows) + rng.normal(0.0, 0.01, len(rows))
        at = rng.uniform(-18.0, 18.0, (2000, 2))
        beyond = np.column_stack((rng.uniform(-18.0, 18.0, 300), np.full(300, 22.5)))
        away = np.abs((at[:, 1] + 22.0) % 4.0 - 2.0)  # to the nearest row
        parts = at[away < 0.3], at[(away > 0.6) & (away < 1.1)], at[away > 1.5], beyond
        found = fit_field(rows, noisy)
        true.append([rms(found.heights(part) - heights(part)) for part in parts])
        told.append([rms(found.sigmas_mm(part)) for part in parts])
        assert found.scatter_mm < 0.03
    true, told = (np.sqrt(np.mean(np.square(found), axis=0)) for found in (true, told))
    assert true[3] > 2.0 * true[2] > 6.0 * true[0]
    np.testing.assert_array_less(0.6, told / true)
    np.testing.assert_array_less(told / true, 1.8)


def test_it_knows_where_it_is_bad():
    heights, rng = field(3), np.random.default_rng(3)
    scattered = rng.uniform(-20.0, 20.0, (160, 2))
    at = rng.uniform(-19.0, 19.0, (3000, 2))
    found = fit_field(scattered, heights(scattered))
    off, told = found.heights(at) - heights(at), found.sigmas_mm(at)
    surest = told < np.quantile(told, 0.3)
    assert rms(off[surest]) < 0.4 * rms(off[~surest])


def test_noise_about_a_plane_is_scatter_and_averages_out():
    rng = np.random.default_rng(4)
    places = rng.uniform(-15.0, 15.0, (400, 2))
    found = fit_field(places, 0.1 * places[:, 0] + rng.normal(0.0, 0.2, 400))
    assert 0.18 < found.scatter_mm < 0.22
    assert rms(found.sigmas_mm(rng.uniform(-14.0, 14.0, (200, 2)))) < 0.06


def test_samples_that_count_less_are_followed_less():
    rng = np.random.default_rng(6)
    places = rng.uniform(-15.0, 15.0, (400, 2))
    bad = rng.uniform(size=400) < 0.5
    heights = field(6)(places) + np.where(bad, 1.0, 0.02) * rng.normal(size=400)
    even = fit_field(places, heights)
    told = fit_field(places, heights, np.where(bad, 2500.0, 1.0))
    at = rng.uniform(-14.0, 14.0, (500, 2))
    errors = [rms(one.heights(at) - field(6)(at)) for one in (told, even)]
    assert errors[0] < 0.5 * errors[1]
    assert 0.015 < told.scatter_mm < 0.03


def test_it_is_the_same_wherever_the_samples_lie():
    rng = np.random.default_rng(9)
    places = rng.uniform(-15, 15, (300, 2))
    heights = field(9)(places)
    turn, shift = np.array(((0.6, -0.8), (0.8, 0.6))), np.array((40.3, -7.6))
    here, there = fit_field(places, heights), fit_field(places @ turn + shift, heights)
    at = rng.uniform(-13.0, 13.0, (200, 2))
    off = there.heights(at @ turn + shift) - here.heights(at)
    assert rms(off) < 0.7 * rms(here.heights(at) - field(9)(at))
    ratio = there.sigmas_mm(at @ turn + shift) / here.sigmas_mm(at)
    assert 0.8 < np.median(ratio) < 1.25


def test_draws_scatter_as_it_is_unsure():
    places = rows_of_a_scan(8)
    found = fit_field(places, field(1)(places))
    at = np.round(np.random.default_rng(2).uniform(-18, 18, (60, 2)))
    drawn = found.heights(at) + found.drawn_errors(at, 600, np.random.default_rng(3))
    np.testing.assert_allclose(drawn.std(axis=0), found.sigmas_mm(at), rtol=0.15, atol=1e-4)
    off = (drawn.mean(axis=0) - found.heights(at)) / found.sigmas_mm(at)
    assert rms(off) * np.sqrt(600) < 1.3


def test_what_is_unknown_of_a_motion_is_unknown_of_the_plate():
    """Against draws of the motion: points beyond the samples move with it, samples do not."""
    places = rows_of_a_scan(2)
    plate = fit_field(places, field(4)(places))
    rng = np.random.default_rng(4)
    beyond = np.column_stack((rng.uniform(25, 40, 300), rng.uniform(-20, 20, 300)))
    points = np.column_stack((beyond, np.zeros(300)))
    moved_by = np.column_stack((np.zeros((300, 2)), np.ones(300), np.zeros((300, 3))))
    motion = np.diag((1e-12, 1e-12, 0.2**2, 1e-12, 1e-12, 1e-12))
    weights = np.full(300, 0.01**-2)
    samples = SurfaceSamples(points, np.ones(300), weights, moved_by, motion)
    found = joined(plate, samples)
    at = np.array(((30.0, 0.0), (35.0, 5.0), (0.0, 0.0)))
    lifted = joined(plate, SurfaceSamples(points + (0, 0, 0.2), *samples_but_points(samples)))
    moved = lifted.heights(at) - found.heights(at)
    np.testing.assert_allclose(moved[:2], 0.2, atol=0.02)
    assert abs(moved[2]) < 0.01
    sigma = found.sigmas_mm(at)
    assert (sigma[:2] > 0.19).all()
    assert sigma[2] < 2.0 * ROUGHNESS_MM


def samples_but_points(samples):
    return samples.upright, samples.weights, samples.moved_by, samples.motion


def test_a_wide_field_has_larger_cells_and_a_stroke_has_a_field_too():
    rng = np.random.default_rng(7)
    wide = rng.uniform(0.0, 300.0, (600, 2))
    found = fit_field(wide, 0.01 * wide[:, 0], stiffness=1.0)
    assert found.grid.step_mm > 2.0 * STEP_MM
    np.testing.assert_allclose(found.heights(wide[:5]), 0.01 * wide[:5, 0], atol=1e-6)
    stroke = np.column_stack((np.arange(30.0), np.zeros(30)))
    along = fit_field(stroke, np.sin(0.2 * stroke[:, 0]))
    assert np.isfinite(along.sigmas_mm(stroke + (0.0, 2.0))).all()
    assert rms(along.heights(stroke) - np.sin(0.2 * stroke[:, 0])) < 0.02


def test_a_joined_plate_tells_how_much_it_follows_its_first_samples():
    """Finite differences: all first samples higher by a little, the added ones as they are."""
    rng = np.random.default_rng(5)
    places = rng.uniform(-12.0, 0.0, (150, 2)) * (1.0, 2.0) + (0.0, 12.0)
    heights = 0.01 * places[:, 0] ** 2 + rng.normal(0.0, 0.05, len(places))
    plate = fit_field(places, heights)
    everywhere = np.array(((-6.0, 0.0), (3.0, 3.0)))
    np.testing.assert_array_equal(plate.weights(everywhere), 1.0)
    added = np.column_stack((rng.uniform(-12.0, 12.0, (300, 2)), np.zeros(300)))
    more = SurfaceSamples(
        added, np.ones(300), np.full(300, 1e3), np.zeros((300, 6)), 1e-6 * np.eye(6)
    )
    both = joined(plate, more)
    shifted = replace(plate, samples_mm=plate.samples_mm + 0.01)
    cells = np.array([(u, v) for u in (-9.0, -5.0, 0.0, 8.0) for v in (-9.0, 0.0, 9.0)])
    moved = (joined(shifted, more).heights(cells) - both.heights(cells)) / 0.01
    knots = both.grid.operator(cells) @ both.shares
    np.testing.assert_allclose(moved, knots, atol=0.02)  # splines and bilinear differ a little
    assert both.weights(cells)[cells[:, 0] == 8.0].max() < 0.2
    assert both.weights(cells)[cells[:, 0] == -5.0].max() > 0.2
