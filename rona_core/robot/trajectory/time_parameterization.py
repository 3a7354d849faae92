"""How fast to go along a joint path: constant speed where the joints allow, smooth everywhere.

The path is a spline over its own length. Two passes over a fine grid, forward and backward, give
the fastest speed profile within all limits (time-optimal path parameterisation after Bobrow 1985
and Verscheure 2009, with the path speed capped). Its way over time is then averaged over a short
span, which turns steps of the acceleration into ramps: the jerk along the path is limited.
See docs/algorithms/robot/verification_and_timing.md.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from rona_core.errors import InvalidInputError, NotReachableError
from rona_core.geometry.arrays import Bools, Floats, Ints

SAFETY = 0.9  # share of the acceleration limits that is planned with
BENT_JOINT = 0.7  # of that may be spent on following the bend of the path, by a joint
BENT_PATH = 0.95  # likewise by the tool: in a bend it neither gains nor loses much speed
ALONG_PATH = 0.6  # and this for gaining and losing speed
GRID_MM, LEAST_GRID, MOST_GRID = 0.1, 400, 60_000
MERGED = 1e-6  # path points closer together than this (mm) are one
SPREAD = 1.1  # of the way within an averaging span, for what is gained on it
CREEP_MM_PER_S = 1.0  # no peak is cut to less
TINY = 1e-12


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
    span_s: float  # that the way is averaged over
    raw_times_s: Floats  # (g,) of the profile before averaging
    raw_way_mm: Floats  # (g,)
    raw_speed_mm_per_s: Floats  # (g,)

    @property
    def duration_s(self) -> float:
        """Time needed from rest to rest."""
        return float(self.raw_times_s[-1] + self.span_s)

    def way_at(self, times_s: Floats) -> Floats:
        """Return the way (m,) at times (m,) from 0 to the duration."""
        raw = (self.raw_times_s, self.raw_way_mm, self.raw_speed_mm_per_s)
        way = (_summed(times_s, *raw) - _summed(times_s - self.span_s, *raw)) / self.span_s
        return np.clip(way, self.raw_way_mm[0], self.raw_way_mm[-1])


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
        NotReachableError: at some place no speed keeps to the limits.
    """
    keep = kept(way_mm)
    way, qs, points = way_mm[keep], qs_rad[keep], points_base[keep]
    if len(way) < 2 or way[-1] - way[0] <= MERGED:
        raise InvalidInputError("a path without length cannot be timed; it needs two places")
    joints, places = (CubicSpline(way, v, bc_type="natural") for v in (qs, points))
    cells = int(np.clip(np.ceil((way[-1] - way[0]) / GRID_MM), LEAST_GRID, MOST_GRID))
    grid = np.linspace(way[0], way[-1], cells + 1)
    step = float(grid[1] - grid[0])
    dq, ddq = np.abs(joints(grid, 1)), np.abs(joints(grid, 2))
    bend = np.linalg.norm(places(grid, 2), axis=1)
    stretch = np.linalg.norm(places(grid, 1), axis=1)  # of the tool's way over the given one
    most = SAFETY * acceleration_rad_per_s2
    gain, jerk = SAFETY * ALONG_PATH * limits.acceleration_mm_per_s2, limits.jerk_mm_per_s3
    gain = min(gain, float(np.sqrt(limits.speed_mm_per_s * jerk)))  # no more than can be reached
    span_s = gain / jerk
    ceiling = np.minimum.reduce(
        (
            limits.speed_mm_per_s / np.maximum(stretch, 1.0),
            (SAFETY * speed_rad_per_s / np.maximum(dq, TINY)).min(axis=1),
            np.sqrt((BENT_JOINT * most / np.maximum(ddq, TINY)).min(axis=1)),
            np.sqrt(SAFETY * BENT_PATH * limits.acceleration_mm_per_s2 / np.maximum(bend, TINY)),
        )
    )
    ceiling = _eroded(ceiling, step, span_s)
    spare = (most - ddq * ceiling[:, None] ** 2) / np.maximum(dq, TINY)
    room = np.minimum(gain, spare.min(axis=1))
    speed = _two_passes(ceiling, room, step)
    speed = _two_passes(_opened(speed, step, span_s), room, step)
    pace = speed[1:] + speed[:-1]
    if pace.min() <= 0.0:
        raise NotReachableError(
            f"the motion would stand still {grid[int(np.argmin(pace))]:.1f} mm along its way of "
            f"{grid[-1] - grid[0]:.1f} mm: it bends too sharply there to be followed"
        )
    times = np.concatenate(([0.0], np.cumsum(2.0 * step / pace)))
    raw = (times, grid, speed)
    shown = np.concatenate((times, times + span_s))
    shown.sort()
    ahead, behind = _place(shown, *raw), _place(shown - span_s, *raw)
    ways = (_summed(shown, *raw) - _summed(shown - span_s, *raw)) / span_s
    return TimedPath(shown, ways, (ahead - behind) / span_s, joints, span_s, *raw)


