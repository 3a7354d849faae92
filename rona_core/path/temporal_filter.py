"""Temporal filter of path samples: local linear regression with a Gaussian window, without lag."""

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, as_floats, readonly
from rona_core.path.simplification.deviation import as_path

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
