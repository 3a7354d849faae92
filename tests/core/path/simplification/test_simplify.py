from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.reference.path.brute_force_simplification import (
    within_frechet as path_within_frechet,
)
from benchmarks.reference.path.path_coverage import length_mm
from benchmarks.reference.path.removal_order import removal_order
from rona_core.errors import InvalidInputError
from rona_core.path.simplification.error_bound import (
    ROUNDING,
    ErrorBound,
    deviations,
    distances_to_segment,
)
from rona_core.path.simplification.simplify import METHODS, simplify
from tests.helpers.paths import demonstration, deviation, piece_cost
from tests.helpers.strategies import random_pose, seeds

few = settings(max_examples=25, deadline=None)
metrics = st.sampled_from(["k1", "k2", "k3"])


def walk(rng, n=40, m=3):
    return np.cumsum(rng.normal(0, 1, (n, m)), axis=0) + rng.normal(0, 0.3, (n, m))


def textbook_greedy(path, tolerance, metric, keep=(), frechet_mm=None):
    """Evaluate every removal afresh in each step, as the method is told: what stays, what goes."""
    nothing = ROUNDING * abs(path).max() * (abs(path).max() if metric == "k3" else 1.0)

    @cache
    def cost_of(a, b):
        if frechet_mm is not None and not within_frechet(path[a : b + 1], frechet_mm):
            return np.inf
        cost = piece_cost(path[a : b + 1], metric)
        return 0.0 if cost <= nothing else cost

    kept, gone = list(range(len(path))), []
    while True:
        offers = [
            (cost_of(a, b), b - a, i)
            for a, i, b in zip(kept[:-2], kept[1:-1], kept[2:], strict=True)
            if i not in keep and cost_of(a, b) < np.inf
        ]
        if not offers or min(offers)[0] > tolerance:
            return kept, gone
        gone.append(min(offers)[2])
        kept.remove(gone[-1])


def within_frechet(piece, tolerance):
    """Decide the Frechet distance of a piece and its segment by walking the balls in order."""
    a, chord = piece[0], piece[-1] - piece[0]
    at = 0.0
    for p in piece[1:-1]:
        qa, qb = chord @ chord, -2 * chord @ (p - a)
        qc = (p - a) @ (p - a) - tolerance**2
        if qa == 0:
            if qc > 0:
                return False
            continue
        root = qb**2 - 4 * qa * qc
        if root < 0:
            return False
        low, high = (-qb - np.sqrt(root)) / (2 * qa), (-qb + np.sqrt(root)) / (2 * qa)
        at = max(at, low, 0.0)
        if at > min(high, 1.0):
            return False
    return True


def within_k1(piece, tolerance):
    return distances_to_segment(piece, piece[0], piece[-1]).max() <= tolerance


def fewest_by_trying_all(path, within, keep=()):
    steps = [0] + [len(path)] * (len(path) - 1)
    for j in range(1, len(path)):
        for i in range(j):
            free = not any(i < k < j for k in keep)
            if free and steps[i] + 1 < steps[j] and (j == i + 1 or within(path[i : j + 1])):
                steps[j] = steps[i] + 1
    return steps[-1] + 1


@given(
    seed=seeds,
    metric=metrics,
    tolerance=st.sampled_from([0.0, 0.5, 1.5, 4.0, 1e9]),
    frechet_mm=st.sampled_from([None, 1.5]),
)
@few
def test_greedy_is_the_textbook_greedy(seed, metric, tolerance, frechet_mm):
    rng = np.random.default_rng(seed)
    path = walk(rng, m=int(rng.integers(1, 7)))
    keep = rng.choice(40, 3, replace=False)
    found = removal_order(path, metric, keep=keep, tolerance=tolerance, frechet_mm=frechet_mm)
    kept, gone = textbook_greedy(path, tolerance, metric, set(keep.tolist()), frechet_mm)
    assert found.index.tolist() == gone
    assert found.kept_within(tolerance).tolist() == kept


@given(seed=seeds, metric=metrics)
@few
def test_ties_go_to_the_shorter_gap_and_then_to_the_first(seed, metric):
    rng = np.random.default_rng(seed)
    path = rng.integers(0, 3, (30, 2)).astype(float)  # full of repeated points and equal costs
    for tolerance in (0.0, 0.5, 1.0):
        found = removal_order(path, metric, tolerance=tolerance)
        assert found.index.tolist() == textbook_greedy(path, tolerance, metric)[1]


def test_a_long_path_goes_in_the_order_of_the_textbook():
    path, _ = demonstration(np.random.default_rng(3), 400)
    assert removal_order(path).index.tolist() == textbook_greedy(path, np.inf, "k1")[1]


