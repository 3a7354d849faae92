"""What A-scans must show of an area before a map is made of them."""

import numpy as np
import pytest

from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.pose import Pose
from rona_core.mapping.build_maps import LEAST_SHARE, require_area, require_share


def on_a_dome(u, v):
    """Return points on a dome, and axes into it, all of it leant."""
    points = np.column_stack((u, v, -(u**2 + v**2) / 160.0))
    turn = Pose.from_rotvec((0.4, -0.9, 0.2))
    return turn @ points, turn.rotate(np.tile((0.0, 0.0, -1.0), (len(points), 1)))


def rows(number: int, spacing_mm: float = 2.5):
    u, v = np.meshgrid(np.linspace(-20.0, 20.0, 41), spacing_mm * np.arange(number))
    return u.ravel(), v.ravel()


@pytest.mark.parametrize(("number", "width_mm"), [(1, 0.0), (2, 4.3), (3, 7.1)])
def test_a_row_or_two_are_no_area_though_an_arc_lies_in_a_plane_of_its_own(number, width_mm):
    with pytest.raises(DegenerateGeometryError, match=rf"strip of {width_mm:.1f} mm.*more rows"):
        require_area(*on_a_dome(*rows(number)))


def test_a_row_and_one_a_scan_aside_are_none_either():
    u, v = rows(1)
    with pytest.raises(DegenerateGeometryError, match="strip of"):
        require_area(*on_a_dome(np.append(u, 0.0), np.append(v, 12.0)))


def test_four_rows_and_the_smallest_region_are_areas():
    require_area(*on_a_dome(*rows(4)))
    grid = np.mgrid[-5.0:5.1, -5.0:5.1].reshape(2, -1)
    require_area(*on_a_dome(*grid[:, np.hypot(*grid) <= 5.0]))


def test_enough_of_the_a_scans_must_show_the_outer_boundary():
    used = np.arange(100) < round(100 * LEAST_SHARE)
    require_share(used)
    used[0] = False
    with pytest.raises(DegenerateGeometryError, match=r"only 44 of 100 A-scans.*45 %.*steep edge"):
        require_share(used)
