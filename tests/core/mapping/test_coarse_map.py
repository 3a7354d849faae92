"""Coarse map through the points so far: a known dome, outliers, and what has no map yet."""

import numpy as np
import pytest

from rona_core.geometry.pose import Pose
from rona_core.mapping.coarse_map import MOST_SAMPLES, coarse_map

FLAT = Pose.from_translation((0.0, 0.0, 0.0))
RADIUS_MM = 80.0


def dome(along_mm=1.0, side_mm=30.0):
    rows, along = np.arange(0.0, side_mm, 2.5), np.arange(0.0, side_mm, along_mm)
    u, v = np.meshgrid(rows, along, indexing="ij")  # as they are scanned, row by row
    u, v = u.ravel() - side_mm / 2.0, v.ravel() - side_mm / 2.0
    return np.column_stack((u, v, np.sqrt(RADIUS_MM**2 - u**2 - v**2) - RADIUS_MM))


def heights_of_dome(boundary):
    u, v = np.meshgrid(boundary.u_mm, boundary.v_mm, indexing="ij")
    return np.sqrt(RADIUS_MM**2 - u**2 - v**2) - RADIUS_MM


@pytest.mark.parametrize("along_mm", [1.0, 0.1])  # more samples than are used
def test_it_is_the_dome_that_was_scanned(along_mm):
    points = dome(along_mm)
    assert (len(points) > MOST_SAMPLES) == (along_mm < 1.0)
    T_base_map = Pose.from_rotvec((0.3, -0.8, 0.2), (400.0, -20.0, 90.0))
    found = coarse_map(T_base_map, T_base_map @ points)
    assert found is not None
    off_mm = (found.height_mm - heights_of_dome(found))[found.ok]
    assert np.abs(off_mm).max() < 0.03
    assert found.ok.mean() > 0.95


def test_an_echo_from_elsewhere_does_not_bend_it():
    points = dome()
    points[100, 2] += 3.0
    found = coarse_map(FLAT, points)
    assert found is not None
    assert np.abs(found.height_mm - heights_of_dome(found))[found.ok].max() < 0.03


def test_few_points_and_a_line_have_no_map_yet():
    points = dome()
    row = points[points[:, 0] == points[0, 0]]
    assert len(row) == 30
    assert coarse_map(FLAT, row) is None
    assert coarse_map(FLAT, points[:11]) is None
    assert coarse_map(FLAT, np.zeros((0, 3))) is None
