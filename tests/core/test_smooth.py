import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.errors import CancelledError, InvalidInputError
from rona_core.path.coverage import length_mm
from rona_core.path.deviation import deviation, deviations
from rona_core.path.removal import piece_cost, removal_order
from rona_core.path.smooth import simplify
from tests.core.paths import demonstration
from tests.core.strategies import random_pose, seeds

few = settings(max_examples=25, deadline=None)
metrics = st.sampled_from(["k1", "k2", "k3"])


def walk(rng, n=40, m=3):
    return np.cumsum(rng.normal(0, 1, (n, m)), axis=0) + rng.normal(0, 0.3, (n, m))


def textbook_greedy(path, tolerance, metric, keep=()):
    """Evaluate every removal afresh in each step, as the method is told."""
    kept = list(range(len(path)))
    while True:
        offers = [
            (piece_cost(path[a : b + 1], metric), b - a, i)
            for a, i, b in zip(kept[:-2], kept[1:-1], kept[2:], strict=True)
            if i not in keep
        ]
        if not offers or min(offers)[0] > tolerance:
            return kept
        kept.remove(min(offers)[2])


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


def fewest_by_trying_all(path, tolerance, keep=()):
    steps = [0] + [len(path)] * (len(path) - 1)
    for j in range(1, len(path)):
        for i in range(j):
            free = not any(i < k < j for k in keep)
            if free and steps[i] + 1 < steps[j] and within_frechet(path[i : j + 1], tolerance):
                steps[j] = steps[i] + 1
    return steps[-1] + 1


@given(seed=seeds, metric=metrics, tolerance=st.sampled_from([0.0, 0.5, 1.5, 4.0, 1e9]))
@few
def test_greedy_is_the_textbook_greedy(seed, metric, tolerance):
    rng = np.random.default_rng(seed)
    path = walk(rng, m=int(rng.integers(1, 7)))
    keep = rng.choice(40, 3, replace=False)
    found = simplify(path, tolerance, metric=metric, keep=keep)
    assert found.index.tolist() == textbook_greedy(path, tolerance, metric, set(keep.tolist()))


@given(seed=seeds, metric=metrics)
@few
def test_ties_go_to_the_shorter_gap_and_then_to_the_first(seed, metric):
    rng = np.random.default_rng(seed)
    path = rng.integers(0, 3, (30, 2)).astype(float)  # full of repeated points and equal costs
    for tolerance in (0.0, 0.5, 1.0):
        found = simplify(path, tolerance, metric=metric)
        assert found.index.tolist() == textbook_greedy(path, tolerance, metric)


@given(seed=seeds, metric=metrics, method=st.sampled_from(["greedy", "optimal"]))
@few
def test_the_bound_holds_and_is_reported(seed, metric, method):
    rng = np.random.default_rng(seed)
    path = walk(rng, 60)
    metric = "k1" if method == "optimal" else metric
    tolerance = rng.uniform(0.2, 4.0)
    found = simplify(path, tolerance, metric=metric, method=method)
    assert deviation(path, found.index, metric) <= tolerance * (1 + 1e-12)
    check = deviations(path, found.index)
    assert (found.k1_mm, found.k2_mm, found.k3_mm2, found.where) == (
        check.k1_mm,
        check.k2_mm,
        check.k3_mm2,
        check.where,
    )
    assert (found.n_original, found.metric, found.method) == (60, metric, method)


@given(seed=seeds, method=st.sampled_from(["greedy", "optimal"]))
@few
def test_moving_the_path_keeps_the_same_points(seed, method):
    rng = np.random.default_rng(seed)
    path, _ = demonstration(rng, 80)
    T = random_pose(rng, 100.0)
    found = simplify(path, 1.0, method=method)
    np.testing.assert_array_equal(simplify(T @ path, 1.0, method=method).index, found.index)


@given(seed=seeds, tolerance=st.sampled_from([0.4, 1.0, 2.5]))
@few
def test_optimal_keeps_as_few_points_as_trying_everything(seed, tolerance):
    rng = np.random.default_rng(seed)
    path = walk(rng, 50, m=int(rng.integers(1, 7)))
    keep = rng.choice(50, 2, replace=False)
    found = simplify(path, tolerance, method="optimal", keep=keep)
    assert len(found) == fewest_by_trying_all(path, tolerance, keep.tolist())
    assert set(keep.tolist()) <= set(found.index.tolist())
    for a, b in zip(found.index[:-1], found.index[1:], strict=True):
        assert within_frechet(path[a : b + 1], tolerance * (1 + 1e-9))


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
    kept = simplify(path, 1.0).index.tolist()
    for a, b in zip(kept[:-2], kept[2:], strict=True):
        assert piece_cost(path[a : b + 1], "k1") > 1.0


@pytest.mark.parametrize("metric", ["k1", "k2", "k3"])
def test_the_removal_order_cut_anywhere_is_the_simplified_path(metric):
    path, _ = demonstration(np.random.default_rng(2), 100)
    order = removal_order(path, metric)
    assert sorted(order.index.tolist()) == list(range(1, 99))
    highest = np.maximum.accumulate(order.cost)
    for tolerance in (0.1, 1.0, 5.0):
        n = int(np.searchsorted(highest, tolerance, side="right"))
        expected = simplify(path, tolerance, metric=metric).index
        np.testing.assert_array_equal(order.kept(n), expected)
        assert deviation(path, order.kept(n), metric) <= tolerance


def test_straight_lines_and_repeated_points_collapse():
    line = np.outer(np.linspace(0, 300, 2000), (0.6, 0.0, 0.8))
    for method in ("greedy", "optimal"):
        assert simplify(line, 0.1, method=method).index.tolist() == [0, 1999]
        assert simplify(np.ones((50, 3)), 0.0, method=method).index.tolist() == [0, 49]
        dwell = np.repeat(((0, 0, 0), (10, 0, 0), (10, 10, 0.0)), 20, axis=0)
        assert len(simplify(dwell, 0.5, method=method)) == 3


def test_optimal_keeps_strokes_that_run_back_over_themselves():
    x = np.concatenate([np.linspace(0, 25, 40)[:: (-1) ** k] for k in range(9)])
    raster = np.column_stack((x, np.repeat(np.arange(9) * 0.4, 40), 0 * x))
    found = simplify(raster, 1.0, method="optimal")
    assert length_mm(raster[found.index]) > 0.88 * length_mm(raster)


def test_short_paths_stay_as_they_are():
    for method in ("greedy", "optimal"):
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
        simplify(path, 1.0, metric="k4")
    with pytest.raises(InvalidInputError, match="only the metric k1"):
        simplify(path, 1.0, metric="k2", method="optimal")
    with pytest.raises(InvalidInputError, match="keep"):
        simplify(path, 1.0, keep=[5])
    with pytest.raises(InvalidInputError, match="shape"):
        simplify(np.zeros((0, 3)), 1.0)
    with pytest.raises(CancelledError):
        simplify(path, 1.0, method="optimal", cancel=lambda: True)
