"""What a further scan would hear around a bed, in draws of the maps."""

import numpy as np
from scipy.spatial import KDTree

from rona_core.geometry.arrays import readonly
from rona_core.geometry.pose import Pose
from rona_core.mapping.accuracy.map_draws import MapDraws
from rona_core.path.scan_patterns import Inside
from rona_core.planning.bed import Bed
from rona_core.planning.further_lines.best_lines import Hearing
from rona_core.planning.implants.implant import Implant
from rona_core.planning.placement.problem import PlacementProblem
from rona_core.planning.placement.residuals import margins
from rona_core.planning.placement.solid_points import solid_points

AROUND_MM = 2.0  # of bed and screws, where a line may go, too


def bed_hearing(
    draws: MapDraws,
    problem: PlacementProblem,
    implant: Implant,
    bed: Bed,
    T_base_bed: Pose,
    allowed: Inside | None,
    sigma_mm: float,
) -> Hearing:
    """Return what a further scan would hear around a bed.

    What counts is the least bone over the limit below the bed or beyond a screw.

    Args:
        draws: Of the maps.
        problem: The bone in those draws, and what is asked of the bed.
        implant: With its lift.
        bed: As it would be milled.
        T_base_bed: Where it lies.
        allowed: Whether places (n, 2) of the map may be scanned; None: all may.
        sigma_mm: Of a thickness by one A-scan.
    """
    maps, bone = draws.maps, problem.bone
    solid = solid_points(problem, bed, implant.screws)
    T_map_bed: Pose = maps.outer.T_base_map.inv() @ T_base_bed
    screws = np.array([(one.x_mm, one.y_mm, 0.0) for one in implant.screws]).reshape(-1, 3)
    beneath = np.vstack((T_map_bed @ solid.floor, T_map_bed @ screws))[:, :2]
    places = bone.places_mm()
    away = KDTree(beneath).query(places)[0]
    around = maps.outer.ok & (away <= AROUND_MM)
    if allowed is not None:
        around[around] = allowed(places[around])
    return Hearing(
        places_mm=readonly(places[around]),
        thickness_mm=readonly(draws.reread_mm[:, around].T),
        least_mm=readonly(margins(problem, T_map_bed, solid)),
        sigma_mm=sigma_mm,
    )
