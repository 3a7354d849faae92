import numpy as np
import pytest
from scipy.spatial import KDTree

from benchmarks.reference.bone_worlds import oblong_bed, round_bed
from rona_core.errors import InvalidInputError
from rona_core.planning.bed import Bed, Screw
from rona_core.planning.placement.evaluate import (
    MOST_GROWN_MM,
    least_reach_mm,
    lowest_of_blocks,
    offset_bed,
    solid_points,
)
from tests.scenes.bone_plates import exact_problem, plate

PROBLEM = exact_problem(plate())


def box(length, width, depth=3.0, cell=0.25):
    x, y = (cell * np.arange(-40, 41) for _ in range(2))
    inside = np.outer(np.abs(x) <= length / 2, np.abs(y) <= width / 2)
    return Bed(x, y, np.where(inside, depth, 0.0))


@pytest.mark.parametrize(
    ("bed", "turn"),
    [
        (round_bed(16.0, 4.0), 0.0),
        (box(12.0, 12.0), np.pi / 2),
        (oblong_bed(20.0, 12.0, 4.0), np.pi),
        (box(14.0, 8.0), np.pi),
    ],
)
def test_a_bed_looks_the_same_after_its_turn(bed, turn):
    assert solid_points(PROBLEM, bed).turn_rad == pytest.approx(turn)
    assert solid_points(PROBLEM, bed, (Screw(9.0, 0.0, 4.0, 2.0),)).turn_rad == 2.0 * np.pi


def test_a_bed_that_is_deeper_at_one_end_has_no_turn():
    bed = oblong_bed(20.0, 12.0, 4.0)
    deeper = np.where(bed.x_mm[:, None] > 3.0, 1.5, 1.0) * bed.depth_mm
    assert solid_points(PROBLEM, Bed(bed.x_mm, bed.y_mm, deeper)).turn_rad == 2.0 * np.pi


@pytest.mark.parametrize("lean", [(0.0, 0.0), (0.3, 0.0), (0.1, -0.25), (-0.2, 0.2)])
def test_no_cell_comes_closer_to_a_leaning_plane(lean):
    bed = oblong_bed(24.0, 16.0, 4.5)
    i, j = np.nonzero(bed.cut())
    every = -bed.depth_mm[i, j] - lean[0] * bed.x_mm[i] - lean[1] * bed.y_mm[j]
    floor = lowest_of_blocks(bed, 1.0)
    kept = floor[:, 2] - lean[0] * floor[:, 0] - lean[1] * floor[:, 1]
    assert len(floor) < len(i) / 10
    assert 0.0 <= kept.min() - every.min() < 0.03


def test_the_rim_goes_around_the_bed_in_even_steps():
    rim = solid_points(PROBLEM, round_bed(16.0, 4.0)).rim
    assert np.hypot(*rim.T) == pytest.approx(8.0, abs=0.25)
    turns = np.sort(np.arctan2(rim[:, 1], rim[:, 0]))
    assert np.diff(turns).max() < 2.5 * 2.0 * np.pi / len(rim)


def test_the_least_reach_is_half_of_the_shorter_side():
    assert least_reach_mm(oblong_bed(24.0, 16.0, 4.5)) == pytest.approx(8.0, abs=0.25)
    aside = Bed(*(np.arange(4.0, 9.0),) * 2, np.ones((5, 5)))
    assert least_reach_mm(aside) == 0.0


@pytest.mark.parametrize("distance", [0.0, 0.7, 1.0, 2.5, 6.0])
def test_a_bed_grown_by_a_distance_ends_that_far_away(distance):
    bed = oblong_bed(16.0, 10.0, 3.0)
    grown = offset_bed(bed, distance)
    i, j = np.nonzero(grown.cut())
    lower = np.column_stack((grown.x_mm[i], grown.y_mm[j], -grown.depth_mm[i, j]))
    p, q = np.nonzero(bed.cut())
    floor = np.column_stack((bed.x_mm[p], bed.y_mm[q], -bed.depth_mm[p, q]))
    away, nearest = KDTree(floor).query(lower)
    assert away.max() <= distance + 1e-9  # never too large
    flank = np.hypot(*(lower - floor[nearest])[:, :2].T) > np.sin(np.pi / 3) * distance
    exact = 1e-9 if distance <= MOST_GROWN_MM else 0.04  # a larger ball is a sum of small ones
    kept = away if distance <= MOST_GROWN_MM else away[~flank]
    assert kept == pytest.approx(np.full(len(kept), distance), abs=exact)
    assert np.ptp(lower[:, 0]) - np.ptp(floor[:, 0]) == pytest.approx(2.0 * distance, abs=0.4)


GRID = np.arange(5.0)
BAD = [
    (Bed(GRID, GRID, np.zeros((5, 5))), "takes nothing away"),
    (Bed(GRID, GRID, np.ones((5, 4))), "cells of the bed"),
    (Bed(GRID, 2.0 * GRID, np.ones((5, 5))), "evenly spaced"),
    (Bed(GRID**2, GRID, np.ones((5, 5))), "evenly spaced"),
    (Bed(GRID, GRID, np.full((5, 5), np.nan)), "finite"),
]


@pytest.mark.parametrize(("bed", "message"), BAD)
def test_what_is_no_bed_is_refused(bed, message):
    with pytest.raises(InvalidInputError, match=message):
        solid_points(PROBLEM, bed)
