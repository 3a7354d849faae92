from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.spatial.distance import directed_hausdorff

from rona_core.errors import InvalidInputError
from rona_core.path.simplification.error_bound import (
    deviations,
    distances_to_segment,
    feet_on_segment,
    strip_areas,
)
from tests.helpers.paths import deviation, piece_cost
from tests.helpers.strategies import random_pose, seeds

few = settings(max_examples=25, deadline=None)


def walk(rng, n=40, m=3):
    return np.cumsum(rng.normal(0, 1, (n, m)), axis=0)


def some_index(rng, n):
    inner = np.sort(rng.choice(np.arange(1, n - 1), rng.integers(0, n // 2), replace=False))
    return np.concatenate(([0], inner, [n - 1]))


@given(seed=seeds)
@few
def test_moving_the_path_changes_no_figure(seed):
    rng = np.random.default_rng(seed)
    path, T = walk(rng), random_pose(rng)
    index = some_index(rng, 40)
    here, there = deviations(path, index), deviations(T @ path, index)
    for name in ("k1_mm", "k2_mm", "k3_mm2"):
        assert getattr(there, name) == pytest.approx(getattr(here, name), abs=1e-8)
    back = deviations(path[::-1], (39 - index)[::-1])
    for name in ("k1_mm", "k2_mm", "k3_mm2"):
        assert getattr(back, name) == pytest.approx(getattr(here, name), abs=1e-10)


@given(seed=seeds)
@few
def test_the_figures_are_those_of_the_worst_piece(seed):
    rng = np.random.default_rng(seed)
    m = int(rng.integers(1, 7))
    path, index = walk(rng, m=m), some_index(rng, 40)
    for metric in ("k1", "k2", "k3"):
        worst = max(piece_cost(path[a : b + 1], metric) for a, b in pairwise(index))
        assert deviation(path, index, metric) == pytest.approx(worst, abs=1e-12)


def test_the_figures_of_a_small_path_by_hand():
    path = np.array(((0, 0, 0), (2, 3, 0), (4, 0, 0), (6, -1, 0), (8, 0, 0.0)))
    found = deviations(path, [0, 2, 4])
    assert found.k1_mm == pytest.approx(3.0)
    assert found.k2_mm == pytest.approx(np.sqrt(9 / 3))
    assert found.k3_mm2 == pytest.approx(6.0)
    assert found.where == 1
    assert deviations(path, [0, 1, 2, 3, 4]) == deviations(path[:1], [0])


def test_the_distance_is_to_the_segment_and_not_to_its_line():
    path = np.array(((0, 0), (10, 0), (-5, 0), (1, 0.0)))
    assert deviation(path, [0, 3], "k1") == pytest.approx(9.0)
    loop = np.array(((0, 0), (3, 4), (0, 0.0)))
    assert deviation(loop, [0, 2], "k1") == pytest.approx(5.0)


@given(seed=seeds)
@few
def test_k1_is_the_hausdorff_distance_of_the_continuous_piece(seed):
    path = walk(np.random.default_rng(seed), 12)
    t = np.linspace(0, 1, 400)[:, None]
    dense = np.vstack([a + t * (b - a) for a, b in pairwise(path)])
    chord = path[0] + np.linspace(0, 1, 4000)[:, None] * (path[-1] - path[0])
    k1 = deviation(path, [0, 11], "k1")
    assert directed_hausdorff(dense, chord)[0] == pytest.approx(k1, abs=5e-3)
    assert directed_hausdorff(chord, dense)[0] <= k1 + 1e-2


def test_k3_of_a_flat_path_is_the_area_between_the_curves():
    x = np.linspace(0, 2 * np.pi, 41)
    wave = np.column_stack((x, np.sin(x), 0 * x))  # crosses its chord in the middle
    exact = np.trapezoid(np.abs(wave[:, 1]), x)
    assert deviation(wave, [0, 40], "k3") == pytest.approx(exact, rel=1e-12)
    crossing = np.array(((0, 0), (1, 2), (3, -2), (4, 0.0)))  # two triangles cross over
    assert deviation(crossing, [0, 3], "k3") == pytest.approx(4.0)


def test_k3_of_a_twisted_strip_meets_its_integral():
    rng = np.random.default_rng(3)
    path = np.column_stack((np.arange(9.0), rng.normal(0, 0.4, 9), rng.normal(0, 0.4, 9)))
    path[[0, -1], 1:] = 0.0
    feet = feet_on_segment(path, path[0], path[-1])
    s, t = (
        v.ravel() for v in np.meshgrid((np.arange(400) + 0.5) / 400, (np.arange(400) + 0.5) / 400)
    )
    for i, area in enumerate(strip_areas(path[:-1], path[1:], feet[:-1], feet[1:])):
        edge, foot = path[i + 1] - path[i], feet[i + 1] - feet[i]
        ruling = (feet[i] - path[i]) + s[:, None] * (foot - edge)
        along = (1 - t)[:, None] * edge + t[:, None] * foot
        exact = np.linalg.norm(np.cross(along, ruling), axis=1).mean()
        assert area == pytest.approx(exact, rel=5e-3)


def test_points_project_onto_segments_of_any_dimension():
    points = np.array(((-1, 2, 0, 0), (5, 0, 0, 3), (12, 0, 4, 3.0)))
    distances = distances_to_segment(points, np.zeros(4), np.array((10.0, 0, 0, 0)))
    np.testing.assert_allclose(distances, (np.sqrt(5), 3, np.sqrt(29)))


def test_wrong_input_is_refused():
    path = np.zeros((5, 3))
    for index in ([0, 3], [1, 4], [0, 2, 2, 4], [0, 4.0], [[0, 4]], []):
        with pytest.raises(InvalidInputError, match="index"):
            deviations(path, index)
    with pytest.raises(InvalidInputError, match="shape"):
        deviations(np.zeros(5), [0, 4])
    with pytest.raises(InvalidInputError, match="finite"):
        deviations([[0.0], [np.nan]], [0, 1])
