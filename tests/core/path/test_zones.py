import numpy as np
import pytest

from rona_core.errors import InvalidInputError
from rona_core.path.zones import Zone

SQUARE = np.array([(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0)])


def test_a_point_a_line_and_an_area_are_as_far_as_they_are():
    places = [(2.0, 2.0), (7.0, 8.0), (2.0, -3.0)]
    point = Zone("foramen", SQUARE[:1], closed=False, distance_mm=1.0)
    assert point.distances_mm(places) == pytest.approx([np.hypot(2, 2), np.hypot(7, 8), 13**0.5])
    line = Zone("suture", SQUARE, closed=False, distance_mm=1.0)
    assert line.distances_mm(places) == pytest.approx([2.0, 5.0, 3.0])
    area = Zone("sinus", SQUARE, closed=True, distance_mm=1.0)
    assert area.distances_mm(places) == pytest.approx([0.0, 5.0, 3.0])
    assert area.distances_mm([(0.0, 2.0), (-1.0, 2.0)]) == pytest.approx([0.0, 1.0])


def test_an_area_with_a_bay_does_not_hold_it():
    corners = np.array([(0.0, 0.0), (6.0, 0.0), (6.0, 6.0), (3.0, 1.0), (0.0, 6.0)])
    area = Zone("sinus", corners, closed=True, distance_mm=0.0)
    found = area.distances_mm([(3.0, 3.0), (0.5, 3.0), (3.0, 0.5)])
    assert found[0] > 0.5
    assert found[1:] == pytest.approx([0.0, 0.0])


@pytest.mark.parametrize(
    ("corners", "closed", "distance", "message"),
    [
        (np.zeros((0, 2)), False, 1.0, "needs corners"),
        (np.zeros((3, 4)), False, 1.0, "needs corners"),
        (np.zeros((3, 3)), True, 1.0, "needs corners"),
        (SQUARE[:2], True, 1.0, "at least 3"),
        (SQUARE, True, -1.0, "distance_mm must be"),
        (SQUARE * np.nan, True, 1.0, "finite"),
    ],
)
def test_what_is_no_zone_is_refused(corners, closed, distance, message):
    with pytest.raises(InvalidInputError, match=message):
        Zone("zone", corners, closed, distance)
