"""What a scan path covers: its length, the distance between its lines, its share of a disc.

Use the simplified path: tremor makes raw samples many times too long.
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import KDTree

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Floats, as_points, as_vector3

RESAMPLE_MM = 1.0
N_CELLS = 8000  # of equal area, on a spiral: no rows that could line up with the path
GOLDEN_RAD = np.pi * (3.0 - np.sqrt(5.0))


def length_mm(points_base: ArrayLike) -> float:
    """Return the length of a path (n, 3); 0 for one point or none."""
    p = as_points(points_base, name="points_base")
    return float(np.linalg.norm(np.diff(p, axis=0), axis=1).sum())


def spacing_mm(points_base: ArrayLike, *, apart_mm: float = 12.0) -> float | None:
    """Return the median distance between neighbouring lines of a path, or None if it has one line.

    Args:
        points_base: Path (n, 3), n >= 2, in mm.
        apart_mm: Places of the path nearer than this along it are not neighbouring lines; must
            exceed twice the spacing. Lines farther apart than it are not found.

    Raises:
        InvalidInputError: wrong shape, or ``apart_mm`` not positive.
    """
    if not 0.0 < apart_mm < np.inf:
        raise InvalidInputError(f"apart_mm must be positive, not {apart_mm}")
    p, along = _resampled(as_points(points_base, at_least=2, name="points_base"))
    pairs = KDTree(p).query_pairs(apart_mm, output_type="ndarray")
    pairs = pairs[np.abs(along[pairs[:, 0]] - along[pairs[:, 1]]) > apart_mm]
    nearest = np.full(len(p), np.inf)
    distances = np.linalg.norm(p[pairs[:, 0]] - p[pairs[:, 1]], axis=1)
    for column in (0, 1):
        np.minimum.at(nearest, pairs[:, column], distances)
    found = nearest[np.isfinite(nearest)]
    return float(np.median(found)) if len(found) else None


def disc_coverage(
    points_base: ArrayLike,
    center_base: ArrayLike,
    normal_base: ArrayLike,
    radius_mm: float,
    width_mm: float,
) -> float:
    """Return the share of a disc that lies within half of ``width_mm`` of the path.

    Disc and path are seen along the normal of the disc, so this suits gently curved regions.

    Args:
        points_base: Path (n, 3) in ``base``, n >= 1.
        center_base: Centre of the disc (3,).
        normal_base: Its normal (3,), any length.
        radius_mm: Its radius.
        width_mm: Width of the stripe that the probe covers.

    Raises:
        InvalidInputError: wrong shapes, radius or width not positive.
        DegenerateGeometryError: the normal has no length.
    """
    if not (0.0 < radius_mm < np.inf and 0.0 < width_mm < np.inf):
        raise InvalidInputError(
            f"radius_mm and width_mm must be positive, not {radius_mm} and {width_mm}"
        )
    p = as_points(points_base, at_least=1, name="points_base")
    normal = as_vector3(normal_base, name="normal_base")
    if not np.linalg.norm(normal) > 0:
        raise DegenerateGeometryError("the normal of the disc has no length")
    across = np.linalg.svd(normal[None])[2][1:]  # two directions in the disc
    flat = (p - as_vector3(center_base, name="center_base")) @ across.T
    dense, _ = _resampled(np.column_stack((flat, np.zeros(len(flat)))), width_mm / 20.0)
    k = np.arange(N_CELLS)
    angle, reach = k * GOLDEN_RAD, radius_mm * np.sqrt((k + 0.5) / N_CELLS)
    cells = np.column_stack((reach * np.cos(angle), reach * np.sin(angle)))
    distances = KDTree(dense[:, :2]).query(cells)[0]
    return float((distances <= width_mm / 2.0).mean())


def _resampled(points: Floats, step_mm: float = RESAMPLE_MM) -> tuple[Floats, Floats]:
    """Return places (k, 3) along a path at most ``step_mm`` apart, and their arc length (k,)."""
    along = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))))
    count = int(np.ceil(along[-1] / step_mm)) + 1
    at = np.linspace(0.0, along[-1], count)
    return np.column_stack([np.interp(at, along, column) for column in points.T]), at
