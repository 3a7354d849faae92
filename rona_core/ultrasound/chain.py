"""Which candidate is the inner echo: evidence of each, and of its neighbours along the path.

A hidden chain: each A-scan is in the state of one of its candidates, or shows no inner echo. The
thickness of bone changes little over a millimetre, so neighbours support each other; the
forward-backward algorithm turns that into a probability for every candidate.
"""

import numpy as np

from rona_core.arrays import Floats
from rona_core.ultrasound.inner import Candidates, InnerChoice
from rona_core.ultrasound.material import Material

# log odds that a peak is the inner echo: louder than a nominal echo is unlikely, weaker is less
# likely the weaker it is; the sign is weak evidence, since tilt of the inner table spoils it
PRIOR, LEVEL, TOO_LOUD, OVER_NOISE, SIGN = -1.2, 1.6, -6.0, 1.5, 0.3
STEP_SD_MM = 0.35  # of the difference in thickness between neighbours
LINKED = 0.7  # share of neighbours that continue the same boundary
RANGE_MM = 10.0  # over which an unlinked candidate may lie
LOUDEST_SNR = 50.0  # more does not make it more certain
SAME_MM = 0.5  # candidates this close are the same boundary
COHERENT_RAD = 1.2  # phases up to this are trusted to a fraction of a cycle


def evidence(candidates: Candidates) -> Floats:
    """Return the log odds (n, k) of each candidate alone; minus infinity where there is none."""
    level = np.log(np.maximum(candidates.level, 1e-4))
    noise = np.maximum(candidates.noise, 1e-12)
    snr = np.log(np.clip(candidates.level / noise, 1e-2, LOUDEST_SNR))
    odds = PRIOR + LEVEL * level + TOO_LOUD * np.maximum(level, 0.0)
    odds = odds + OVER_NOISE * snr + SIGN * np.cos(candidates.phase_rad)
    return np.where(candidates.exists, odds, -np.inf)


def probabilities(candidates: Candidates, speed_mm_per_us: float) -> Floats:
    """Return the probability (n, k + 1) of each candidate, and last that there is no echo.

    Args:
        candidates: Of A-scans in the order of the path.
        speed_mm_per_us: Turns lags into thickness.
    """
    odds = evidence(candidates)
    n, k = odds.shape
    own = np.exp(np.column_stack((odds, np.zeros(n))))
    depth = candidates.lag_us * speed_mm_per_us / 2.0
    change = depth[1:, :, None] - depth[:-1, None, :]  # (n - 1, here, before)
    bell = np.exp(-((change / STEP_SD_MM) ** 2) / 2.0) / (STEP_SD_MM * np.sqrt(2.0 * np.pi))
    links = np.ones((max(n - 1, 0), k + 1, k + 1))
    links[:, :k, :k] = LINKED * RANGE_MM * bell + (1.0 - LINKED)
    forward, backward = own.copy(), np.ones_like(own)
    for i in range(1, n):
        message = links[i - 1] @ forward[i - 1]
        forward[i] *= message / message.sum()
        forward[i] /= forward[i].sum()
    for i in range(n - 2, -1, -1):
        message = links[i].T @ (backward[i + 1] * own[i + 1])
        backward[i] = message / message.sum()
    joint = forward * backward
    return joint / joint.sum(axis=1, keepdims=True)


def choose_inner(candidates: Candidates, bone: Material, centre_mhz: float) -> InnerChoice:
    """Return the most probable candidate of each A-scan, timed by its phase where that is clear."""
    odds = probabilities(candidates, bone.speed_mm_per_us)
    rows, best = np.arange(len(odds)), np.argmax(odds[:, :-1], axis=1)
    lag, phase = candidates.lag_us[rows, best], candidates.phase_rad[rows, best]
    apart_mm = np.abs(candidates.lag_us - lag[:, None]) * bone.speed_mm_per_us / 2.0
    sureness = np.sum(odds[:, :-1] * (apart_mm < SAME_MM), axis=1)
    coherent = lag - phase / (2.0 * np.pi * centre_mhz)
    lag = np.where(np.abs(phase) < COHERENT_RAD, coherent, lag)
    return InnerChoice(lag, np.minimum(sureness, 1.0), np.asarray(odds[:, -1] < 0.5))
