"""Cycle slips: the chance that the time of an inner echo is a whole cycle off.

Neighbours that slipped, too, hold an echo at the wrong cycle; its own evidence decides: where
the time is right, the cycle before and the one behind explain the echo far worse.
"""

import numpy as np

from rona_core.geometry.arrays import Bools, Floats

SAME_CYCLES = 0.3  # within which a time counts as the one that was found
OTHER_CYCLES = 0.6, 1.3  # how far off the cycle before and the one behind lie
# odds of a slip where another cycle explains the echo as well, for a sigma of one cycle; a wide
# first fit has more slips. 3.4 % of the sure A-scans slip on the seeds 21000 to 21023
SLIP_ODDS = 0.3
EVIDENCE = 0.5  # what a log likelihood ratio counts: the clutter of two cycles is the same
LEAST_RATIO, MOST_RATIO = -12.0, 6.0  # further out a ratio adds no evidence


def slip_chances(
    log_likelihood: Floats,
    offsets_us: Floats,
    found_us: Floats,
    first_sigma_us: Floats,
    period_us: float,
) -> Floats:
    """Return the chance (n,) that a time is a whole cycle off.

    Args:
        log_likelihood: Of every A-scan by itself, at each offset (n, t).
        offsets_us: From the start time (t,).
        found_us: Offset of the time that was found (n,).
        first_sigma_us: Sigma of the start time (n,).
        period_us: Length of a cycle.
    """
    away = np.abs(offsets_us - found_us[:, None]) / period_us
    here = _best(log_likelihood, away <= SAME_CYCLES)
    low, high = OTHER_CYCLES
    other = _best(log_likelihood, (away >= low) & (away <= high))
    ratio = np.clip(other - here, LEAST_RATIO, MOST_RATIO)
    odds = SLIP_ODDS * first_sigma_us / period_us * np.exp(EVIDENCE * ratio)
    return odds / (1.0 + odds)


def _best(log_likelihood: Floats, which: Bools) -> Floats:
    return np.where(which, log_likelihood, -np.inf).max(axis=1)
