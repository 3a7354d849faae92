"""Fusion of the pointer cloud with the outer map of the ultrasound.

The cloud as a whole is off by the errors of registration and pointer, which all its points share.
So it is first moved onto the map as one rigid body, held back where the map cannot tell (a dome
does not show a slide along itself), and then joined with the weight that its scatter deserves.
"""

import numpy as np
from scipy.interpolate import RectBivariateSpline
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Floats, readonly
from rona_core.geometry.pose import Pose
from rona_core.geometry.robust import TUKEY_CUTOFF, mad_sigma, tukey_weights
from rona_core.mapping.boundary_map import CloudFit
from rona_core.mapping.thin_plate_spline import PlateFit

LEAST_OVERLAP = 30  # points of the cloud over the map; fewer tell nothing
ROUNDS = 15
LEAST_SCALE_MM = 0.02
PRIOR_SHIFT_MM = 1.5  # how far off a cloud is expected to be
PRIOR_TURN_RAD = 0.02
CHART_CELL_MM = 1.0
CHART_MARGIN_MM = 4.0  # the cloud may move this far


def fit_cloud(cloud_map: Floats, plate: PlateFit, overlap_mm: float) -> CloudFit | None:
    """Register the cloud to the map: rigid motion, point to plane (Chen 1991), Tukey's weights.

    Args:
        cloud_map: Points of the cloud (n, 3) in ``map``.
        plate: The outer map as fitted to the ultrasound.
        overlap_mm: How close to an ultrasound sample a point must lie to count.

    Returns:
        The motion in ``map`` (to be turned to ``base`` by the caller), or
        None where too few points lie over the map.
    """
    tree = KDTree(plate.places_mm)
    inside = tree.query(cloud_map[:, :2])[0] <= overlap_mm
    if np.count_nonzero(inside) < LEAST_OVERLAP:
        return None
    points = cloud_map[inside]
    chart = _chart(plate, points[:, :2])
    center = points.mean(axis=0)
    so_far = Pose.identity()
    prior = np.diag((*[PRIOR_SHIFT_MM**-2] * 3, *[PRIOR_TURN_RAD**-2] * 3))
    total = np.zeros(6)  # motion so far, for the prior
    information = prior
    for _ in range(ROUNDS):
        moved = so_far @ points
        distance, normals = _to_plane(moved, chart)
        scale = mad_sigma(distance, floor=LEAST_SCALE_MM)
        weights = tukey_weights(distance, TUKEY_CUTOFF * scale) / scale**2
        rows = np.column_stack((normals, np.cross(moved - center, normals)))
        information = rows.T @ (weights[:, None] * rows)
        step = np.linalg.solve(information + prior, -rows.T @ (weights * distance) - prior @ total)
        total = total + step
        turn = Pose.from_rotvec(step[3:])
        about = Pose(turn.rotation, center - turn.rotation @ center + step[:3])
        so_far = about @ so_far
        if np.abs(step).max() < 1e-7:
            break
    distance, _ = _to_plane(so_far @ points, chart)
    scaled = information / np.outer(*[np.array((1.0,) * 3 + (20.0,) * 3)] * 2)
    return CloudFit(
        correction=so_far,
        rms_mm=float(np.sqrt(np.mean(distance**2))),
        n_used=len(points),
        eigenvalues=readonly(np.asarray(np.linalg.eigvalsh(scaled), dtype=np.float64)),
    )


def _chart(plate: PlateFit, places_mm: Floats) -> RectBivariateSpline:
    """Return the plate as a bicubic chart around the places (n, 2): heights and slopes at once."""
    low, high = places_mm.min(axis=0) - CHART_MARGIN_MM, places_mm.max(axis=0) + CHART_MARGIN_MM
    u, v = (np.arange(low[k], high[k] + CHART_CELL_MM, CHART_CELL_MM) for k in range(2))
    grid = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1)
    heights = plate.heights(grid.reshape(-1, 2)).reshape(grid.shape[:2])
    return RectBivariateSpline(u, v, heights)


def _to_plane(points: Floats, chart: RectBivariateSpline) -> tuple[Floats, Floats]:
    """Return signed distances (n,) to the map along its normals, and those normals (n, 3)."""
    u, v = points[:, 0], points[:, 1]
    east, north = chart.ev(u, v, dx=1), chart.ev(u, v, dy=1)
    slopes = np.column_stack((-east, -north, np.ones(len(points))))
    normals = slopes / np.linalg.norm(slopes, axis=1)[:, None]
    return (points[:, 2] - chart.ev(u, v)) * normals[:, 2], normals


def thinned(points_map: Floats, cell_mm: float) -> Floats:
    """Return one point (k, 3) for each cell that holds points (n, 3): their median."""
    if not len(points_map):
        return points_map
    cells = np.floor(points_map[:, :2] / cell_mm).astype(np.int64)
    _, group, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    first = np.cumsum(counts) - counts
    low, high = first + (counts - 1) // 2, first + counts // 2
    ranked = np.column_stack([column[np.lexsort((column, group))] for column in points_map.T])
    return 0.5 * (ranked[low] + ranked[high])
