"""How much of a round region a scan along a path would cover."""

import itertools

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import KDTree

from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Floats, as_points
from rona_core.geometry.pose import Pose
from rona_core.geometry.rigid_fit import fit_plane

# Places this close to the path are mapped: 2.5 mm about its A-scans, less what smoothing takes off
REACH_MM = 2.0
STEP_MM = 1.0  # between places that are looked at, and along the path


def covered_share(path_base: ArrayLike, surface_base: ArrayLike, radius_mm: float) -> float:
    """Return which share of the region a scan along a path would cover, 0 to 1.

    The region is a disc in the plane of the measured surface, about the median of its points.

    Args:
        path_base: Places along the path (n, 3), n >= 1.
        surface_base: Points of the measured surface (m, 3), m >= 3.
        radius_mm: Of the region.

    Raises:
        DegenerateGeometryError: the surface is no patch.
    """
    path, surface = as_points(path_base, at_least=1), as_points(surface_base, at_least=3)
    if radius_mm <= 0.0:
        raise DegenerateGeometryError(f"the region has a radius of {radius_mm:g} mm")
    steps = _dense((surface_middle(surface).inv() @ path)[:, :2])
    ticks = np.arange(-radius_mm, radius_mm + STEP_MM / 2.0, STEP_MM)
    u, v = np.meshgrid(ticks, ticks, indexing="ij")
    places = np.column_stack((u.ravel(), v.ravel()))
    places = places[np.hypot(*places.T) <= radius_mm]
    near = np.asarray(KDTree(steps).query(places, distance_upper_bound=REACH_MM)[0]) <= REACH_MM
    return float(near.mean())


def surface_middle(surface_base: ArrayLike) -> Pose:
    """Return the middle of a measured surface as a pose in base: z along the normal of its plane.

    Its origin is the median of the points (m, 3), m >= 3; which way z points is not said.

    Raises:
        DegenerateGeometryError: the surface is no patch.
    """
    surface = as_points(surface_base, at_least=3)
    normal = fit_plane(surface).normal
    x = np.linalg.svd(np.eye(3) - np.outer(normal, normal))[0][:, 0]
    return Pose(np.column_stack((x, np.cross(normal, x), normal)), np.median(surface, axis=0))


def _dense(path: Floats) -> Floats:
    """Return places (k, 2) along a path (n, 2), a step apart at most."""
    parts = [path[:1]]
    for start, end in itertools.pairwise(path):
        count = max(int(np.ceil(np.linalg.norm(end - start) / STEP_MM)), 1)
        shares = (np.arange(count) + 1.0)[:, None] / count
        parts.append(start + shares * (end - start))
    return np.concatenate(parts)
