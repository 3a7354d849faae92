"""Plane curves that a hand follows: a meander over a disc, a curve through picked places."""

import numpy as np
from scipy.interpolate import PchipInterpolator

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats

MIN_SPACING_MM = 0.2
SAMPLE_MM = 0.1  # between the points that a curve is given by


def meander(radius_mm: float, spacing_mm: float) -> Floats:
    """Return a meander over a disc about the origin as a dense polyline (n, 2).

    Straight lines along x, ``spacing_mm`` apart, joined by half circles; every point lies in the
    disc. Neighbouring lines end where the half circle between them touches the rim.

    Raises:
        InvalidInputError: the spacing is below 0.2 mm, or fewer than two lines fit.
    """
    if not MIN_SPACING_MM <= spacing_mm <= radius_mm:
        raise InvalidInputError(
            f"spacing_mm must be {MIN_SPACING_MM:g} to {radius_mm:.1f}, not {spacing_mm}"
        )
    n = int(np.floor((2.0 * radius_mm - spacing_mm) / spacing_mm)) + 1
    turn_mm = spacing_mm / 2.0
    y = (np.arange(n) - (n - 1) / 2.0) * spacing_mm
    middles = (y[1:] + y[:-1]) / 2.0
    turns = np.sqrt((radius_mm - turn_mm) ** 2 - middles**2)  # half length where a turn begins
    start, end = -np.sqrt(radius_mm**2 - y[0] ** 2), np.sqrt(radius_mm**2 - y[-1] ** 2)
    pieces: list[Floats] = []
    x = start
    side = 1.0  # the line runs towards +x or -x
    for i in range(n):
        stop = side * (turns[i] if i < n - 1 else end)
        count = max(int(np.ceil(abs(stop - x) / SAMPLE_MM)), 1)
        line_x = np.linspace(x, stop, count, endpoint=i == n - 1)
        pieces.append(np.column_stack((line_x, np.full(len(line_x), y[i]))))
        if i < n - 1:
            count = max(int(np.ceil(np.pi * turn_mm / SAMPLE_MM)), 8)
            angle = np.linspace(-np.pi / 2.0, np.pi / 2.0, count, endpoint=False)
            arc_x = stop + side * turn_mm * np.cos(angle)
            pieces.append(np.column_stack((arc_x, middles[i] + turn_mm * np.sin(angle))))
        x, side = stop, -side
    return np.concatenate(pieces)


def through(points: Floats) -> Floats:
    """Return a smooth curve (m, d) through points (n, d) in their order, without overshoot.

    Repeated points are passed once; a single point gives a curve that stays there.
    """
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    kept = points[np.concatenate(([True], steps > 1e-9))]
    if len(kept) == 1:
        return np.repeat(kept, 2, axis=0)
    along = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(kept, axis=0), axis=1))))
    count = max(int(np.ceil(along[-1] / SAMPLE_MM)), 2)
    where = np.union1d(np.linspace(0.0, along[-1], count), along)  # every point itself is passed
    if len(kept) == 2:
        return kept[0] + (where / along[-1])[:, None] * (kept[1] - kept[0])
    return PchipInterpolator(along, kept)(where)


def along_curve(curve: Floats, shares: Floats) -> Floats:
    """Return positions (n, d) at shares (n,) in 0..1 of the length of a polyline (m, d)."""
    steps = np.linalg.norm(np.diff(curve, axis=0), axis=1)
    along = np.concatenate(([0.0], np.cumsum(steps)))
    if along[-1] <= 0.0:
        return np.repeat(curve[:1], len(shares), axis=0)
    keep = np.concatenate(([True], steps > 0.0))
    return np.column_stack(
        [np.interp(shares * along[-1], along[keep], column[keep]) for column in curve.T]
    )
