"""Scanned area: what A-scans must show of it before a map of the bone is made of them."""

import numpy as np

from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Bools, Floats

LEAST_SHARE = 0.45  # of A-scans, that show an outer boundary
LEAST_WIDTH_MM = 7.5  # of an even strip that reaches as far across
STRIP_OVER_RMS = 12.0**0.5  # width of an even strip over the RMS distance from its middle


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


def require_area(points: Floats, axes: Floats) -> None:
    """Refuse points that lie in a strip of a row or two.

    A row over a dome lies in a plane of its own, and echoes of neighbouring rows are those of much
    the same bone: its course across the gap is not measured.

    Args:
        points: Of the outer boundary (n, 3), in mm, n >= 3.
        axes: Of the probe (n, 3), into the bone, in the same frame.

    Raises:
        DegenerateGeometryError: the points lie in such a strip.
    """
    inward = axes.mean(axis=0)
    inward = inward / np.linalg.norm(inward)
    flat = points - points.mean(axis=0)
    flat = flat - np.outer(flat @ inward, inward)
    spread_mm = np.linalg.svd(flat, compute_uv=False)[1] / np.sqrt(len(points))
    width_mm = float(STRIP_OVER_RMS * spread_mm)
    if width_mm < LEAST_WIDTH_MM:
        raise DegenerateGeometryError(
            f"the {len(points)} A-scans that show the outer boundary lie in a strip of "
            f"{width_mm:.1f} mm, a map takes {LEAST_WIDTH_MM:.1f} mm: scan more rows, or a wider "
            "region"
        )
