import numpy as np
import pytest
from hypothesis import given, settings

from benchmarks.reference.path.path_crossings import crossings
from rona_core.errors import InvalidInputError
from tests.helpers.paths import meander
from tests.helpers.strategies import random_pose, seeds

few = settings(max_examples=20, deadline=None)


def turn(a, b, c):
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


@given(seed=seeds)
@few
def test_in_the_plane_they_are_the_pairs_that_separate_each_other(seed):
    path = np.random.default_rng(seed).uniform(0, 50, (14, 2))
    expected = [
        (i, j)
        for i in range(13)
        for j in range(i + 2, 13)
        if turn(*path[[i, i + 1, j]]) * turn(*path[[i, i + 1, j + 1]]) < 0
        and turn(*path[[j, j + 1, i]]) * turn(*path[[j, j + 1, i + 1]]) < 0
    ]
    found = crossings(np.column_stack((path, np.zeros(14))), min_angle_deg=1e-4)
    assert sorted((c.first, c.second) for c in found) == expected
    assert [c.along_first_mm for c in found] == sorted(c.along_first_mm for c in found)


@given(seed=seeds)
@few
def test_moving_the_path_moves_its_crossings(seed):
    rng = np.random.default_rng(seed)
    path = rng.uniform(0, 20, (20, 3)) * (1, 1, 0.05)
    T = random_pose(rng)
    here, there = crossings(path), crossings(T @ path)
    assert [(c.first, c.second) for c in there] == [(c.first, c.second) for c in here]
    for a, b in zip(here, there, strict=True):
        np.testing.assert_allclose(b.point_base, T @ a.point_base, atol=1e-7)
        assert b.gap_mm == pytest.approx(a.gap_mm, abs=1e-7)
        assert b.angle_deg == pytest.approx(a.angle_deg, abs=1e-5)


def test_a_bow_crosses_once_with_its_place_angle_and_ways():
    (one,) = crossings([[0, 0, 0], [10, 10, 1.0], [10, 0, 1.0], [0, 10, 0]], near_mm=2.0)
    assert (one.first, one.second) == (0, 2)
    np.testing.assert_allclose(one.point_base, (5, 5, 0.5), atol=1e-12)
    assert one.along_first_mm == pytest.approx(np.sqrt(201) / 2)
    assert one.along_second_mm == pytest.approx(np.sqrt(201) * 1.5 + 10)
    assert 85 < one.angle_deg < 90


def test_lines_beside_each_other_and_bridges_do_not_cross():
    assert crossings(meander(300, spacing_mm=0.4)) == ()
    bridge = [[0, 0, 0], [10, 10, 0], [10, 0, 9.0], [0, 10, 9.0]]
    assert crossings(bridge, near_mm=5.0) == ()
    assert len(crossings(bridge, near_mm=9.5)) == 1
    assert crossings([[0, 0, 0], [9, 0, 0], [0, 0, 0], [9, 0, 0]]) == ()
    assert crossings(np.zeros((5, 3))) == crossings([[0, 0, 0]]) == ()


def test_a_corner_on_another_line_counts_once():
    path = [[0, 0, 0], [10, 0, 0], [10, 8, 0], [5, 0, 0], [0, 8, 0]]
    assert len(crossings(path)) == 1
    through = [[0, 0, 0], [10, 0, 0], [10, 8, 0], [5, 0, 0], [5, -8, 0]]
    assert len(crossings(through)) == 1


def test_wrong_input_is_refused():
    with pytest.raises(InvalidInputError, match="near_mm"):
        crossings(np.zeros((3, 3)), near_mm=-1.0)
    with pytest.raises(InvalidInputError, match="min_angle_deg"):
        crossings(np.zeros((3, 3)), min_angle_deg=0.0)
