"""Coarse map of the outer boundary through the points so far: for views that follow a scan."""

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_core.mapping.boundary_map import BoundaryMap
from rona_core.mapping.build_maps import LEAST_SAMPLES
from rona_core.mapping.fitting.hampel_filter import agreeing
from rona_core.mapping.fitting.plate_field import fit_field
from rona_core.mapping.map_grid import MapGrid

STIFFNESS = 1.0  # maps of skulls choose 0.04 to 0.2; a little stiffer, they change by 0.01 mm
MOST_SAMPLES = 1500  # more are thinned out evenly, along the rows
LEAST_WIDTH_MM = 0.5  # standard deviation of places across; narrower is a line
CELL_MM = 1.0


def coarse_map(T_base_map: Pose, points_base: Floats) -> BoundaryMap | None:
    """Return the boundary through points (n, 3); None while they are few, or lie on a line.

    The stiffness of the plate is not chosen, and points are not corrected for curved bone: step 9
    does both. It takes some 50 ms.
    """
    points = (T_base_map.inv() @ points_base)[:: 1 + len(points_base) // MOST_SAMPLES]
    if len(points) < LEAST_SAMPLES or _width_mm(points) < LEAST_WIDTH_MM:
        return None
    points = points[agreeing(points[:, :2], points[:, 2])]
    if len(points) < LEAST_SAMPLES or _width_mm(points) < LEAST_WIDTH_MM:
        return None
    plate = fit_field(points[:, :2], points[:, 2], stiffness=STIFFNESS)
    grid = MapGrid(T_base_map, points, CELL_MM)
    return grid.boundary(plate, grid.near(points))


def _width_mm(points_map: Floats) -> float:
    """Return the standard deviation of places across the direction that they spread along."""
    spread = np.linalg.svd(points_map[:, :2] - points_map[:, :2].mean(axis=0), compute_uv=False)
    return float(spread[1] / np.sqrt(len(points_map)))
