"""Interpolation of way-points with probe axes to a dense 5D path."""

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Floats, as_points, as_unit_vectors
from rona_core.geometry.path5d import Path5D

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
    dense_axes = _between(axes[segment], axes[segment + 1], turns[segment, None], t)
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


def _between(a: Floats, b: Floats, angle: Floats, t: Floats) -> Floats:
    """Return the unit vectors at the share ``t`` of the great circle from ``a`` to ``b``."""
    sine = np.sin(angle)
    tiny = angle < 1e-8
    safe = np.where(tiny, 1.0, sine)
    first = np.where(tiny, 1.0 - t, np.sin((1.0 - t) * angle) / safe)
    second = np.where(tiny, t, np.sin(t * angle) / safe)
    mixed = first * a + second * b
    return mixed / np.linalg.norm(mixed, axis=1)[:, None]
