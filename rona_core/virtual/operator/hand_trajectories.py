"""Hand trajectories: plane curves that a hand follows, and their projection onto the bone."""

import numpy as np
from scipy.interpolate import PchipInterpolator

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.virtual.pointer_motion import cross
from rona_core.virtual.scene import VirtualScene

MIN_SPACING_MM = 0.2
SAMPLE_MM = 0.1  # between the points that a curve is given by
STAND_OFF_MM = 40.0  # from where a place is projected onto the bone
MAX_GAP = 0.05  # share of a stroke that may cross holes of the bone


def raster_curve(radius_mm: float, spacing_mm: float) -> Floats:
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


def interpolating_curve(points: Floats) -> Floats:
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


def points_along(curve: Floats, shares: Floats) -> Floats:
    """Return positions (n, d) at shares (n,) in 0..1 of the length of a polyline (m, d)."""
    steps = np.linalg.norm(np.diff(curve, axis=0), axis=1)
    along = np.concatenate(([0.0], np.cumsum(steps)))
    if along[-1] <= 0.0:
        return np.repeat(curve[:1], len(shares), axis=0)
    keep = np.concatenate(([True], steps > 0.0))
    return np.column_stack(
        [np.interp(shares * along[-1], along[keep], column[keep]) for column in curve.T]
    )


def project_onto_bone(
    scene: VirtualScene, times: Floats, points: Floats, outward: Floats
) -> Floats:
    """Return points (n, 3) of a stroke brought onto the bone along ``-outward`` (n, 3).

    Raises:
        InvalidInputError: more than a twentieth of them miss the bone.
    """
    T_base_skull = scene.T_base_skull
    T_skull_base = T_base_skull.inv()
    starts = points + STAND_OFF_MM * outward
    depths = scene.specimen.ray(T_skull_base @ starts, T_skull_base.rotate(-outward))
    met = np.isfinite(depths) & (np.abs(depths - STAND_OFF_MM) < STAND_OFF_MM)
    if np.count_nonzero(~met) > MAX_GAP * len(met):
        raise InvalidInputError(
            f"{np.mean(~met):.0%} of the stroke lies beyond the specimen or over holes of it: "
            "choose another region or other places"
        )
    depths = np.interp(times, times[met], depths[met])  # the tip passes over a small hole
    return starts - depths[:, None] * outward


def tangent_axes(z: Floats, towards: Floats) -> tuple[Floats, Floats, Floats]:
    """Return right-handed axes (..., 3) with this z, x as near to ``towards`` as that allows."""
    z = z / np.linalg.norm(z, axis=-1, keepdims=True)
    x = towards - (towards * z).sum(axis=-1, keepdims=True) * z
    x = x / np.linalg.norm(x, axis=-1, keepdims=True)
    return x, cross(z, x), z


def tilted(z: Floats, x: Floats, y: Floats, lean_rad: Floats) -> Floats:
    """Return z (n, 3) leaned by angles (n, 2) towards x and y, along great circles."""
    angle = np.linalg.norm(lean_rad, axis=1)[:, None]
    direction = lean_rad[:, :1] * x + lean_rad[:, 1:] * y
    return np.cos(angle) * z + np.sinc(angle / np.pi) * direction
