"""Lines that a proposed second pass is held against: as long as wanted, within the map."""

import itertools

import numpy as np
import pytest

from benchmarks.suites.accuracy.next_lines import (
    NextFigures,
    closer_rows,
    metrics,
    random_rows,
    share_over,
)
from rona_core.app.steps.maps.accuracy import map_accuracy
from rona_core.session.document import Session


def length(rows):
    return sum(float(np.linalg.norm(end - start)) for start, end in rows)


def test_random_lines_are_as_long_as_wanted_and_begin_in_the_map(demo):
    ok = demo.results.maps.value.outer.ok
    rows = random_rows(ok, 700.0, np.random.default_rng(5))
    assert length(rows) == pytest.approx(700.0)
    for (_, end), (start, _) in itertools.pairwise(rows):
        np.testing.assert_array_equal(end, start)  # one path
    assert all(ok[tuple(np.rint(start).astype(int))] for start, _ in rows)


def test_closer_rows_lie_evenly_over_the_whole_map(demo):
    maps = demo.results.maps.value
    rows = closer_rows(maps, 700.0)
    assert length(rows) == pytest.approx(700.0, rel=0.15)
    levels = [start[0] for start, _ in rows]
    np.testing.assert_allclose(np.diff(levels), np.diff(levels)[0])
    assert levels[-1] > np.argwhere(maps.outer.ok)[:, 0].max() - np.diff(levels)[0]


def test_the_share_over_a_limit_counts_what_is_not_mapped(demo):
    maps, sigma = demo.results.maps.value, map_accuracy(demo).thickness.whole_own_mm()
    unmapped = 1.0 - maps.inner.ok[maps.outer.ok].mean()
    assert share_over(demo, 100.0) == pytest.approx(unmapped)
    assert share_over(demo, 0.0) == 1.0
    both = maps.inner.ok & maps.outer.ok
    over = share_over(demo, float(np.median(sigma[both])))
    assert over == pytest.approx(unmapped + 0.5 * (1.0 - unmapped), abs=0.01)
    assert share_over(Session()) == 1.0


def test_the_fall_is_that_of_all_patients_together():
    cases = [
        NextFigures(0.4, {"proposed": 0.1, "random": None}, {"proposed": 0.2, "random": None}),
        NextFigures(0.2, {"proposed": 0.05, "random": 0.2}, {"proposed": 0.1, "random": 0.3}),
    ]
    found = {metric.name: metric.value for metric in metrics(cases)}
    assert found["next lines: proposed, of 2: fall of that share"] == pytest.approx(0.75)
    assert found["next lines: random, of 1: fall of that share"] == pytest.approx(0.0)
    assert metrics([]) == []
