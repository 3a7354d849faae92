"""Timing of a joint path: corners blended, then as fast as the joints allow.

Corner blending of a joint path, as far as the tool may leave the path and no farther. Each joint is
averaged over a window of the way that is as wide as the allowed deviation of the tool permits. A
path that is straight in pieces gets a continuous second derivative, so that it can be driven at a
steady speed. See docs/algorithms/robot/verification_and_timing.md.

Time parameterisation of a joint path (TOPP): constant speed where the joints allow, no jerks. The
path is a spline over its own length. Two passes over a fine grid, forward and backward, give the
fastest speed profile within all limits (Bobrow 1985, Verscheure 2009; the path speed is capped).
Its way over time is then averaged over a short span, which limits the jerk. See
docs/algorithms/robot/verification_and_timing.md.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline, PPoly

from rona_core.errors import InvalidInputError, NotReachableError
from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.path5d import subdivided
from rona_core.geometry.pose import Poses
from rona_core.robot.kinematics.robot_model import JointLimits, RobotModel

WIDEST_MM = 6.0  # half the window where nothing speaks against it
NARROWEST_MM = 0.05  # a window narrower than this changes nothing
SLOPE = 0.5  # change of the half width with the way, at most
TURN_RAD = float(np.deg2rad(0.25))  # the tool may turn away by this much
ROUNDS = 12  # of narrowing the windows
AIM = 0.95  # of the deviation; the rest is for what lies between the points looked at
ENOUGH = 1.0 + 1e-6  # rounding must not decide
KNOTS_A_WIDTH, WIDEST_KNOT_MM = 4.0, 1.0


@dataclass(frozen=True, slots=True, eq=False)
class BlendedPath:
    """A joint path without corners, and how far it strays from the one it was made of."""

    way_mm: Floats  # (k,) along the path that was given
    qs_rad: Floats  # (k, 6)
    points_base: Floats  # (k, 3) position of the probe
    deviation_mm: float  # largest distance of the probe from where it was meant to be
    turn_rad: float  # largest angle between the two orientations


def blend_corners(
    way_mm: Floats,
    qs_rad: Floats,
    model: RobotModel,
    deviation_mm: float,
) -> BlendedPath:
    """Return the joint path with its corners rounded.

    Args:
        way_mm: Way along the path (n,), strictly growing.
        qs_rad: Joint angles (n, 6), linear in between.
        model: The robot, whose probe is watched.
        deviation_mm: How far the probe may be from where the given path has it at the same way.

    Raises:
        InvalidInputError: fewer than two places, or a way that does not grow.
    """
    if len(way_mm) < 2 or qs_rad.shape != (len(way_mm), 6) or np.diff(way_mm).min() <= 0.0:
        raise InvalidInputError("a joint path needs two places, its way must grow between them")
    meant = _probe(model, qs_rad)
    half = np.minimum(WIDEST_MM, SLOPE * np.minimum(way_mm - way_mm[0], way_mm[-1] - way_mm))
    slopes = np.diff(qs_rad, axis=0) / np.diff(way_mm)[:, None]
    joints = PPoly(np.stack((slopes, qs_rad[:-1])), way_mm)
    for attempt in range(ROUNDS):
        off, turned = _apart(_probe(model, _triangle_mean(joints, way_mm, half)), meant)
        excess = np.maximum(off / deviation_mm, turned / TURN_RAD) / AIM
        if excess.max() <= ENOUGH:
            break
        closed = attempt >= ROUNDS // 2  # windows that narrowing did not help
        narrower = half / np.maximum(1.0, excess)
        half = _sloped(way_mm, np.where(excess > ENOUGH, 0.0, half) if closed else narrower)
    knots = _knots(way_mm, half)
    qs = _triangle_mean(joints, knots, np.interp(knots, way_mm, half))
    qs[0], qs[-1] = qs_rad[0], qs_rad[-1]
    probe = _probe(model, qs)
    off, turned = _apart(probe, _probe(model, joints(knots)))
    return BlendedPath(knots, qs, probe.translations, float(off.max()), float(turned.max()))


def _triangle_mean(joints: PPoly, at_mm: Floats, half_mm: Floats) -> Floats:
    """Return the mean (m, 6) of a joint path under triangles of some half widths (m,).

    The second difference of its second integral, which is exact.
    """
    twice = joints.antiderivative(2)
    wide = half_mm >= NARROWEST_MM
    w = np.where(wide, half_mm, 1.0)
    change = twice(at_mm + w) + twice(at_mm - w) - 2.0 * twice(at_mm)
    return np.where(wide[:, None], change / w[:, None] ** 2, joints(at_mm))


def _probe(model: RobotModel, qs_rad: Floats) -> Poses:
    return model.forward(qs_rad) @ model.T_flange_probe


def _apart(real: Poses, meant: Poses) -> tuple[Floats, Floats]:
    """Return distance (mm) and angle (rad), each (n,), between two sequences of poses."""
    off = np.linalg.norm(real.translations - meant.translations, axis=1)
    chord = np.linalg.norm(real.rotations - meant.rotations, axis=(1, 2))
    return off, 2.0 * np.arcsin(np.minimum(1.0, chord / np.sqrt(8.0)))


def _sloped(way_mm: Floats, half_mm: Floats) -> Floats:
    """Return half widths (n,) lowered until they change by no more than ``SLOPE``."""
    lean = SLOPE * way_mm
    up = np.minimum.accumulate(half_mm - lean) + lean
    return np.minimum.accumulate((up + lean)[::-1])[::-1] - lean


def _knots(way_mm: Floats, half_mm: Floats) -> Floats:
    """Return the ways (k,) at which the rounded path is kept: closely where windows are narrow."""
    least = np.minimum(half_mm[1:], half_mm[:-1])
    inside = np.clip(least / KNOTS_A_WIDTH, 2.0 * NARROWEST_MM, WIDEST_KNOT_MM)
    steps = np.diff(way_mm)
    counts = np.maximum(1, np.ceil(steps / inside - 1e-9)).astype(np.int64)
    segment, share = subdivided(counts)
    return np.append(way_mm[segment] + steps[segment] * share, way_mm[-1])


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
    """A joint spline over the way along a path (mm), and that way over time."""

    joints: CubicSpline
    way_mm: Floats  # (g,) grid from the first to the last place
    integral: PPoly  # of the way over time, before it is averaged
    span_s: float  # that the way is averaged over
    duration_s: float  # from rest to rest

    def way_at(self, times_s: Floats) -> Floats:
        """Return the way (m,) at times (m,) from 0 to the duration."""
        mean = (self.integral(times_s) - self.integral(times_s - self.span_s)) / self.span_s
        return np.clip(mean, self.way_mm[0], self.way_mm[-1])


def parameterize_time(
    way_mm: Floats,
    qs_rad: Floats,
    points_base: Floats,
    limits: SpeedLimits,
    joint_limits: JointLimits,
    feeds_mm_per_s: Floats | None = None,
) -> TimedPath:
    """Return the fastest timing of a joint path within all limits, from rest to rest.

    Args:
        way_mm: Way along the path (n,), not decreasing, from 0; repeated values are one point.
        qs_rad: Joint angles (n, 6), continuous.
        points_base: Positions of the tool (n, 3) that the path acceleration is meant for.
        limits: Speed, acceleration and jerk along the path.
        joint_limits: Speed and acceleration of the joints.
        feeds_mm_per_s: Most speed of the stretch that ends at each place (n,); None: that of the
            limits everywhere.

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
    gain = SAFETY * ALONG_PATH * limits.acceleration_mm_per_s2
    gain = min(gain, float(np.sqrt(limits.speed_mm_per_s * limits.jerk_mm_per_s3)))
    span_s = gain / limits.jerk_mm_per_s3
    # per mm of way, and per squared mm
    dq, ddq = np.abs(joints(grid, 1)), np.abs(joints(grid, 2))
    stretch, bend = (np.linalg.norm(places(grid, order), axis=1) for order in (1, 2))
    most = SAFETY * joint_limits.acceleration_rad_per_s2
    tool_most = SAFETY * BENT_PATH * limits.acceleration_mm_per_s2
    ceiling = np.minimum.reduce(
        (
            _asked(grid, way, limits, None if feeds_mm_per_s is None else feeds_mm_per_s[keep])
            / np.maximum(stretch, 1.0),
            (SAFETY * joint_limits.speed_rad_per_s / np.maximum(dq, TINY)).min(axis=1),
            np.sqrt((BENT_JOINT * most / np.maximum(ddq, TINY)).min(axis=1)),
            np.sqrt(tool_most / np.maximum(bend, TINY)),
        )
    )
    ceiling = _spread(np.minimum, ceiling, _half_span_cells(ceiling, step, span_s))
    # Bobrow 1985: |q'(s)| s'' <= q''_max - |q''(s)| s'^2 for each joint
    spare = (most - ddq * ceiling[:, None] ** 2) / np.maximum(dq, TINY)
    gain_left = np.minimum(gain, spare.min(axis=1))
    speed = _two_passes(ceiling, gain_left, step)
    speed = _two_passes(_peaks_cut(speed, step, span_s), gain_left, step)
    times, integral = _integral_over_time(grid, speed)
    return TimedPath(joints, grid, integral, span_s, float(times[-1] + span_s))


