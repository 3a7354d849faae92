"""Errors of a cloud's points by its moving average: the noise it leaves, and what it rounds off.

A single frame is off by the noise of the tracker, the average of several by less. But a hand goes
on meanwhile, over bone that is not even, and the middle of its way lies beside the tip. Frames less
their average show both. Fourth differences separate white noise from an even path (Gasser 1986);
what else they show is what the average rounds off there.
"""

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.geometry.surface.cloud import SurfaceCloud

ORDER = 4  # of differences
GAIN = 70.0  # sum of squares of 1, -4, 6, -4, 1: variance of such a difference of white noise


def averaging_covariances(single: SurfaceCloud, averaged: SurfaceCloud, frames: int) -> Floats:
    """Return covariances (n, 3, 3) in mm^2 of the points of an averaged cloud, in its frame.

    Args:
        single: The same points without an average.
        averaged: The cloud.
        frames: So many are averaged at each point.
    """
    noise = frame_covariance(single)
    beside = single.points_base - averaged.points_base
    scatter = np.einsum("ni,nj->nij", beside, beside)
    seen, by_noise = float(np.trace(scatter.mean(axis=0))), (1.0 - 1.0 / frames) * np.trace(noise)
    rounded = max(1.0 - float(by_noise) / seen, 0.0) if seen > 0.0 else 0.0
    return readonly(noise / frames + rounded * scatter)


def frame_covariance(single: SurfaceCloud) -> Floats:
    """Return the covariance (3, 3) in mm^2 of the white noise of one frame.

    Differences span no change of stroke, nor a hidden frame unless there are no others.
    """
    rows, spans = single.strokes, single.times_s[ORDER:] - single.times_s[:-ORDER]
    within: Bools = rows[ORDER:] == rows[:-ORDER]
    if not within.any():
        return np.zeros((3, 3))
    even = within & (spans < (1.0 + 0.5 / ORDER) * np.median(spans[within]))
    steps = np.diff(single.points_base, ORDER, axis=0)[even if even.any() else within]
    return steps.T @ steps / (GAIN * len(steps))
