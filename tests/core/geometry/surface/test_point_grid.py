"""Points hashed by a grid against a tree: the same neighbours everywhere, and their moments."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree

from rona_core.geometry.surface.normals import point_grid
from rona_core.geometry.surface.normals.point_grid import PointGrid
from tests.helpers.strategies import cap, random_rotation, seeds

some = settings(max_examples=25, deadline=None)


def lattice(rng):
    """Points on the borders of cells of one radius, and exactly one radius apart."""
    return rng.integers(-4, 5, (300, 3)) * 1.0


def uneven(rng):
    """Points of densities from one to 10^9, far apart."""
    return np.vstack([rng.normal(0, 0.01 * 10**k, (60, 3)) + 50.0 * k for k in range(4)])


CLOUDS = {
    "skull": lambda rng: cap(rng, 800, 80.0, 20.0) + rng.normal(0, 0.3, (800, 3)),
    "lattice": lattice,
    "fine lattice": lambda rng: rng.integers(-20, 21, (300, 3)) * 0.1,
    "duplicates": lambda rng: np.repeat(rng.uniform(-3, 3, (40, 3)), 8, axis=0),
    "one place": lambda rng: np.tile(rng.uniform(-300, 300, 3), (50, 1)),
    "far away": lambda rng: rng.uniform(-5, 5, (300, 3)) + rng.uniform(-1, 1, 3) * 1e9,
    "very wide": lambda rng: rng.normal(0, 1, (200, 3)) * 10.0 ** rng.uniform(-3, 12, (200, 1)),
    "few": lambda rng: rng.uniform(-1, 1, (rng.integers(0, 4), 3)),
    "line": lambda rng: np.outer(rng.uniform(-30, 30, 200), (1.0, 0, 0)),
    "tilted line": lambda rng: np.outer(rng.uniform(-30, 30, 200), random_rotation(rng)[0]),
    "uneven": uneven,
    "empty cells": lambda rng: rng.uniform(-100, 100, (200, 3)),
}


def places_for(rng, points):
    """Return places on the points, near them, between them and far off."""
    about = points[rng.integers(0, len(points), 60)] if len(points) else np.zeros((60, 3))
    near = about + rng.normal(0, 1, about.shape)
    return np.vstack((points, near, rng.uniform(-200, 200, (20, 3)), ((1e9, -1e15, 0.0),)))


@pytest.mark.parametrize("cloud", CLOUDS)
@given(seed=seeds, radius=st.sampled_from([0.1, 1.0, 2.0, 3.0, 6.0, 1e4]))
@some
def test_the_neighbours_are_those_of_a_tree(cloud, seed, radius):
    rng = np.random.default_rng(seed)
    points = CLOUDS[cloud](rng)
    places = places_for(rng, points)
    tree = KDTree(points)
    grid = PointGrid(points, radius)
    count = grid.moments(places).count
    expected = tree.query_ball_point(places, radius, return_length=True)
    np.testing.assert_array_equal(count, expected)
    rows = np.split(grid.neighbours(places), np.cumsum(count)[:-1])
    for found, near in zip(rows, tree.query_ball_point(places, radius), strict=True):
        assert sorted(found) == sorted(near)


@given(seed=seeds, radius=st.floats(0.5, 50.0), shift=st.sampled_from([0.0, 1e3, 1e7]))
@some
def test_the_moments_are_those_of_the_neighbours(seed, radius, shift):
    rng = np.random.default_rng(seed)
    points = CLOUDS["skull"](rng) + shift * rng.uniform(-1, 1, 3)
    places = points[:30] + rng.normal(0, 1, (30, 3))
    grid = PointGrid(points, radius)
    moments = grid.moments(places)
    rows = np.split(grid.neighbours(places), np.cumsum(moments.count)[:-1])
    for k, near in enumerate(rows):
        if not len(near):
            np.testing.assert_array_equal(moments.centroids[k], 0.0)
            np.testing.assert_array_equal(moments.scatter[k], 0.0)
            continue
        offsets = points[near] - places[k]
        np.testing.assert_allclose(moments.centroids[k], offsets.mean(axis=0), atol=1e-13 * radius)
        np.testing.assert_allclose(
            moments.scatter[k],
            np.cov(offsets.T, bias=True),
            rtol=0,
            atol=moments.rounding_mm2,
        )


@pytest.mark.parametrize("block", [1, 50, 10**7])
def test_the_size_of_the_blocks_changes_nothing(monkeypatch, block):
    rng = np.random.default_rng(1)
    points = CLOUDS["skull"](rng)
    grid = PointGrid(points, 6.0)
    before, near = grid.moments(points), grid.neighbours(points)
    monkeypatch.setattr(point_grid, "BLOCK", block)
    after = grid.moments(points)
    np.testing.assert_array_equal(after.count, before.count)
    np.testing.assert_allclose(after.scatter, before.scatter, atol=before.rounding_mm2)
    np.testing.assert_array_equal(grid.neighbours(points), near)