def _asked(grid: Floats, way: Floats, limits: SpeedLimits, feeds: Floats | None) -> Floats:
    """Return the speed (g,) that is asked for along the way, the least within a cell around.

    A stretch may begin anywhere in a cell, and end in the same one.
    """
    if feeds is None:
        return np.full(len(grid), limits.speed_mm_per_s)
    step, last = grid[1] - grid[0], len(way) - 1
    first = np.clip(np.searchsorted(way, grid - step, side="right"), 1, last)
    behind = np.clip(np.searchsorted(way, grid + step, side="left"), 1, last) + 1
    ranges = np.column_stack((first, behind)).ravel()  # each is before its end and never empty
    slowest = np.minimum.reduceat(np.append(feeds, np.inf), ranges)[::2]
    return np.minimum(limits.speed_mm_per_s, slowest)


def _integral_over_time(way_mm: Floats, speed_mm_per_s: Floats) -> tuple[Floats, PPoly]:
    """Return the times (g,) at which places of the way are passed, and the integral of the way.

    From each place (g,) to the next the acceleration is constant; before and after it rests.
    """
    pace = speed_mm_per_s[1:] + speed_mm_per_s[:-1]
    if pace.min() <= 0.0:
        raise NotReachableError(
            f"the motion would stand still {way_mm[int(np.argmin(pace))]:.1f} mm along its way of "
            f"{way_mm[-1] - way_mm[0]:.1f} mm: it bends too sharply there to be followed"
        )
    gaps = 2.0 * np.diff(way_mm) / pace
    times = np.concatenate(([0.0], np.cumsum(gaps)))
    gains = np.concatenate(([0.0], np.diff(speed_mm_per_s) / gaps, [0.0]))
    speeds = np.concatenate(([0.0], speed_mm_per_s))
    ways = np.concatenate((way_mm[:1], way_mm))
    knots = np.concatenate(([-1.0], times, times[-1:] + 1.0))
    return times, PPoly(np.stack((gains / 2.0, speeds, ways)), knots).antiderivative()


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


