"""Bone below a place: the shortest way, and the way along the axis of a bed, over planes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.reference.bone_worlds import round_bed
from rona_core.geometry.pose import Pose
from rona_core.planning.placement.evaluate import (
    bed_margins,
    depths_along_axis,
    residuals,
    solid_points,
)
from rona_core.planning.placement.problem import ExecutionError, MappedBone, PlacementProblem
from tests.scenes.bone_plates import U, V, exact_problem, maps_of, plate

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


@pytest.mark.parametrize("slope", [0.0, 0.1, 0.3, 0.6])
@pytest.mark.parametrize("limit_mm", [0.5, 1.0, 2.0])
def test_a_bed_keeps_its_limit_where_the_shortest_way_is_as_long(limit_mm, slope):
    """To a plane it is that from the edge of the floor, along the normal of the plane."""
    bed, length = round_bed(10.0, 3.0), np.hypot(1.0, slope)
    thick_mm = 3.0 + limit_mm * length + 5.0 * slope
    for off_mm, sign in ((-0.08, -1.0), (0.08, 1.0)):
        problem = exact_problem(
            plate(thick_mm + off_mm, (0.0, 0.0), (slope, 0.0), sigma_mm=0.0), limit_mm
        )
        found, _ = bed_margins(problem, Pose.identity(), solid_points(problem, bed))
        assert np.all(sign * found > 0.0)


@pytest.mark.parametrize(("away_mm", "kept"), [(1.6, False), (3.2, True)])
def test_a_crest_beside_a_bed_counts_as_far_as_the_limit_reaches(away_mm, kept):
    """Of the inner boundary, up to the floor, and in the draws alone."""
    flat = np.zeros(U.shape)
    crest = 3.0 * ((np.abs(U - 5.0 - away_mm) < 0.7) & (np.abs(V) < 4.0))
    draws = np.repeat((flat - 6.0 + crest)[None], 60, axis=0)
    bone = MappedBone(maps_of(flat, flat - 6.0), np.zeros_like(draws), draws)
    problem = exact_problem(bone, 2.0)
    solid = solid_points(problem, round_bed(10.0, 3.0))
    least, _ = bed_margins(problem, Pose.identity(), solid)
    assert np.all((least > 0.0) == kept)
    below, _ = residuals(problem, Pose.identity(), solid.floor)
    assert below.min() > 2.0
