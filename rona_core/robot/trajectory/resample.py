"""Resampling of a path, dense enough to be evaluated, timed and followed point by point."""

import numpy as np

from rona_core.geometry.arrays import Floats, Ints
from rona_core.geometry.path5d import Path5D

STEP_MM = 1.0
STEP_RAD = float(np.deg2rad(1.0))
SLACK = 1.25  # a path that is nearly dense enough is left as it is


def resample_path(path: Path5D) -> Path5D:
    """Return the path with steps of at most about 1 mm and 1 degree; its own points stay.

    Positions in between lie on straight lines, axes turn evenly. A path that is dense already is
    returned unchanged.

    Raises:
        DegenerateGeometryError: neighbouring axes are opposite.
    """
    points, axes = path.points_base, path.axes_base
    steps_mm, turns = path.steps()
    strides = np.maximum(steps_mm / STEP_MM, turns / STEP_RAD)
    if strides.max(initial=0.0) <= SLACK:
        return path
    path.references()  # refuses opposite axes
    counts = np.where(strides <= SLACK, 1, np.ceil(strides)).astype(np.int64)
    segment, shares = subdivided(counts)
    shares = shares[:, None]
    between = points[segment] * (1.0 - shares) + points[segment + 1] * shares
    turned = _turned(axes[segment], axes[segment + 1], shares, turns[segment][:, None])
    return Path5D(np.vstack((between, points[-1:])), np.vstack((turned, axes[-1:])))


def subdivided(counts: Ints) -> tuple[Ints, Floats]:
    """Return the segment (m,) of each place, and its share of it, for so many places a segment."""
    segment = np.repeat(np.arange(len(counts)), counts)
    first = np.repeat(np.cumsum(counts) - counts, counts)
    return segment, (np.arange(len(segment)) - first) / counts[segment]


def _turned(start: Floats, end: Floats, shares: Floats, turns_rad: Floats) -> Floats:
    """Return unit vectors (n, 3) that turn evenly from ``start`` to ``end`` (slerp)."""
    small = turns_rad < 1e-6
    sine = np.where(small, 1.0, np.sin(turns_rad))
    a = np.where(small, 1.0 - shares, np.sin((1.0 - shares) * turns_rad) / sine)
    b = np.where(small, shares, np.sin(shares * turns_rad) / sine)
    mixed = a * start + b * end
    return mixed / np.linalg.norm(mixed, axis=1, keepdims=True)
