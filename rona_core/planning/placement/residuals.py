"""Bone left below a bed and below its screws, in the map and in all draws."""

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_core.planning.bed import Screw
from rona_core.planning.placement.chance import chance_above
from rona_core.planning.placement.figures import ScrewFigures
from rona_core.planning.placement.mapped_bone import MappedBone
from rona_core.planning.placement.problem import PlacementProblem
from rona_core.planning.placement.solid_points import SolidPoints

TIP_TURNS = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)  # around the end of a screw
AT_ONCE = 512  # points that are worked on together: thousands with all draws take much memory
ROUNDS = 4  # of finding the outer boundary along a screw: the map is flat, each gains a digit


def residuals(
    problem: PlacementProblem, T_map_bed: Pose, points_map: Floats
) -> tuple[Floats, Floats]:
    """Return the shortest way from points (m, 3) to the inner boundary, in draws and in the map.

    Vertical distance times the cosine of the boundary's slope; a bed that is milled elsewhere than
    planned is closer by its shift along the boundary's normal.

    Returns:
        In the draws (m, n), in the map (m,).
    """
    bone = problem.bone
    operator = bone.operator(points_map[:, :2])
    cosine = operator @ bone.cosine.ravel()
    slopes = operator @ bone.inner_slopes.reshape(-1, 2)
    mapped = cosine * (points_map[:, 2] - operator @ bone.inner.height_mm.ravel())
    normals_map = cosine[:, None] * np.column_stack((-slopes, np.ones(len(slopes))))
    drawn = operator @ bone.inner_draws
    np.subtract(points_map[:, 2, None], drawn, out=drawn)
    drawn *= cosine[:, None]
    normals_bed = normals_map @ T_map_bed.rotation
    for start in range(0, len(drawn), AT_ONCE):
        drawn[start : start + AT_ONCE] += normals_bed[start : start + AT_ONCE] @ problem.errors_bed
    return drawn, mapped


def margins(problem: PlacementProblem, T_map_bed: Pose, solid: SolidPoints) -> Floats:
    """Return the least bone over what is required, below a bed or beyond a screw, in draws (n,)."""
    drawn, _ = residuals(problem, T_map_bed, T_map_bed @ solid.floor)
    least = drawn.min(axis=0) - problem.limits.residual_mm
    for screw in solid.screws:
        end = screw_end(problem.bone, T_map_bed, screw)
        least = np.minimum(least, beyond_screw(problem, T_map_bed, end)[0])
    return least


def screw_end(bone: MappedBone, T_map_bed: Pose, screw: Screw) -> Floats:
    """Return where a screw goes in, then places around its end (1 + 9, 3), in ``map``.

    It goes in where its axis meets the outer map.
    """
    axis_map = T_map_bed.rotation[:, 2]
    start = T_map_bed @ np.array((screw.x_mm, screw.y_mm, 0.0))
    for _ in range(ROUNDS):
        surface = float((bone.operator(start[None, :2]) @ bone.outer.height_mm.ravel())[0])
        start = start + (surface - start[2]) / axis_map[2] * axis_map
    radius = 0.5 * screw.diameter_mm
    ring = np.column_stack(
        (radius * np.cos(TIP_TURNS), radius * np.sin(TIP_TURNS), np.zeros(len(TIP_TURNS)))
    )
    end = np.vstack((np.zeros(3), ring)) - (0.0, 0.0, screw.length_mm)
    return np.vstack((start, start + T_map_bed.rotate(end)))


def judge_screw(
    problem: PlacementProblem, T_map_bed: Pose, screw: Screw, places_map: Floats
) -> ScrewFigures:
    """Return the bone at a screw, whose entry and end (1 + 9, 3) are given.

    It rides on the true outer boundary, wherever that is: the depth of the bed does not matter.
    """
    beyond, mapped_mm = beyond_screw(problem, T_map_bed, places_map)
    return ScrewFigures(screw, screw.length_mm + mapped_mm, chance_above(beyond, 0.0))


def beyond_screw(
    problem: PlacementProblem, T_map_bed: Pose, places_map: Floats
) -> tuple[Floats, float]:
    """Return the bone beyond the end of a screw in draws (n,) and in the map, see `judge_screw`."""
    bone = problem.bone
    entry = bone.operator(places_map[:1, :2])
    outer_off = (entry @ bone.outer_draws - entry @ bone.outer.height_mm.ravel())[0]
    drawn, mapped = residuals(problem, T_map_bed, places_map[1:])
    depth_error = T_map_bed.rotation[2, 2] * problem.errors_bed[2]
    return drawn.min(axis=0) + outer_off - depth_error, float(mapped.min())
