"""Rings leave no place of a region farther than half a pitch, whatever its form."""

import numpy as np
import pytest
import shapely
from scipy.spatial import KDTree
from shapely.geometry import Point, box

from rona_core.planning.milling.burr import ball
from rona_core.planning.milling.tool_regions import Level, strokes

PITCH_MM = 1.0
REGIONS = {
    "disc": Point(0, 0).buffer(6.3, quad_segs=32),
    "small disc": Point(0, 0).buffer(0.3, quad_segs=32),
    "sharp corners": box(-7, -4, 7, 4),
    "stadium": shapely.LineString([(-4, 0), (4, 0)]).buffer(5.1, quad_segs=32),
    "dumbbell": Point(-6, 0).buffer(4.2) | Point(6, 0).buffer(3.1) | box(-6, -0.8, 6, 0.8),
    "ring": Point(0, 0).buffer(7.0) - Point(1, 0).buffer(3.0),
    "two": Point(-6, 0).buffer(4.2) | Point(6, 0).buffer(3.1),
    "triangle": shapely.Polygon([(-7, -5), (8, -4), (-1, 9)]),
}


def lines_of(region):
    return strokes(Level(0, 0.0, 1.0, region), ball(4.0), PITCH_MM)


@pytest.mark.parametrize("name", REGIONS)
def test_every_place_is_within_half_a_pitch(name):
    region = REGIONS[name]
    lines = [shapely.segmentize(shapely.LineString(line), 0.02) for line in lines_of(region)]
    known = KDTree(np.vstack([shapely.get_coordinates(line) for line in lines]))
    x, y = np.meshgrid(np.arange(-10, 10.01, 0.1), np.arange(-10, 10.01, 0.1))
    inside = shapely.contains_xy(region, x, y)
    away = known.query(np.column_stack((x[inside], y[inside])))[0]
    assert away.max() <= 0.5 * PITCH_MM * 1.02 + 0.01


@pytest.mark.parametrize("name", REGIONS)
def test_no_ring_leaves_the_region(name):
    room = REGIONS[name].buffer(0.005)
    assert all(room.covers(shapely.LineString(line)) for line in lines_of(REGIONS[name]))


def test_rings_of_a_disc_are_even_and_begin_inside():
    radii = [np.linalg.norm(line, axis=1).mean() for line in lines_of(REGIONS["disc"])]
    steps = np.diff(radii)
    np.testing.assert_allclose(steps, steps[0], atol=0.02)
    assert 2.0 * radii[0] == pytest.approx(steps[0], abs=0.03)
    assert steps[0] <= PITCH_MM
    assert radii[-1] == pytest.approx(6.3, abs=0.01)


def test_a_rim_pass_goes_along_the_wall_and_over_what_is_left_alone():
    region = REGIONS["disc"]
    wall = Point(0, 0).buffer(8.3) - Point(0, 0).buffer(6.0)
    lines = strokes(Level(1, 0.0, 1.0, region, wall), ball(4.0), PITCH_MM)
    radii = [np.linalg.norm(line, axis=1).mean() for line in lines]
    assert max(radii) == pytest.approx(6.3, abs=0.01)
    assert min(radii) > 6.0 - PITCH_MM
    half = shapely.intersection(wall, box(0, -9, 9, 9))
    lines = strokes(Level(1, 0.0, 1.0, region, half), ball(4.0), PITCH_MM)
    assert min(line[:, 0].min() for line in lines) > -3.0
    assert all((line[0] != line[-1]).any() for line in lines)
