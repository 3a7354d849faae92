"""The inner boundary between the cells of its map: planes as they are, crests not cut off."""

import numpy as np
import pytest

from rona_core.geometry.cell_grid import CellGrid
from rona_core.geometry.pose import Pose
from rona_core.mapping.boundary_map import BoundaryMap
from rona_core.planning.placement.problem import InnerBoundary

AT_MM = np.arange(-6.0, 7.0)
U, V = np.meshgrid(AT_MM, AT_MM, indexing="ij")


GRID = CellGrid(np.array((-6.0, -6.0)), 1.0, U.shape)
WHOLE = np.ones(U.shape, dtype=np.bool_)


def inner_boundary(height_mm, draws_mm, ok=WHOLE):
    boundary = BoundaryMap(Pose.identity(), AT_MM, AT_MM, height_mm, ok)
    return InnerBoundary(boundary, GRID, draws_mm)


def looked_up(height_mm, places_mm):
    """Return the height of the map, and those of two draws, one of them 1 mm higher."""
    inner = inner_boundary(height_mm, np.stack((height_mm, height_mm + 1.0)))
    operator = inner.grid.operator(places_mm)
    return operator @ inner.height_mm, operator @ inner.draws_mm


def test_a_plane_is_a_plane_up_to_the_edge_of_the_map():
    places = np.random.default_rng(0).uniform(-6.0, 6.0, (200, 2))
    expected = -5.0 + places @ (0.3, -0.2)
    mapped, drawn = looked_up(-5.0 + 0.3 * U - 0.2 * V, places)
    np.testing.assert_allclose(mapped, expected, atol=1e-12)
    np.testing.assert_allclose(drawn, expected[:, None] + (0.0, 1.0), atol=1e-12)


def test_slopes_and_cosine_are_those_of_a_plane():
    inner = inner_boundary(0.3 * U - 0.4 * V, np.zeros((1, *U.shape)))
    np.testing.assert_allclose(inner.slopes, np.tile((0.3, -0.4), (len(inner.slopes), 1)))
    np.testing.assert_allclose(inner.cosine, 1.0 / np.sqrt(1.25))


@pytest.mark.parametrize("reach_mm", [2.0, 3.0])
def test_less_of_a_crest_between_cells_is_lost_than_by_planes(reach_mm):
    def height(places):
        return np.exp(-0.5 * np.sum((places - 0.5) ** 2, axis=-1) / reach_mm**2)

    cells = np.stack((U, V), axis=-1)
    top = np.array([[0.5, 0.5]])
    lost = 1.0 - looked_up(height(cells), top)[0][0]
    plain = GRID.operator(top) @ height(cells).ravel()
    assert abs(lost) < 0.15 * (1.0 - plain[0])
    anywhere = np.random.default_rng(1).uniform(-5.0, 5.0, (500, 2))
    off = looked_up(height(cells), anywhere)[0] - height(anywhere)
    assert np.abs(off).max() < 0.08 / reach_mm**2  # by planes 0.25


def test_cells_that_are_not_mapped_change_nothing_between_those_that_are():
    """Along both axes, beside an edge, a corner and a notch of what is mapped."""
    ok = (U < 3.0) & (V > -4.0) & ~((np.abs(U) < 1.5) & (V > 2.5))
    random = np.random.default_rng(2)
    draws = random.standard_normal((45, *U.shape))
    wild = np.where(ok, draws, 1e6)
    places = random.uniform(-6.0, 6.0, (4000, 2))
    corner, _ = GRID.corners(places)
    i, j = corner.T
    among = ok[i, j] & ok[i + 1, j] & ok[i, j + 1] & ok[i + 1, j + 1]
    tame, other = (inner_boundary(some[0], some, ok) for some in (draws, wild))
    operator = tame.grid.operator(places[among])
    assert among.sum() > 1000
    np.testing.assert_array_equal(operator @ tame.draws_mm, operator @ other.draws_mm)
    np.testing.assert_array_equal(operator @ tame.height_mm, operator @ other.height_mm)


def test_at_the_cells_of_the_map_draws_are_as_they_came():
    draws = np.random.default_rng(3).standard_normal((45, *U.shape))
    found = inner_boundary(draws[0], draws).draws_at_cells_mm()
    np.testing.assert_array_equal(found, draws.reshape(45, -1).T)
