import numpy as np
import pytest
from scipy.stats import norm, t

from rona_core.planning.placement.figures import (
    chance_above,
    spreads_above,
    spreads_for,
)


@pytest.mark.parametrize("limit", [-2.5, -1.0, 0.0, 1.5])
def test_normal_values_keep_a_limit_below_their_median_by_students_t(limit):
    values = norm.ppf((np.arange(4001) + 0.5) / 4001.0)
    found = chance_above(values, limit)
    expected = t.sf(limit, 10) if limit < 0.0 else norm.sf(limit)
    assert found.probability == pytest.approx(expected, abs=0.002)
    assert found.low < found.probability < found.high
    assert found.score == pytest.approx(norm.ppf(expected), abs=0.01)
    assert spreads_above(values, limit) == pytest.approx(-limit, abs=0.01)


def test_the_interval_holds_about_as_often_as_it_says():
    generator = np.random.default_rng(1)
    held = 0
    for _ in range(400):
        found = chance_above(generator.standard_normal(100), -1.6)
        held += found.low <= t.cdf(1.6, 10) <= found.high
    assert 0.92 <= held / 400 <= 1.0


def test_sigmas_that_are_wrong_by_a_third_are_allowed_for():
    """Truth and draws of patients whose sigma differs from what the maps say as chi does."""
    generator = np.random.default_rng(4)
    wider = np.sqrt(10.0 / generator.chisquare(10.0, 200_000))
    broken = wider * generator.standard_normal(200_000) < -2.76
    values = norm.ppf((np.arange(4001) + 0.5) / 4001.0)
    assert 1.0 - chance_above(values, -2.76).probability == pytest.approx(broken.mean(), rel=0.1)


def test_the_longer_lower_tail_of_a_minimum_is_not_promised_away():
    """Least of 40 values, which is more than a bed has: a fit to all of it promises too much."""
    generator = np.random.default_rng(2)
    least = generator.standard_normal((40_000, 40)).min(axis=1)
    limit = np.quantile(least, 0.01)
    plain = norm.sf((limit - least.mean()) / least.std())
    halved = norm.cdf(spreads_above(least, limit))
    assert plain > 0.996
    assert 0.99 - 1e-3 < halved < 0.994
    assert chance_above(least, limit).probability < halved


def test_spreads_of_several_columns_are_those_of_each():
    values = np.random.default_rng(3).gamma(2.0, size=(60, 3))
    assert spreads_above(values, 1.0) == pytest.approx(
        [float(spreads_above(values[:, k], 1.0)) for k in range(3)]
    )


@pytest.mark.parametrize("probability", [0.2, 0.5, 0.9, 0.99])
def test_a_limit_so_many_spreads_below_the_median_is_kept_as_surely_as_was_asked(probability):
    values = np.random.default_rng(5).standard_normal(999)
    limit = np.median(values) - spreads_for(probability)
    for _ in range(5):  # the spread is that of the draws
        limit += spreads_above(values, limit) - spreads_for(probability)
    assert chance_above(values, limit).probability == pytest.approx(probability, abs=1e-3)


def test_values_that_are_all_alike_are_certain():
    assert chance_above(np.full(50, 2.0), 1.0).low == 1.0
    assert chance_above(np.full(50, 0.5), 1.0).high == 0.0
