"""What A-scans must show of an area before a map is made of them."""

import numpy as np
import pytest

from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.pose import Pose
from rona_core.mapping.scanned_area import require_area, require_share

FACE_MM = 6.0


def rows(width_mm: float):
    """Points of three rows on a dome, far longer than they are wide, and axes into it, leant."""
    u, v = np.meshgrid(np.linspace(-20.0, 20.0, 41), np.linspace(0.0, width_mm, 3))
    points = np.column_stack((u.ravel(), v.ravel(), -(u.ravel() ** 2) / 160.0))
    turn = Pose.from_rotvec((0.4, -0.9, 0.2))
    return turn @ points, turn.rotate(np.tile((0.0, 0.0, -1.0), (len(points), 1)))


@pytest.mark.parametrize("width_mm", [0.0, 2.0, 5.9])
def test_rows_that_one_face_covers_are_no_area(width_mm):
    with pytest.raises(DegenerateGeometryError, match=rf"strip of {width_mm:.1f} mm.*more rows"):
        require_area(*rows(width_mm), FACE_MM)


def test_rows_further_apart_are_one_though_an_arc_lies_in_a_plane_of_its_own():
    require_area(*rows(6.1), FACE_MM)


def test_most_of_the_a_scans_must_show_the_outer_boundary():
    used = np.arange(46) < 23
    require_share(used)
    used[0] = False
    with pytest.raises(DegenerateGeometryError, match=r"only 22 of 46 A-scans.*50 %.*steep edge"):
        require_share(used)
