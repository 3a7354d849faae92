"""The shortest path against trying every subset of the points."""

from itertools import combinations, pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.path.simplification.error_bound import ErrorBound
from rona_core.path.simplification.shortest_path import fewest_points, next_fixed


def walk(seed, n):
    """Return a path (n, 3) that bends, runs back over itself, and stays in one place at times."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(size=(n, 3)) * (1.0, 0.4, 0.2) * rng.choice((-0.5, 0.0, 1.0, 2.0), (n, 1))
    return np.cumsum(steps, axis=0)


def ends_fixed(n, *others):
    fixed = np.zeros(n, dtype=bool)
    fixed[[0, n - 1, *others]] = True
    return fixed


def by_trial(columns, fixed, test):
    """Return the fewest points by trying every subset, smallest first."""
    n = columns.shape[1]
    starts, ends = np.triu_indices(n, 1)
    good = np.zeros((n, n), dtype=bool)
    good[starts, ends] = test.holds(columns, starts, ends)
    free = np.flatnonzero(~fixed)
    for count in range(len(free) + 1):
        for some in combinations(free.tolist(), count):
            kept = np.sort(np.concatenate((np.flatnonzero(fixed), some))).astype(int)
            if all(good[a, b] for a, b in pairwise(kept)):
                return len(kept)
    raise AssertionError("all points together are within every bound")


@settings(max_examples=60)
@given(
    seed=st.integers(0, 10_000),
    n=st.integers(3, 11),
    tolerance=st.sampled_from((0.0, 0.2, 0.6, 1.5)),
    metric=st.sampled_from(("k1", "k2", "k3")),
    frechet=st.booleans(),
)
def test_no_subset_has_fewer_points(seed, n, tolerance, metric, frechet):
    points = walk(seed, n)
    test = ErrorBound(tolerance, metric, frechet).shortcut_test(points)
    columns, fixed = points.T.copy(), ends_fixed(n, n // 2)
    kept = fewest_points(columns, fixed, test)
    assert test.holds(columns, kept[:-1], kept[1:]).all()
    assert set(np.flatnonzero(fixed)) <= set(kept.tolist())
    assert len(kept) == by_trial(columns, fixed, test)


def test_every_corner_of_a_wide_zigzag_stays():
    corners = np.array([(10.0 * i, 10.0 * (i % 2), 0.0) for i in range(41)])
    between = np.linspace(0.0, 1.0, 5)[:-1]
    points = np.concatenate(
        [a + between[:, None] * (b - a) for a, b in pairwise(corners)] + [corners[-1:]]
    )
    test = ErrorBound(0.5).shortcut_test(points)
    kept = fewest_points(points.T.copy(), ends_fixed(len(points)), test)
    np.testing.assert_array_equal(points[kept], corners)


def test_a_straight_path_keeps_its_ends_and_what_must_stay():
    points = np.linspace((0.0, 0.0, 0.0), (30.0, 40.0, 0.0), 200)
    test = ErrorBound(0.01).shortcut_test(points)
    assert fewest_points(points.T.copy(), ends_fixed(200), test).tolist() == [0, 199]
    assert fewest_points(points.T.copy(), ends_fixed(200, 70), test).tolist() == [0, 70, 199]


def test_the_next_point_that_stays_is_found_for_all_but_the_last():
    assert next_fixed(ends_fixed(7, 3)).tolist() == [3, 3, 3, 6, 6, 6]
