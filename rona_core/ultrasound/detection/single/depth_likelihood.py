"""Likelihood ratio of an inner boundary at each depth, from one A-scan (Rice over Rayleigh)."""

import numpy as np
from scipy.special import i0e

from rona_core.geometry.arrays import Floats

STEP_MM = 0.1  # of the grid of depths
LEVELS = (0.05, 0.1, 0.2, 0.4, 0.8)  # of the echo over a nominal one, each as likely
CLUTTER = {"2.25MHz": 0.1, "1MHz": 0.2}  # what bone shows besides, over a nominal inner echo
MOST = 4.0  # log likelihood ratio that a single A-scan can have
ABSENT = 0.6  # share of A-scans in which the echo may be missing, tilted away


def depth_grid(low_mm: float, high_mm: float) -> Floats:
    """Return the depths (m,) between which the thickness is sought."""
    count = int(np.ceil((high_mm - low_mm) / STEP_MM)) + 1
    return low_mm + STEP_MM * np.arange(count, dtype=np.float64)


def depth_log_likelihood(
    level: Floats, noise: Floats, gain: Floats, lags_us: Floats, wanted_us: Floats, clutter: float
) -> tuple[Floats, Floats]:
    """Return log likelihood ratios (n, m) of an inner echo at given lags against none there.

    Args:
        level: Envelopes (n, lags) behind the bank of templates.
        noise: RMS of the noise on the same scale (n,).
        gain: What turns that scale into levels over a nominal echo (lags,).
        lags_us: Even steps of time (lags,).
        wanted_us: Within those (m,).
        clutter: RMS of the clutter over a nominal echo.

    With them comes the level over the noise (n, m).
    """
    at = (wanted_us - lags_us[0]) / (lags_us[1] - lags_us[0])
    low = np.clip(np.floor(at).astype(np.int64), 0, len(lags_us) - 2)
    share = np.clip(at - low, 0.0, 1.0)
    observed = (1.0 - share) * level[:, low] + share * level[:, low + 1]
    scale = (1.0 - share) * gain[low] + share * gain[low + 1]
    spread = np.sqrt(np.maximum(noise[:, None], 1e-12) ** 2 + (clutter / scale) ** 2)
    ratio = np.zeros(observed.shape)
    for over_nominal in LEVELS:
        echo = over_nominal / scale / spread
        x = 2.0 * echo * observed / spread
        # Rice over Rayleigh: I0(x) exp(-echo^2), with I0(x) = i0e(x) exp(x)
        ratio += i0e(x) * np.exp(np.clip(x - echo**2, -50.0, 50.0)) / len(LEVELS)
    log_ratio = np.log(ABSENT + (1.0 - ABSENT) * np.minimum(ratio, np.exp(MOST)))
    return log_ratio, observed / np.maximum(noise[:, None], 1e-12)
