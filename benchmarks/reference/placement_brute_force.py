"""Every placement of a bed on a grid judged with all draws: what a search is held against."""

import numpy as np

from rona_core.planning.bed import Bed
from rona_core.planning.placement.evaluate import bed_margins, solid_points
from rona_core.planning.placement.figures import normal_quantile, objective, spreads_above
from rona_core.planning.placement.problem import (
    Placement,
    PlacementProblem,
    SearchGrid,
    lay_seats,
    tilted,
)


def best_objective(problem: PlacementProblem, bed: Bed, grid: SearchGrid) -> tuple[float, int]:
    """Return the largest objective of a bed without screws, and how many placements were judged."""
    bone, limits = problem.bone, problem.limits
    solid = solid_points(problem, bed)
    places = bone.places_mm()[bone.ok]
    rim = np.column_stack((solid.rim, np.zeros(len(solid.rim))))
    best, judged = 0.0, 0
    for angle in grid.angles_rad(solid.turn_rad):
        seats = lay_seats(bone, solid.rim, places, np.full(len(places), angle))
        for k, (u, v) in enumerate(places.tolist()):
            for about_x, about_y in grid.tilt_pairs_rad().tolist():
                T_map_bed = tilted(seats, k, Placement(u, v, float(angle), about_x, about_y))
                touched = (T_map_bed @ np.concatenate((solid.floor, rim)))[:, :2]
                if not bone.covered(touched).all():
                    continue
                judged += 1
                least, mapped = bed_margins(problem, T_map_bed, solid)
                room = (bone.grid.operator(touched) @ bone.unmapped_mm.ravel()).min()
                room = min(room, problem.zone_clearance_mm(touched).min())
                if room < 0.0:
                    continue
                lift = solid.rim[:, 1] * about_x - solid.rim[:, 0] * about_y
                away = np.abs(seats.rim_mm[k] - lift).max()
                score = normal_quantile(spreads_above(least, 0.0))
                value = float(objective(limits, score, mapped.min(), away, room))
                best = max(best, value)
    return best, judged
