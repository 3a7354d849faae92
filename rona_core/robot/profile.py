"""How fast to go along a joint path: constant speed where the joints allow, smooth at both ends.

The path is a spline over its own length. Two passes over a fine grid, forward and backward, give
the fastest speed profile within all limits (time-optimal path parameterisation after Bobrow 1985
and Verscheure 2009, with the path speed capped). See docs/algorithms/verification_and_timing.md.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from rona_core.arrays import Floats
from rona_core.errors import InvalidInputError

CURVED_SHARE = 0.6  # of an acceleration limit may be spent on following the bend of the path
SAFETY = 0.9  # share of the acceleration limits that is planned with
GRID_PER_SEGMENT = 6  # grid points between two path points
END_MM, END_POINTS, FINEST_MM = 1.0, 40, 1e-9
MERGED = 1e-6  # path points closer together than this (mm) are one
ROUNDING_MM = 3.0  # the speed profile is averaged over this way, so that its slope has no steps


@dataclass(frozen=True, slots=True)
class SpeedLimits:
    """What holds along the path itself, besides the limits of the joints."""

    speed_mm_per_s: float
    acceleration_mm_per_s2: float
    jerk_mm_per_s3: float


@dataclass(frozen=True, slots=True, eq=False)
class TimedPath:
    """A way (n,) in mm over time (n,), and the joint spline over that way."""

    times_s: Floats
    way_mm: Floats
    speed_mm_per_s: Floats
    joints: CubicSpline

    @property
    def duration_s(self) -> float:
        """Time needed from rest to rest."""
        return float(self.times_s[-1])

    def way_at(self, times_s: Floats) -> Floats:
        """Return the way (m,) at times (m,): acceleration is constant between grid points."""
        i = np.clip(
            np.searchsorted(self.times_s, times_s, side="right") - 1, 0, len(self.way_mm) - 2
        )
        h = self.times_s[i + 1] - self.times_s[i]
        u = np.clip(times_s - self.times_s[i], 0.0, h)
        v0, v1 = self.speed_mm_per_s[i], self.speed_mm_per_s[i + 1]
        way = self.way_mm[i] + v0 * u + (v1 - v0) * u**2 / (2.0 * h)
        return np.clip(way, 0.0, self.way_mm[-1])


def time_along(
    way_mm: Floats,
    qs_rad: Floats,
    points_base: Floats,
    limits: SpeedLimits,
    speed_rad_per_s: Floats,
    acceleration_rad_per_s2: Floats,
) -> TimedPath:
    """Return the fastest timing of a joint path within all limits, from rest to rest.

    Args:
        way_mm: Way along the path (n,), not decreasing, from 0; repeated values are one point.
        qs_rad: Joint angles (n, 6), continuous.
        points_base: Positions of the tool (n, 3) that the path acceleration is meant for.
        limits: Speed, acceleration and jerk along the path.
        speed_rad_per_s: Joint speed limits (6,).
        acceleration_rad_per_s2: Joint acceleration limits (6,).

    Raises:
        InvalidInputError: the path has no length.
    """
    keep = np.concatenate(([True], np.diff(way_mm) > MERGED))
    keep[-1] = True
    if np.count_nonzero(keep) > 2 and way_mm[-1] - way_mm[keep][-2] <= MERGED:
        keep[np.flatnonzero(keep)[-2]] = False
    way, qs, points = way_mm[keep], qs_rad[keep], points_base[keep]
    if len(way) < 2 or way[-1] - way[0] <= MERGED:
        raise InvalidInputError("a path without length cannot be timed; it needs two places")
    joints, places = (CubicSpline(way, v, bc_type="natural") for v in (qs, points))
    grid = _grid(way)
    dq, ddq = np.abs(joints(grid, 1)), np.abs(joints(grid, 2))
    bend = np.linalg.norm(places(grid, 2), axis=1)
    ceiling = _ceiling(dq, ddq, bend, limits, speed_rad_per_s, acceleration_rad_per_s2)
    ceiling = np.minimum(_rounded(ceiling, grid), _from_rest(grid, limits))
    squared = _two_passes(grid, ceiling, dq, ddq, bend, limits, acceleration_rad_per_s2)
    speed = np.sqrt(squared)
    mean = (speed[1:] + speed[:-1]) / 2.0
    times = np.concatenate(([0.0], np.cumsum(np.diff(grid) / mean)))
    return TimedPath(times, grid, speed, joints)


def _grid(way: Floats) -> Floats:
    """Return the way at which limits are looked at (g,).

    Every segment is divided evenly, the ends more finely: a start from rest with constant jerk
    goes with the third power of time.
    """
    parts = np.arange(GRID_PER_SEGMENT) / GRID_PER_SEGMENT
    inner = (way[:-1, None] + np.diff(way)[:, None] * parts).ravel()
    end = min(END_MM, way[-1] - way[0]) * (np.arange(END_POINTS + 1) / END_POINTS) ** 3
    grid = np.unique(np.concatenate((inner, way[-1:], way[0] + end, way[-1] - end)))
    return grid[np.concatenate(([True], np.diff(grid) > FINEST_MM))]


def _ceiling(
    dq: Floats,
    ddq: Floats,
    bend: Floats,
    limits: SpeedLimits,
    speed_rad_per_s: Floats,
    acceleration_rad_per_s2: Floats,
) -> Floats:
    """Return the largest squared speed (g,) that path, joint speeds and bends allow."""
    tiny = 1e-12
    by_speed = ((SAFETY * speed_rad_per_s / np.maximum(dq, tiny)) ** 2).min(axis=1)
    curved = CURVED_SHARE * SAFETY
    by_bend = (curved * acceleration_rad_per_s2 / np.maximum(ddq, tiny)).min(axis=1)
    by_path = curved * limits.acceleration_mm_per_s2 / np.maximum(bend, tiny)
    cap = np.full(len(bend), limits.speed_mm_per_s**2)
    return np.minimum.reduce((cap, by_speed, by_bend, by_path))


def _rounded(ceiling: Floats, grid: Floats) -> Floats:
    """Return a ceiling without corners that nowhere exceeds the given one.

    First the smallest value within a window, then the mean over the same window.
    """
    fine = np.linspace(grid[0], grid[-1], max(2, int(np.ceil((grid[-1] - grid[0]) / 0.1)) + 1))
    half = max(1, round(ROUNDING_MM / 2.0 / (fine[1] - fine[0])))
    padded = np.pad(np.interp(fine, grid, ceiling), 2 * half, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1)
    eroded = windows.min(axis=1)
    mean = np.lib.stride_tricks.sliding_window_view(eroded, 2 * half + 1).mean(axis=1)
    return np.minimum(np.interp(grid, fine, mean), ceiling)


def _from_rest(grid: Floats, limits: SpeedLimits) -> Floats:
    """Return the squared speed (g,) of a jerk-limited start from rest and stop at the end."""
    v, a, j = limits.speed_mm_per_s, limits.acceleration_mm_per_s2, limits.jerk_mm_per_s3
    a = min(SAFETY * a, np.sqrt(v * j))  # the speed may be reached before the acceleration is
    ramp_s = a / j
    total_s = v / a + ramp_s
    times = np.linspace(0.0, total_s, 400)
    acceleration = np.minimum.reduce((j * times, np.full(400, a), j * (total_s - times)))
    h = times[1]
    speed = np.concatenate(([0.0], np.cumsum((acceleration[1:] + acceleration[:-1]) / 2.0 * h)))
    way = np.concatenate(([0.0], np.cumsum((speed[1:] + speed[:-1]) / 2.0 * h)))
    squared = speed**2
    first = np.interp(grid - grid[0], way, squared)
    last = np.interp(grid[-1] - grid, way, squared)
    return np.minimum(first, last)


def _two_passes(
    grid: Floats,
    ceiling: Floats,
    dq: Floats,
    ddq: Floats,
    bend: Floats,
    limits: SpeedLimits,
    acceleration_rad_per_s2: Floats,
) -> Floats:
    """Return the highest squared speed (g,) under the ceiling that can be braked and gained."""
    slope = np.maximum(np.column_stack((dq, np.ones(len(grid)))), 1e-12)
    curve = np.column_stack((ddq, bend))
    most = SAFETY * np.append(acceleration_rad_per_s2, limits.acceleration_mm_per_s2)
    offset, factor = (most / slope).tolist(), (curve / slope).tolist()
    steps, squared = np.diff(grid).tolist(), ceiling.tolist()

    def room(i: int, value: float) -> float:
        return max(0.0, min(o - f * value for o, f in zip(offset[i], factor[i], strict=True)))

    for i, step in enumerate(steps):  # gain speed
        gained = squared[i] + 2.0 * step * room(i, squared[i])
        squared[i + 1] = min(squared[i + 1], gained)
    for i in range(len(steps) - 1, -1, -1):  # and be able to lose it
        braked = squared[i + 1] + 2.0 * steps[i] * room(i + 1, squared[i + 1])
        squared[i] = min(squared[i], braked)
    return np.array(squared)
