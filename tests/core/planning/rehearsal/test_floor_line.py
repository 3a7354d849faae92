"""The line of a probe over a milled floor: order, walls, ridges between places."""

import numpy as np
import pytest

from rona_core.planning.rehearsal.milled_floor import (
    EDGE_MM,
    OVER_MM,
    ROUGH_MM,
    STEP_MM,
    CommandedFloor,
    floor_line,
)

FACE_MM, TIP_MM = 3.175, 3.2  # of the probe, and of the delay line as it collides
WIDENING = (11.0 - TIP_MM) / 29.0  # of its radius per mm of height


def milled(depth_mm, *pits, half_mm=14.0):
    """Return a floor with round pits (x, y, radius) in flat bone."""
    floor = CommandedFloor(half_mm)
    x, y = floor.cells().T
    for pit_x, pit_y, radius in pits:
        inside = np.hypot(x - pit_x, y - pit_y) <= radius
        floor.top_mm[inside.reshape(floor.top_mm.shape)] = -depth_mm
    return floor


def least_gap_mm(floor, line):
    """Return how near the delay line comes to bone that is more than a ridge, in its height."""
    cells, tops = floor.cells(), floor.top_mm.ravel()
    gaps = []
    for start, end in zip(line.points_bed[:-1], line.points_bed[1:], strict=True):
        for share in np.linspace(0.0, 1.0, 30):
            face = start + share * (end - start)
            away = np.linalg.norm(cells - face[:2], axis=1)
            high = tops > face[2] + ROUGH_MM
            at_height = TIP_MM + WIDENING * np.maximum(tops - face[2], 0.0)
            gaps.append((away - at_height)[high].min(initial=np.inf))
    return min(gaps)


def test_rows_are_scanned_to_and_fro_and_the_probe_comes_from_above():
    line = floor_line(milled(1.0, (0.0, 0.0, 8.0)), FACE_MM, 0.0)
    places = line.places_bed
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert len(line.stops) > 20
    assert len(np.unique(places, axis=0)) == len(places)
    assert np.median(steps) == pytest.approx(STEP_MM)
    assert steps.max() < 3.0 * STEP_MM
    np.testing.assert_array_equal(line.stops, np.arange(1, len(line.points_bed) - 1))  # never up
    np.testing.assert_allclose(line.points_bed[[0, -1], 2], OVER_MM)
    np.testing.assert_allclose(line.points_bed[[0, -1], :2], places[[0, -1], :2])


@pytest.mark.parametrize("depth_mm", [0.5, 2.0, 4.0])
def test_the_delay_line_is_clear_of_the_wall(depth_mm):
    floor = milled(depth_mm, (0.0, 0.0, 8.0))
    line = floor_line(floor, FACE_MM, 0.0)
    assert least_gap_mm(floor, line) > 0.9 * EDGE_MM - ROUGH_MM * WIDENING
    most = np.linalg.norm(line.places_bed[:, :2], axis=1).max()
    room = 8.0 - TIP_MM - EDGE_MM - WIDENING * (depth_mm - ROUGH_MM)
    assert room - STEP_MM < most < room + 0.3


def test_a_wider_face_keeps_as_far_away():
    floor = milled(3.0, (0.0, 0.0, 9.0))
    narrow, wide = floor_line(floor, TIP_MM, 0.0), floor_line(floor, TIP_MM + 2.0, 0.0)
    most = [np.linalg.norm(line.places_bed[:, :2], axis=1).max() for line in (narrow, wide)]
    assert most[0] - most[1] == pytest.approx(2.0, abs=STEP_MM)


def test_between_two_pits_the_probe_goes_up_over_the_bone():
    floor = milled(2.0, (-6.0, 0.0, 5.0), (6.0, 0.0, 5.0))
    line = floor_line(floor, FACE_MM, 0.0)
    sides = np.sign(line.places_bed[:, 0])
    assert set(sides) == {-1.0, 1.0}
    over = np.setdiff1d(np.arange(len(line.points_bed)), line.stops)
    assert len(over) == 4
    np.testing.assert_allclose(line.points_bed[over, 2], OVER_MM)
    assert least_gap_mm(floor, line) > 0.0
    # planted fault: straight from pit to pit
    straight = type(line)(line.places_bed, np.arange(len(sides)))
    assert least_gap_mm(floor, straight) < 0.0


def test_where_no_face_can_stand_there_is_no_line():
    assert floor_line(milled(2.0, (0.0, 0.0, 3.4)), FACE_MM, 0.0) is None
    assert floor_line(milled(2.0, (0.0, 0.0, 8.0)), FACE_MM, -2.5) is None
    alone = floor_line(milled(2.0, (0.0, 0.0, 4.5)), FACE_MM, 0.0)
    assert len(alone.stops) == 1
    assert len(alone.points_bed) == 3
