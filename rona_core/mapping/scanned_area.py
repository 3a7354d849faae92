"""Scanned area: what A-scans must show of it before a map of the bone is made of them."""

import numpy as np

from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Bools, Floats

LEAST_SHARE = 0.5  # of A-scans, that show an outer boundary


def require_area(points: Floats, axes: Floats, face_mm: float) -> None:
    """Refuse points that lie in a strip which the face of the probe covers.

    What a face covers is heard as one, so that nothing tells how the bone runs across a strip.

    Args:
        points: Of the outer boundary (n, 3), in mm.
        axes: Of the probe (n, 3), into the bone, in the same frame.
        face_mm: Width of its face.

    Raises:
        DegenerateGeometryError: the points lie in such a strip.
    """
    inward = axes.mean(axis=0)
    inward = inward / np.linalg.norm(inward)
    flat = points - points.mean(axis=0)
    flat = flat - np.outer(flat @ inward, inward)
    across = np.linalg.svd(flat, full_matrices=False)[2][1]
    width_mm = float(np.ptp(flat @ across))
    if width_mm < face_mm:
        raise DegenerateGeometryError(
            f"the {len(points)} A-scans that show the outer boundary lie in a strip of "
            f"{width_mm:.1f} mm, a map takes an area wider than the face of the probe "
            f"({face_mm:.1f} mm): scan more rows"
        )


def require_share(used: Bools) -> None:
    """Refuse a map that most of its A-scans (n,) tell nothing of.

    Raises:
        DegenerateGeometryError: too few of them show an outer boundary that others agree with.
    """
    if np.mean(used) < LEAST_SHARE:
        raise DegenerateGeometryError(
            f"only {np.count_nonzero(used)} of {len(used)} A-scans show an outer boundary that "
            f"agrees with those around it, a map takes {100 * LEAST_SHARE:.0f} %: was the probe "
            "in contact, and is the bone smooth there, without a steep edge?"
        )
