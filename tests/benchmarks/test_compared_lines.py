"""Lines that those for a bed are held against: as long as wanted, within the map."""

import itertools

import numpy as np
import pytest

from benchmarks.suites.implant.bed_lines import closer_rows, random_rows


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
