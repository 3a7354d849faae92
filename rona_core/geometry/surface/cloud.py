"""Surface point cloud from a sliding pointer: jumps removed, strokes averaged.

Errors of a cloud's points by its moving average: the noise it leaves, and what it rounds off. A
single frame is off by the noise of the tracker, the average of several by less. But a hand goes on
meanwhile, over bone that is not even, and the middle of its way lies beside the tip. Frames less
their average show both. Fourth differences separate white noise from an even path (Gasser 1986);
what else they show is what the average rounds off there.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints, as_floats, as_points, readonly

MAX_SPEED_MM_PER_S = 250.0  # a sliding hand is slower; noise of one frame makes up to 100
MAX_GAP_S = 0.5  # without a sample for longer, a new stroke begins
MIN_STROKE = 5  # samples; shorter pieces between two jumps are stray


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceCloud:
    """Surface points in ``base`` in the order they were taken, and what was left out."""

    points_base: Floats  # (n, 3)
    times_s: Floats  # (n,) on the clock of their capture
    strokes: Ints  # (n,) number of the stroke without a jump that each point belongs to
    n_dropped: int
    n_raw: int  # samples that came in
    average_s: float  # width of the moving average; 0 for none

    def __len__(self) -> int:
        return len(self.points_base)


def build_cloud(
    points_base: ArrayLike,
    times_s: ArrayLike,
    *,
    average_s: float = 0.0,
) -> SurfaceCloud:
    """Return the samples of one capture without jumps, averaged along each stroke if asked to.

    A step faster than 250 mm/s or a pause longer than 0.5 s ends a stroke.
    Strokes of fewer than 5 samples are dropped: stray samples, and a lifted tip that flies. A tip
    that is lifted slowly looks like a stroke and stays.

    Args:
        points_base: Tip positions (n, 3) in ``base``, mm.
        times_s: When they were taken (n,), increasing.
        average_s: Width of a moving average in time. It shrinks evenly on both sides towards the
            ends of a stroke, so that a straight stroke at even speed stays where it is.

    Raises:
        InvalidInputError: wrong shapes, times that do not increase, settings out of range.
    """
    points = as_points(points_base, name="points_base")
    times = as_times(times_s, len(points))
    if not 0.0 <= average_s < np.inf:
        raise InvalidInputError(f"average_s must be 0 or more, not {average_s}")
    steps_mm, steps_s = np.linalg.norm(np.diff(points, axis=0), axis=1), np.diff(times)
    cut = (steps_mm > MAX_SPEED_MM_PER_S * steps_s) | (steps_s > MAX_GAP_S)
    pieces = np.concatenate(([0], np.cumsum(cut)))[: len(points)]
    kept = _in_long_pieces(pieces)
    points, times = points[kept], times[kept]
    strokes = np.unique(pieces[kept], return_inverse=True)[1].astype(np.int64)
    if average_s > 0.0:
        for stroke in range(int(strokes.max(initial=-1)) + 1):
            rows = strokes == stroke
            points[rows] = _average(points[rows], times[rows], average_s)
    return SurfaceCloud(
        points_base=readonly(points),
        times_s=readonly(times),
        strokes=readonly(strokes),
        n_dropped=int((~kept).sum()),
        n_raw=len(kept),
        average_s=float(average_s),
    )


def merge_clouds(clouds: Sequence[SurfaceCloud]) -> SurfaceCloud:
    """Return several captures as one cloud; strokes are numbered on, times stay their own.

    Raises:
        InvalidInputError: no clouds.
    """
    if not clouds:
        raise InvalidInputError("there are no clouds to merge")
    counts = [int(cloud.strokes.max(initial=-1)) + 1 for cloud in clouds]
    firsts = np.concatenate(([0], np.cumsum(counts)[:-1]))
    strokes = [cloud.strokes + first for cloud, first in zip(clouds, firsts, strict=True)]
    return SurfaceCloud(
        points_base=readonly(np.concatenate([cloud.points_base for cloud in clouds])),
        times_s=readonly(np.concatenate([cloud.times_s for cloud in clouds])),
        strokes=readonly(np.concatenate(strokes).astype(np.int64)),
        n_dropped=sum(cloud.n_dropped for cloud in clouds),
        n_raw=sum(cloud.n_raw for cloud in clouds),
        average_s=max(cloud.average_s for cloud in clouds),
    )


def as_times(times_s: ArrayLike, n: int) -> Floats:
    """Return times (n,) after checking that they increase.

    Raises:
        InvalidInputError: another number of times, or times that do not increase.
    """
    times = as_floats(times_s, name="times_s")
    if times.shape != (n,):
        raise InvalidInputError(f"{n} points need as many times, not shape {times.shape}")
    if (np.diff(times) <= 0).any():
        i = int(np.argmax(np.diff(times) <= 0))
        raise InvalidInputError(
            f"times_s must increase, but {times[i + 1]:.6g} follows {times[i]:.6g} at {i + 1}"
        )
    return times


def _in_long_pieces(pieces: Ints) -> Bools:
    """Return which samples (n,) belong to a piece of at least 5."""
    return np.bincount(pieces, minlength=1)[pieces] >= MIN_STROKE


def _average(points: Floats, times: Floats, average_s: float) -> Floats:
    """Return the centred moving average (n, 3) of one stroke."""
    to_ends = np.minimum(times - times[0], times[-1] - times)
    half = np.minimum(average_s / 2, to_ends) * (1 + 1e-12) + 1e-12
    first = np.searchsorted(times, times - half, side="left")
    last = np.searchsorted(times, times + half, side="right")
    sums = np.concatenate((np.zeros((1, 3)), np.cumsum(points - points[0], axis=0)))
    return points[0] + (sums[last] - sums[first]) / (last - first)[:, None]


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