@given(seed=seeds, metric=metrics, method=st.sampled_from(METHODS))
@few
def test_the_bound_holds_and_is_reported(seed, metric, method):
    rng = np.random.default_rng(seed)
    path = walk(rng, 60, m=int(rng.integers(1, 5)))
    tolerance, keep = rng.uniform(0.2, 4.0), rng.choice(60, 3, replace=False)
    cap = None if metric == "k1" else 2.0
    bound = ErrorBound(tolerance, metric, cap_mm=cap)
    found = simplify(path, bound, method=method, keep=keep)
    check = deviations(path, found.index)
    near = tolerance if cap is None else cap
    assert {"k1": check.k1_mm, "k2": check.k2_mm, "k3": check.k3_mm2}[metric] <= tolerance + 1e-12
    assert path_within_frechet(path, found.index, near * (1 + 1e-12))
    assert set(keep.tolist()) <= set(found.index.tolist())
    assert (found.k1_mm, found.k2_mm, found.k3_mm2, found.where) == (
        check.k1_mm,
        check.k2_mm,
        check.k3_mm2,
        check.where,
    )
    assert (found.n_original, found.metric, found.method) == (60, metric, method)
    assert found.lower_bound <= len(found)
    assert found.exact == (method == "optimal")
    assert found.frechet
    best = simplify(path, bound, keep=keep)
    assert best.exact
    assert found.lower_bound <= len(best) <= len(found)


@given(seed=seeds, method=st.sampled_from(METHODS))
@few
def test_moving_the_path_keeps_the_same_points(seed, method):
    rng = np.random.default_rng(seed)
    path, _ = demonstration(rng, 80)
    T = random_pose(rng, 100.0)
    found = simplify(path, 1.0, method=method)
    np.testing.assert_array_equal(simplify(T @ path, 1.0, method=method).index, found.index)


@given(seed=seeds, tolerance=st.sampled_from([0.4, 1.0, 2.5]), frechet=st.booleans())
@few
def test_optimal_keeps_as_few_points_as_trying_everything(seed, tolerance, frechet):
    rng = np.random.default_rng(seed)
    path = walk(rng, 50, m=int(rng.integers(1, 7)))
    keep = rng.choice(50, 2, replace=False)
    found = simplify(path, ErrorBound(tolerance, frechet=frechet), keep=keep)
    within = within_frechet if frechet else within_k1
    expected = fewest_by_trying_all(path, lambda q: within(q, tolerance), keep.tolist())
    assert len(found) == expected
    assert found.exact
    assert set(keep.tolist()) <= set(found.index.tolist())
    for a, b in zip(found.index[:-1], found.index[1:], strict=True):
        assert within(path[a : b + 1], tolerance * (1 + 1e-9))


@pytest.mark.sweep(1)
@pytest.mark.parametrize("metric", ["k2", "k3"])
def test_optimal_by_mean_and_area_keeps_as_few_as_trying_everything(metric):
    path = walk(np.random.default_rng(4), 40)
    bound = ErrorBound(1.5, metric)
    found = simplify(path, bound)
    expected = fewest_by_trying_all(path, lambda q: piece_cost(q, metric) <= 1.5)
    assert len(found) == expected <= len(simplify(path, bound, method="greedy"))


def test_fast_follows_close_behind():
    path, _ = demonstration(np.random.default_rng(5), 1500)
    best, fast = simplify(path, 1.0), simplify(path, 1.0, method="fast")
    assert len(best) <= len(fast) <= 1.1 * len(best)
    assert not fast.exact


def test_what_would_take_too_long_is_done_fast_and_says_so(monkeypatch):
    path, _ = demonstration(np.random.default_rng(6), 300)
    monkeypatch.setattr("rona_core.path.simplification.simplify.MAX_WORK", 1e3)
    found = simplify(path, 1.0)
    assert (found.method, found.exact) == ("fast", False)
    assert simplify(path, ErrorBound(0.5, "k2", cap_mm=1.0)).method == "fast"


