"""Bone below a place: the shortest way, and the way along the axis of a bed, over planes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rona_core.geometry.pose import Pose
from rona_core.planning.placement.problem import PlacementProblem
from rona_core.planning.placement.residuals import depths_along_axis, residuals
from rona_core.planning.placement.settings import ExecutionError
from tests.scenes.bone_plates import plate

PLACES = np.array(((0.0, 0.0, -3.0), (2.0, -1.0, -3.0), (-3.0, 2.0, -2.0)))
THICK_MM = 6.0


@pytest.mark.parametrize("lean_deg", [0.0, 8.0])
@pytest.mark.parametrize("slope", [0.0, 0.25])
def test_both_ways_to_a_plane(slope, lean_deg):
    bone = plate(THICK_MM, (0.0, 0.0), (slope, 0.0))
    problem = PlacementProblem(bone, ExecutionError(0.0, 0.0))
    T_map_bed = Pose(Rotation.from_euler("y", lean_deg, degrees=True).as_matrix(), np.zeros(3))
    above = PLACES[:, 2] + THICK_MM - slope * PLACES[:, 0]
    normal = np.array((-slope, 0.0, 1.0)) / np.hypot(1.0, slope)
    shortest = above * normal[2]
    drawn, mapped = residuals(problem, T_map_bed, PLACES)
    assert mapped == pytest.approx(shortest)
    along_drawn, along = depths_along_axis(problem, T_map_bed, PLACES)
    met = PLACES - along[:, None] * T_map_bed.rotation[:, 2]  # lies in the plane
    assert met @ normal == pytest.approx(np.full(3, -THICK_MM * normal[2]))
    assert along_drawn / along[:, None] == pytest.approx(drawn / mapped[:, None])