def _half_span_cells(speed: Floats, step: float, span_s: float) -> Floats:
    """Return how many cells (g,) are passed in half an averaging span."""
    return np.ceil(SPREAD * speed * span_s / 2.0 / step)


def _spread(extreme: np.ufunc, values: Floats, cells: Floats) -> Floats:
    """Return values (g,) after a min- or max-filter, each so many cells (g,) wider on both sides.

    After the min-filter of a ceiling, the mean over a span that is centred at a low place is no
    higher than that place.
    """
    outside = np.inf if extreme is np.minimum else 0.0
    result = values.copy()
    for k in range(1, min(int(cells.max()), len(values) - 1) + 1):
        near = np.where(cells >= k, values, outside)
        for by in (k, -k):
            result = extreme(result, _shifted(near, by, outside))
    return result


def _peaks_cut(speed: Floats, step: float, span_s: float) -> Floats:
    """Return the speed (g,) after a min- and a max-filter: peaks shorter than a span are cut.

    Gaining and losing speed are then at least a span apart, and their ramps do not add up.
    """
    cells = _half_span_cells(speed, step, span_s)
    low = speed.copy()
    for k in range(1, min(int(cells.max()), len(speed) - 1) + 1):
        near = np.minimum(_shifted(speed, k, 0.0), _shifted(speed, -k, 0.0))
        low = np.where(cells >= k, np.minimum(low, near), low)
    # next to a rest a peak may be cut down to it, and would then never be passed
    return np.minimum(np.maximum(_spread(np.maximum, low, cells), CREEP_MM_PER_S), speed)


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