def kept(way_mm: Floats) -> Bools:
    """Return which path points (n,) count: those that are not the same place as the one before."""
    keep = np.concatenate(([True], np.diff(way_mm) > MERGED))
    keep[-1] = True
    if np.count_nonzero(keep) > 2 and way_mm[-1] - way_mm[keep][-2] <= MERGED:
        keep[np.flatnonzero(keep)[-2]] = False
    return keep


def _shifted(values: Floats, by: int, outside: float) -> Floats:
    result = np.full_like(values, outside)
    if by > 0:
        result[by:] = values[:-by]
    else:
        result[:by] = values[-by:]
    return result


def _reach(speed: Floats, step: float, span_s: float) -> Floats:
    """Return how many cells (g,) are passed in half an averaging span."""
    return np.ceil(SPREAD * speed * span_s / 2.0 / step)


def _eroded(ceiling: Floats, step: float, span_s: float) -> Floats:
    """Return the ceiling (g,) with each low place as wide as half a span before and after it.

    Then the mean over a span that is centred at a low place is no higher than that place.
    """
    cells = _reach(ceiling, step, span_s)
    result = ceiling.copy()
    for k in range(1, min(int(cells.max()), len(ceiling) - 1) + 1):
        low = np.where(cells >= k, ceiling, np.inf)
        result = np.minimum(result, np.minimum(_shifted(low, k, np.inf), _shifted(low, -k, np.inf)))
    return result


def _opened(speed: Floats, step: float, span_s: float) -> Floats:
    """Return the speed (g,) with peaks cut that last shorter than a span.

    Gaining and losing speed are then at least a span apart, and their ramps do not add up.
    """
    cells = _reach(speed, step, span_s)
    low = speed.copy()
    count = min(int(cells.max()), len(speed) - 1)
    for k in range(1, count + 1):
        near = np.minimum(_shifted(speed, k, 0.0), _shifted(speed, -k, 0.0))
        low = np.where(cells >= k, np.minimum(low, near), low)
    result = low.copy()
    for k in range(1, count + 1):
        near = np.where(cells >= k, low, 0.0)
        result = np.maximum(result, np.maximum(_shifted(near, k, 0.0), _shifted(near, -k, 0.0)))
    # next to a rest a peak may be cut down to it, and would then never be passed
    return np.minimum(np.maximum(result, CREEP_MM_PER_S), speed)


def _two_passes(ceiling: Floats, room: Floats, step: float) -> Floats:
    """Return the highest speed (g,) under the ceiling that can be gained and braked from rest."""
    squared = ceiling**2
    squared[0] = squared[-1] = 0.0
    least = 2.0 * step * np.minimum(room[1:], room[:-1])
    gained = np.concatenate(([0.0], np.cumsum(least)))
    squared = np.minimum.accumulate(squared - gained) + gained
    left = gained[-1] - gained
    squared = np.minimum.accumulate((squared - left)[::-1])[::-1] + left
    squared = np.minimum(np.maximum(squared, 0.0), ceiling**2)
    squared[0] = squared[-1] = 0.0
    return np.sqrt(squared)


def _spot(times_s: Floats, raw_times_s: Floats) -> tuple[Ints, Floats]:
    """Return the cell (m,) of each time, and the time since its start within the profile."""
    i = np.clip(np.searchsorted(raw_times_s, times_s, side="right") - 1, 0, len(raw_times_s) - 2)
    return i, np.clip(times_s, raw_times_s[0], raw_times_s[-1]) - raw_times_s[i]


def _place(times_s: Floats, raw_times_s: Floats, raw_way: Floats, raw_speed: Floats) -> Floats:
    """Return the way (m,) of the profile at times (m,): at rest before and afterwards."""
    i, u = _spot(times_s, raw_times_s)
    gain = (raw_speed[i + 1] - raw_speed[i]) / (raw_times_s[i + 1] - raw_times_s[i])
    return raw_way[i] + u * (raw_speed[i] + u * gain / 2.0)


def _summed(times_s: Floats, raw_times_s: Floats, raw_way: Floats, raw_speed: Floats) -> Floats:
    """Return the integral (m,) of the way over time, from the start of the profile."""
    gaps = np.diff(raw_times_s)
    gains = np.diff(raw_speed) / gaps
    pieces = gaps * (raw_way[:-1] + gaps * (raw_speed[:-1] / 2.0 + gaps * gains / 6.0))
    sums = np.concatenate(([0.0], np.cumsum(pieces)))
    i, u = _spot(times_s, raw_times_s)
    inside = sums[i] + u * (raw_way[i] + u * (raw_speed[i] / 2.0 + u * gains[i] / 6.0))
    before = np.minimum(times_s - raw_times_s[0], 0.0) * raw_way[0]
    after = np.maximum(times_s - raw_times_s[-1], 0.0) * raw_way[-1]
    return inside + before + after
