"""Samples of a path: filtered without lag, and dense between way-points."""

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Floats, as_floats, as_points, as_unit_vectors, readonly
from rona_core.geometry.path5d import Path5D, turned_between
from rona_core.path.simplification.error_bound import as_path

REACH = 4.0  # of the Gaussian, in sigma


def cutoff_hz(sigma_s: float) -> float:
    """Return the frequency at which the filter passes half the power (-3 dB).

    The gain at f is exp(-(2 pi f sigma)^2 / 2); sigma 0.05 s gives 2.65 Hz.
    """
    return float(np.sqrt(np.log(2.0)) / (2.0 * np.pi * sigma_s))


def filter_path(points: ArrayLike, times_s: ArrayLike, sigma_s: float = 0.05) -> Floats:
    """Return the path (n, m) filtered by a Gaussian in time, at the same times.

    Each sample becomes a straight line fitted to its neighbours, weighted by the Gaussian and by
    the time that each neighbour stands for. So even motion passes unchanged, also with missing
    frames and at the ends, and nothing lags. A sample without neighbours stays as it is.

    Args:
        points: Samples (n, m), any m.
        times_s: Their times (n,), increasing.
        sigma_s: Width of the Gaussian; 0 returns the samples as they are.

    Raises:
        InvalidInputError: wrong shapes, times that do not increase, sigma out of range.
    """
    p = as_path(points)
    times = as_floats(times_s, name="times_s")
    if times.shape != (len(p),) or (np.diff(times) <= 0).any():
        raise InvalidInputError(f"times_s must be {len(p)} increasing times")
    if not 0.0 <= sigma_s < np.inf:
        raise InvalidInputError(f"sigma_s must be 0 or more, not {sigma_s}")
    n = len(p)
    if sigma_s == 0.0 or n < 3:
        return readonly(p.copy())
    gaps = np.minimum(np.diff(times), sigma_s)  # a pause stands for no more than the kernel sees
    share = np.concatenate(([gaps[0]], gaps[:-1] + gaps[1:], [gaps[-1]])) / 2.0
    origin = p.mean(axis=0)
    q = p - origin
    # weighted moments of the time offset u, and of the positions with it
    m0, m1, m2 = share.copy(), np.zeros(n), np.zeros(n)
    y0, y1 = share[:, None] * q, np.zeros_like(q)
    for lag in range(1, n):
        u = times[lag:] - times[:-lag]
        if u.min() > REACH * sigma_s:
            break
        weight = np.where(u <= REACH * sigma_s, np.exp(-0.5 * (u / sigma_s) ** 2), 0.0)
        for own, other, offset in (
            (slice(None, -lag), slice(lag, None), u),
            (slice(lag, None), slice(None, -lag), -u),
        ):
            w = weight * share[other]
            m0[own] += w
            m1[own] += w * offset
            m2[own] += w * offset**2
            y0[own] += w[:, None] * q[other]
            y1[own] += (w * offset)[:, None] * q[other]
    spread = m0 * m2 - m1**2
    lone = spread <= 1e-9 * (m0 * sigma_s) ** 2
    spread = np.where(lone, 1.0, spread)
    filtered = (m2[:, None] * y0 - m1[:, None] * y1) / spread[:, None]
    return readonly(origin + np.where(lone[:, None], q, filtered))


MIN_BETWEEN_RAD = 1e-4  # short of opposite; the great circle is a guess beyond
ROUNDING = 1e-9  # of a step


def densify(
    points_base: ArrayLike,
    axes_base: ArrayLike,
    *,
    step_mm: float = 1.0,
    step_deg: float = 1.0,
) -> Path5D:
    """Return a 5D path whose steps are at most ``step_mm`` long and turn at most ``step_deg``.

    Between way-points the position moves on the straight line and the axis on the great circle,
    both evenly, so that a bound on the deviation of the way-point path holds for the dense one.
    All way-points are among the result, unchanged; a way-point that repeats the one before, in
    position and axis, appears once.

    Args:
        points_base: Way-points (k, 3) in ``base``, k >= 1.
        axes_base: Unit probe axes (k, 3) into the bone.
        step_mm: Longest step.
        step_deg: Largest turn of the axis in one step.

    Raises:
        InvalidInputError: wrong shapes, no points, steps that are not positive.
        DegenerateGeometryError: neighbouring axes are opposite.
    """
    points = as_points(points_base, at_least=1, name="points_base")
    axes = as_unit_vectors(axes_base, name="axes_base")
    if len(points) != len(axes):
        raise InvalidInputError(f"{len(points)} points need as many axes, not {len(axes)}")
    if not (step_mm > 0 and step_deg > 0):
        raise InvalidInputError(
            f"step_mm and step_deg must be positive, not {step_mm} and {step_deg}"
        )
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    turns = _angles(axes[:-1], axes[1:])
    if (turns > np.pi - MIN_BETWEEN_RAD).any():
        i = int(turns.argmax())
        raise DegenerateGeometryError(
            f"the axes of way-points {i} and {i + 1} are opposite: the way between is undefined"
        )
    needed = np.maximum(lengths / step_mm, turns / np.deg2rad(step_deg))
    counts = np.ceil(needed - ROUNDING).astype(np.int64)
    counts = np.where((counts < 1) & ((lengths > 0) | (turns > 0)), 1, counts)
    segment = np.repeat(np.arange(len(counts)), counts)
    step = np.arange(len(segment)) - np.repeat(np.cumsum(counts) - counts, counts) + 1
    t = (step / counts[segment])[:, None]
    dense_points = points[segment] + t * (points[segment + 1] - points[segment])
    dense_axes = turned_between(axes[segment], axes[segment + 1], t, turns[segment, None])
    ends = step == counts[segment]
    dense_points[ends], dense_axes[ends] = points[segment + 1][ends], axes[segment + 1][ends]
    return Path5D(np.vstack((points[:1], dense_points)), np.vstack((axes[:1], dense_axes)))


def insert_waypoints(points_base: ArrayLike, step_mm: float) -> Floats:
    """Return the way-points (k, 3) with places on the straight lines between, ``step_mm`` at most.

    All way-points are among the places (m, 3), unchanged; one that repeats the one before appears
    once.

    Raises:
        InvalidInputError: wrong shape, no points, a step that is not positive.
    """
    points = as_points(points_base, at_least=1, name="points_base")
    level = np.tile((0.0, 0.0, 1.0), (len(points), 1))
    return densify(points, level, step_mm=step_mm).points_base


def _angles(a: Floats, b: Floats) -> Floats:
    """Return the angle (k,) between unit vectors, accurate also for small and flat angles."""
    return 2.0 * np.arctan2(np.linalg.norm(a - b, axis=1), np.linalg.norm(a + b, axis=1))
