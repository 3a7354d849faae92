"""Bone left below a bed and below its screws, in the map and in all draws."""

from collections.abc import Sequence

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_core.planning.bed import Screw
from rona_core.planning.placement.chance import chance_above
from rona_core.planning.placement.figures import ScrewFigures
from rona_core.planning.placement.mapped_bone import MappedBone
from rona_core.planning.placement.problem import PlacementProblem
from rona_core.planning.placement.solid_points import SolidPoints

TURNS_RAD = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
AROUND = np.column_stack((np.cos(TURNS_RAD), np.sin(TURNS_RAD)))  # the end of a screw, in radii
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
    drawn, mapped, _ = _to_inner(problem, T_map_bed, points_map)
    return drawn, mapped


def depths_along_axis(
    problem: PlacementProblem, T_map_bed: Pose, points_map: Floats
) -> tuple[Floats, Floats]:
    """Return the distance from points (m, 3) along the axis of a bed to the inner boundary.

    What a probe measures that stands on a floor: over a boundary that leans it is more than the
    shortest way, see ``residuals``.

    Returns:
        In the draws (m, n), in the map (m,).
    """
    drawn, mapped, normals_bed = _to_inner(problem, T_map_bed, points_map)
    drawn /= normals_bed[:, 2:]
    return drawn, mapped / normals_bed[:, 2]


def _to_inner(
    problem: PlacementProblem, T_map_bed: Pose, points_map: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return ``residuals``, and the outward normals (m, 3) of the inner map in ``bed``."""
    inner = problem.bone.inner_boundary
    operator = inner.grid.operator(points_map[:, :2])
    cosine = operator @ inner.cosine
    slopes = operator @ inner.slopes
    mapped = cosine * (points_map[:, 2] - operator @ inner.height_mm)
    normals_map = cosine[:, None] * np.column_stack((-slopes, np.ones(len(slopes))))
    normals_bed = normals_map @ T_map_bed.rotation
    operator.data *= np.repeat(-cosine, np.diff(operator.indptr))
    drawn = operator @ inner.draws_mm
    same = np.column_stack((cosine * points_map[:, 2], normals_bed))
    errors = np.vstack((np.ones(problem.bone.draws), problem.errors_bed))
    for start in range(0, len(drawn), AT_ONCE):
        drawn[start : start + AT_ONCE] += same[start : start + AT_ONCE] @ errors
    return drawn, mapped, normals_bed


def bed_margins(
    problem: PlacementProblem, T_map_bed: Pose, solid: SolidPoints
) -> tuple[Floats, Floats]:
    """Return the least bone below a bed over what is required, and what the map leaves below it.

    Less than 0 where the bone below the floor is too thin, or where the boundary of that draw
    reaches into the bed grown by the limit: its nearest place need not be the one below. Where the
    maps end the bone beside a bed is not looked at.

    Returns:
        Over what is required, in the draws (n,); below the places of the floor in the map (m,).
    """
    below, mapped = residuals(problem, T_map_bed, T_map_bed @ solid.floor)
    offset_map = T_map_bed @ solid.offset
    covered = problem.bone.covered(offset_map[:, :2])
    around, _ = residuals(problem, T_map_bed, offset_map[covered])
    least = below.min(axis=0) - problem.limits.residual_mm
    return np.minimum(least, around.min(axis=0, initial=np.inf)), mapped


def margins(problem: PlacementProblem, T_map_bed: Pose, solid: SolidPoints) -> Floats:
    """Return the least bone over what is required, below a bed or beyond a screw, in draws (n,)."""
    least, _ = bed_margins(problem, T_map_bed, solid)
    if not solid.screws:
        return least
    places_map = screw_places(problem.bone, T_map_bed, solid.screws)
    return np.minimum(least, beyond_screws(problem, T_map_bed, places_map)[0].min(axis=0))


def screw_places(bone: MappedBone, T_map_bed: Pose, screws: Sequence[Screw]) -> Floats:
    """Return where s screws go in, then places around the end of each (s, 1 + 9, 3), in ``map``.

    A screw goes in where its axis meets the outer map.
    """
    heads = np.array([(screw.x_mm, screw.y_mm, 0.0) for screw in screws]).reshape(-1, 3)
    axis_map = T_map_bed.rotation[:, 2]
    start = T_map_bed @ heads
    for _ in range(ROUNDS):
        start += ((bone.outer_at(start[:, :2]) - start[:, 2]) / axis_map[2])[:, None] * axis_map
    length = np.array([screw.length_mm for screw in screws])
    radius = np.array([0.5 * screw.diameter_mm for screw in screws])
    ends = np.zeros((len(screws), 1 + len(AROUND), 3))
    ends[:, 1:, :2] = radius[:, None, None] * AROUND
    ends[:, :, 2] -= length[:, None]
    return np.concatenate((start[:, None], start[:, None] + T_map_bed.rotate(ends)), axis=1)


def judge_screws(
    problem: PlacementProblem, T_map_bed: Pose, screws: Sequence[Screw], places_map: Floats
) -> tuple[ScrewFigures, ...]:
    """Return the bone at s screws, whose entries and ends (s, 1 + 9, 3) are given."""
    if not screws:
        return ()
    drawn, mapped = beyond_screws(problem, T_map_bed, places_map)
    return tuple(
        ScrewFigures(screw, screw.length_mm + float(more), chance_above(beyond, 0.0))
        for screw, beyond, more in zip(screws, drawn, mapped, strict=True)
    )


def beyond_screws(
    problem: PlacementProblem, T_map_bed: Pose, places_map: Floats
) -> tuple[Floats, Floats]:
    """Return the bone beyond the ends of s screws, in draws (s, n) and in the map (s,).

    A screw rides on the true outer boundary, wherever that is: the depth of the bed does not
    matter.

    Args:
        problem: Bone and errors of execution.
        T_map_bed: Of the bed.
        places_map: Entries and ends (s, 1 + 9, 3), see ``screw_places``.
    """
    bone, (count, each, _) = problem.bone, places_map.shape
    entry = bone.grid.operator(places_map[:, 0, :2])
    outer_off = entry @ bone.outer_draws - (entry @ bone.outer.height_mm.ravel())[:, None]
    drawn, mapped = residuals(problem, T_map_bed, places_map[:, 1:].reshape(-1, 3))
    least = drawn.reshape(count, each - 1, -1).min(axis=1)
    depth_error = T_map_bed.rotation[2, 2] * problem.errors_bed[2]
    return least + outer_off - depth_error, mapped.reshape(count, -1).min(axis=1)
