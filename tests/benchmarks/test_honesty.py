"""The statistics of honesty tell honest sigmas from wrong ones; the design is balanced."""

from collections import Counter
from itertools import combinations

import numpy as np
import pytest

from benchmarks.suites.honesty.design import POINTERS, ROBOTS, TRACKERS, levels_of
from benchmarks.suites.honesty.judged import (
    Judged,
    grouped,
    honesty,
    principal_parts,
    rank_goal,
    rows,
)


def drawn(factor, *, seeds=80, samples=30, varies=True):
    rng = np.random.default_rng(3)
    for seed in range(seeds):
        sigmas = rng.uniform(0.3, 2.0, samples)
        errors = sigmas * rng.normal(size=samples)
        yield Judged("depth (mm)", "local", seed, errors, factor * sigmas, varies)


@pytest.mark.sweep(2)
@pytest.mark.parametrize(("factor", "honest"), [(1.0, True), (1.0 / 3.0, False), (3.0, False)])
def test_a_sigma_three_times_wrong_does_not_hold(factor, honest):
    found = honesty(list(drawn(factor)))
    assert (found.seeds, found.samples) == (80, 2400)
    assert found.ratio.low < found.ratio.value < found.ratio.high
    assert found.ratio.value == pytest.approx(1.0 / factor**2, rel=0.1)
    assert all(metric.holds is not False for metric in rows(found)) is honest
    assert found.rank.value > 0.3  # which places are worse it knows all the same


@pytest.mark.sweep(1)
@pytest.mark.parametrize("seeds", [5, 20, 100])
def test_honest_common_parts_hold_in_studies_of_any_size(seeds):
    def held(factor):
        rng = np.random.default_rng(4)
        studies = rng.normal(size=(60, seeds))
        found = [
            honesty(
                [
                    Judged("x", "common", k, np.array([e]), np.array([factor]))
                    for k, e in enumerate(one)
                ]
            )
            for one in studies
        ]
        return np.mean([all(m.holds is not False for m in rows(one)) for one in found])

    assert held(1.0) > 0.9  # of ratio and band, each 95 %
    assert held(1.0 / 3.0) < 0.2
    assert held(5.0) < 0.2


def test_a_sigma_that_does_not_know_the_bad_places_misses_its_rank():
    samples = list(drawn(1.0))
    rng = np.random.default_rng(7)
    blind = [
        Judged(one.quantity, one.part, one.seed, one.errors, rng.permutation(one.sigmas), True)
        for one in samples
    ]
    (metric,) = (m for m in rows(honesty(blind)) if m.name.endswith("rank correlation"))
    assert metric.holds is False
    assert metric.goal == rank_goal(honesty(blind))


def test_one_sigma_for_all_places_has_no_rank():
    flat = [Judged("x", "whole", k, np.ones(4), np.ones(4)) for k in range(3)]
    assert honesty(flat).rank is None
    assert not any("rank" in metric.name for metric in rows(honesty(flat)))


def test_the_interval_is_that_of_the_seeds_and_not_of_the_samples():
    """Thirty equal samples of a seed are one: the interval must not shrink with them."""
    rng = np.random.default_rng(5)
    common = rng.normal(size=40)
    few, many = (
        honesty([Judged("x", "common", k, np.full(n, e), np.ones(n)) for k, e in enumerate(common)])
        for n in (1, 30)
    )
    assert (few.ratio.low, few.ratio.high) == pytest.approx((many.ratio.low, many.ratio.high))
    width = few.ratio.high - few.ratio.low
    assert width == pytest.approx(2 * 1.96 * np.sqrt(2.0 / 40), rel=0.5)


def test_parts_along_the_axes_of_a_covariance_make_the_mahalanobis_distance():
    rng = np.random.default_rng(6)
    root = rng.normal(size=(3, 3))
    covariance, error = root @ root.T, rng.normal(size=3)
    errors, sigmas = principal_parts(error, covariance)
    distance = error @ np.linalg.solve(covariance, error)
    assert ((errors / sigmas) ** 2).sum() == pytest.approx(distance)
    assert np.linalg.norm(errors) == pytest.approx(np.linalg.norm(error))


def test_samples_are_grouped_by_quantity_and_part():
    parts = [("a", "common"), ("a", "local"), ("b", "whole"), ("a", "local")]
    groups = grouped([Judged(q, part, 0, np.ones(1), np.ones(1)) for q, part in parts])
    assert {key: len(group) for key, group in groups.items()} == {
        ("a", "common"): 1,
        ("a", "local"): 2,
        ("b", "whole"): 1,
    }


@pytest.mark.parametrize("first", [0, 33_000, 33_007])
def test_every_pair_of_devices_is_met_as_often(first):
    runs = [levels_of(seed) for seed in range(first, first + 24)]
    names = ("tracker", "robot", "pointer")
    sizes = {"tracker": len(TRACKERS), "robot": len(ROBOTS), "pointer": len(POINTERS)}
    for pair in combinations(names, 2):
        counts = Counter(tuple(getattr(run, name) for name in pair) for run in runs)
        assert len(counts) == sizes[pair[0]] * sizes[pair[1]]
        assert len(set(counts.values())) == 1
