import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from rona_core.geometry.robust import (
    MAD_TO_SIGMA,
    TUKEY_CUTOFF,
    cauchy_weights,
    mad_sigma,
    median,
    reweighted_least_squares,
    tukey_weights,
    tukey_weights_of_squares,
)
from tests.helpers.strategies import seeds

few = settings(max_examples=25, deadline=None)


def test_the_constant_is_that_of_the_normal_distribution():
    assert pytest.approx(1.0 / norm.ppf(0.75), abs=3e-5) == MAD_TO_SIGMA


@given(seed=seeds, sigma=st.floats(0.01, 100.0))
@few
def test_normal_residuals_give_their_standard_deviation(seed, sigma):
    residuals = np.random.default_rng(seed).normal(0.0, sigma, 4000)
    assert mad_sigma(residuals) == pytest.approx(sigma, rel=0.1)


@given(seed=seeds, shift=st.floats(-1e3, 1e3), factor=st.floats(0.1, 10.0))
@few
def test_the_scale_follows_units_and_forgets_the_place_of_its_center(seed, shift, factor):
    values = np.random.default_rng(seed).normal(size=51)
    middle = float(np.median(values))
    moved = factor * values + shift
    found = mad_sigma(moved, center=float(np.median(moved)))
    assert found == pytest.approx(factor * mad_sigma(values, center=middle), rel=1e-9)


@given(seed=seeds, share=st.floats(0.0, 0.49), far=st.floats(1e2, 1e12))
@few
def test_less_than_half_of_the_residuals_cannot_carry_the_scale_away(seed, share, far):
    residuals = np.random.default_rng(seed).normal(size=101)
    worst = np.abs(residuals).max()
    residuals[: int(share * 101)] = far
    assert mad_sigma(residuals) <= MAD_TO_SIGMA * worst


def test_the_scale_is_at_least_the_floor():
    assert mad_sigma(np.zeros(5), floor=0.02) == 0.02
    assert mad_sigma(np.full(5, 1.0), floor=0.02) == MAD_TO_SIGMA


@pytest.mark.parametrize("weights", [tukey_weights, cauchy_weights])
@given(seed=seeds, scale=st.floats(0.1, 10.0))
@few
def test_weights_fall_from_one_at_zero_on_both_sides(weights, seed, scale):
    residuals = np.sort(np.abs(np.random.default_rng(seed).normal(0.0, 5.0, 40)))
    found = weights(residuals, scale)
    np.testing.assert_array_equal(found, weights(-residuals, scale))
    assert (np.diff(found) <= 0.0).all()
    assert ((found >= 0.0) & (found <= 1.0)).all()
    assert weights(np.zeros(1), scale)[0] == 1.0


@given(seed=seeds, cutoff=st.floats(0.1, 10.0))
@few
def test_tukeys_weights_vanish_from_the_cutoff_on_and_only_there(seed, cutoff):
    residuals = np.random.default_rng(seed).normal(0.0, cutoff, 60)
    np.testing.assert_array_equal(
        tukey_weights(residuals, cutoff) > 0.0, np.abs(residuals) < cutoff
    )
    np.testing.assert_array_equal(
        tukey_weights(residuals, cutoff), tukey_weights_of_squares((residuals / cutoff) ** 2)
    )


def test_no_cutoff_gives_all_the_same_weight():
    np.testing.assert_array_equal(tukey_weights(np.array((0.0, 1e9)), np.inf), 1.0)


def test_cauchys_weight_is_one_half_at_the_scale():
    assert cauchy_weights(np.array((3.0,)), 3.0)[0] == 0.5


@pytest.mark.parametrize(
    ("weights", "tuning"), [(tukey_weights, TUKEY_CUTOFF), (cauchy_weights, 2.385)]
)
def test_the_tuning_constants_are_95_percent_efficient_for_normal_errors(weights, tuning):
    # efficiency of an M-estimator of location: (E psi')^2 / E psi^2, psi(r) = w(r) r
    r = np.linspace(-12.0, 12.0, 240_001)
    psi = weights(r, tuning) * r
    slope = (norm.pdf(r) * np.gradient(psi, r)).sum() * (r[1] - r[0])
    square = (norm.pdf(r) * psi**2).sum() * (r[1] - r[0])
    assert slope**2 / square == pytest.approx(0.95, abs=1e-3)


@given(seed=seeds)
@few
def test_equal_weights_give_the_least_squares(seed):
    rng = np.random.default_rng(seed)
    design, target = rng.normal(size=(30, 3)), rng.normal(size=30)
    found = reweighted_least_squares(design, target, np.ones_like, rounds=3)
    np.testing.assert_allclose(found, np.linalg.lstsq(design, target)[0], atol=1e-10)


@given(seed=seeds)
@few
def test_a_fifth_of_gross_errors_does_not_move_the_fit(seed):
    rng = np.random.default_rng(seed)
    design, truth = np.column_stack((np.ones(60), rng.normal(size=(60, 2)))), rng.normal(size=3)
    target = design @ truth
    target[:12] += rng.uniform(40.0, 100.0, 12)
    found = reweighted_least_squares(
        design,
        target,
        lambda r: tukey_weights(r, TUKEY_CUTOFF * mad_sigma(r, floor=1e-6)),
        rounds=30,
        weights=(np.abs(target - np.median(target)) < 15.0).astype(np.float64),
    )
    np.testing.assert_allclose(found, truth, atol=1e-6)


@given(seed=seeds)
@few
def test_the_fit_follows_a_change_of_the_target(seed):
    rng = np.random.default_rng(seed)
    design, target = rng.normal(size=(40, 3)), rng.standard_t(2, 40)
    factor, shift = 3.0, rng.normal(size=3)

    def weigh(r):
        return tukey_weights(r, TUKEY_CUTOFF * mad_sigma(r))

    first = reweighted_least_squares(design, target, weigh, rounds=8)
    other = reweighted_least_squares(design, factor * target + design @ shift, weigh, rounds=8)
    np.testing.assert_allclose(other, factor * first + shift, atol=1e-5)


@given(seeds, st.integers(1, 40))
def test_the_median_is_that_of_numpy(seed, count):
    values = np.round(np.random.default_rng(seed).normal(size=count), 1)  # some are equal
    assert median(values) == np.median(values)


def test_the_median_of_what_is_not_known_is_not_known():
    assert np.isnan(median(np.array([1.0, np.nan, 2.0])))