@pytest.mark.sweep(6)
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("metric", ["k1", "k2", "k3"])
def test_every_metric_and_method_simplifies_a_path_of_any_length(monkeypatch, metric, method):
    path, _ = demonstration(np.random.default_rng(6), 300)
    monkeypatch.setattr("rona_core.path.simplification.simplify.MAX_WORK", 1e3)
    found = simplify(path, ErrorBound(1.0, metric), method=method)
    searched = method in ("optimal", "fast")
    replaced = "greedy" if metric != "k1" and searched else "fast" if searched else method
    assert found.method == replaced
    assert deviation(path, found.index, metric) <= 1.0 + 1e-9
    assert len(found) < len(path)
    assert not found.exact
    said = f"greedy in place of {method}"
    assert (said in found.rule) == (replaced == "greedy" != method)
    if replaced == "greedy":
        np.testing.assert_array_equal(
            found.index, simplify(path, ErrorBound(1.0, metric), method="greedy").index
        )


@pytest.mark.slow
def test_the_demonstrated_path_shrinks_as_published():
    counts = []
    for seed in range(5):
        path, _ = demonstration(np.random.default_rng(seed))
        counts.append([len(simplify(path, 1.0, method=m)) for m in ("greedy", "optimal")])
    greedy, optimal = np.median(counts, axis=0)
    assert 80 <= greedy <= 101  # 90 of 307 in the paper, on a path that is not published
    assert optimal <= 0.9 * greedy


def test_no_single_further_point_can_go():
    path, _ = demonstration(np.random.default_rng(1), 150)
    kept = simplify(path, 1.0, method="greedy").index.tolist()
    for a, b in zip(kept[:-2], kept[2:], strict=True):
        assert not within_frechet(path[a : b + 1], 1.0)


@pytest.mark.parametrize("metric", ["k1", "k2", "k3"])
def test_the_removal_order_cut_anywhere_is_the_simplified_path(metric):
    path, _ = demonstration(np.random.default_rng(2), 100)
    order = removal_order(path, metric)
    assert sorted(order.index.tolist()) == list(range(1, 99))
    highest = np.maximum.accumulate(order.cost)
    for tolerance in (0.1, 1.0, 5.0):
        n = int(np.searchsorted(highest, tolerance, side="right"))
        bound = ErrorBound(tolerance, metric, frechet=False)
        expected = simplify(path, bound, method="greedy").index
        np.testing.assert_array_equal(order.kept(n), expected)
        assert deviation(path, order.kept(n), metric) <= tolerance
        np.testing.assert_array_equal(order.kept_within(tolerance), expected)


def test_straight_lines_and_repeated_points_collapse():
    line = np.outer(np.linspace(0, 300, 2000), (0.6, 0.0, 0.8))
    for method in METHODS:
        assert simplify(line, 0.1, method=method).index.tolist() == [0, 1999]
        assert simplify(np.ones((50, 3)), 0.0, method=method).index.tolist() == [0, 49]
        dwell = np.repeat(((0, 0, 0), (10, 0, 0), (10, 10, 0.0)), 20, axis=0)
        assert len(simplify(dwell, 0.5, method=method)) == 3


@pytest.mark.parametrize("method", METHODS)
def test_strokes_that_run_back_over_themselves_stay(method):
    x = np.concatenate([np.linspace(0, 25, 40)[:: (-1) ** k] for k in range(9)])
    raster = np.column_stack((x, np.repeat(np.arange(9) * 0.4, 40), 0 * x))
    found = simplify(raster, 1.0, method=method)
    assert length_mm(raster[found.index]) > 0.88 * length_mm(raster)
    lost = simplify(raster, ErrorBound(1.0, frechet=False), method="optimal")
    assert length_mm(raster[lost.index]) < 0.6 * length_mm(raster)  # K1 cannot see them


def test_short_paths_stay_as_they_are():
    for method in METHODS:
        assert simplify([[1.0, 2.0, 3.0]], 1.0, method=method).index.tolist() == [0]
        assert simplify([[0.0], [9.0]], 1.0, method=method).index.tolist() == [0, 1]


def test_wrong_input_is_refused():
    path = np.zeros((5, 3))
    with pytest.raises(InvalidInputError, match="tolerance"):
        simplify(path, -1.0)
    with pytest.raises(InvalidInputError, match="tolerance"):
        simplify(path, np.nan)
    with pytest.raises(InvalidInputError, match="method"):
        simplify(path, 1.0, method="magic")
    with pytest.raises(InvalidInputError, match="metric"):
        ErrorBound(1.0, "k4")
    with pytest.raises(InvalidInputError, match="cap_mm"):
        ErrorBound(1.0, cap_mm=1.0)
    with pytest.raises(InvalidInputError, match="frechet_mm"):
        removal_order(path, frechet_mm=-1.0)
    with pytest.raises(InvalidInputError, match="keep"):
        simplify(path, 1.0, keep=[5])
    with pytest.raises(InvalidInputError, match="shape"):
        simplify(np.zeros((0, 3)), 1.0)
