"""Errors beside the standard deviations that were predicted for them, and how well they agree.

An honest prediction has a mean squared ratio of error to sigma of 1, and 95 % of the errors within
1.96 sigma. Both can be had by one sigma for everything; a sigma that differs from place to place
must be larger where the errors are, which the rank correlation tells.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.stats import binom, chi2, spearmanr

from benchmarks.metric import Metric
from rona_core.geometry.arrays import Floats

# common: one error for a whole session (one sample a seed, or a vector along its principal axes);
# local: what differs from place to place; whole: both together at single places
Part = Literal["common", "local", "whole"]

RATIO_GOAL = (0.75, 1.35)
BAND_GOAL = (0.90, 0.98)
HELD = 0.95  # of normal errors
RANK_GOAL = 0.3  # where sigmas spread enough for it
BAND = 1.96  # standard deviations that hold 95 % of a normal distribution
DRAWS = 2000  # of the bootstrap over seeds
INTERVAL = (0.025, 0.975)
MIN_SIGMA = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """Errors of one quantity in one session, and the sigmas that the session predicted for them."""

    quantity: str  # with its unit, "thickness of A-scans (mm)"
    part: Part
    seed: int
    errors: Floats  # (n,) found minus true
    sigmas: Floats  # (n,) predicted standard deviations, same unit
    varies: bool = False  # the sigma claims to tell good places from bad ones


@dataclass(frozen=True, slots=True)
class Statistic:
    """A figure over seeds with its 95 % interval, found by drawing seeds with replacement."""

    value: float | None  # None where no seed has it
    low: float | None
    high: float | None


@dataclass(frozen=True, slots=True)
class Honesty:
    """How well the predictions of one quantity hold over seeds."""

    quantity: str
    part: Part
    seeds: int
    samples: int
    rms_error: float
    rms_sigma: float
    ratio: Statistic  # mean of (error / sigma)^2, every seed counting the same
    band: Statistic  # share of errors within 1.96 sigma, every seed counting the same
    rank: Statistic | None  # Spearman of sigma and |error| within a seed; None: sigma is one
    drawn_rank: float | None = None  # the same of errors that are drawn with these sigmas


def principal_parts(error: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    """Return an error vector (k,) along the axes of its covariance (k, k), and the sigmas there.

    The squared ratios of these add up to the squared Mahalanobis distance.
    """
    values, axes = np.linalg.eigh(covariance)
    return axes.T @ error, np.sqrt(np.maximum(values, 0.0))


def honesty(samples: Sequence[Judged]) -> Honesty:
    """Return the statistics of one quantity, from one or more ``Judged`` a seed."""
    by_seed: dict[int, list[Judged]] = {}
    for one in samples:
        if len(one.errors):
            by_seed.setdefault(one.seed, []).append(one)
    errors = [np.concatenate([one.errors for one in group]) for group in by_seed.values()]
    sigmas = [np.concatenate([one.sigmas for one in group]) for group in by_seed.values()]
    ratios = [e / np.maximum(s, MIN_SIGMA) for e, s in zip(errors, sigmas, strict=True)]
    rank, drawn_rank = None, None
    if any(one.varies for one in samples):
        rank = over_draws([rank_correlation(e, s) for e, s in zip(errors, sigmas, strict=True)])
        random = np.random.default_rng(0)
        drawn_rank = over_draws(
            [rank_correlation(s * random.normal(size=len(s)), s) for s in sigmas]
        ).value
    return Honesty(
        quantity=samples[0].quantity,
        part=samples[0].part,
        seeds=len(by_seed),
        samples=sum(map(len, errors)),
        rms_error=_rms(errors),
        rms_sigma=_rms(sigmas),
        ratio=over_draws([float((r**2).mean()) for r in ratios]),
        band=over_draws([float((np.abs(r) <= BAND).mean()) for r in ratios]),
        rank=rank,
        drawn_rank=drawn_rank,
    )


def over_draws(values: Sequence[float]) -> Statistic:
    """Return the mean of one value a seed, and where it lies in 95 % of draws of seeds."""
    known = np.array([value for value in values if np.isfinite(value)])
    if not len(known):
        return Statistic(None, None, None)
    rows = np.random.default_rng(0).integers(len(known), size=(DRAWS, len(known)))
    low, high = np.quantile(known[rows].mean(axis=1), INTERVAL)
    return Statistic(float(known.mean()), float(low), float(high))


def rank_correlation(errors: Floats, sigmas: Floats) -> float:
    """Return Spearman's correlation of sigma and |error|; NaN where one of them never changes."""
    if len(errors) < 3 or np.ptp(sigmas) == 0.0 or np.ptp(np.abs(errors)) == 0.0:
        return float("nan")
    return float(np.asarray(spearmanr(np.abs(errors), sigmas))[0])


def grouped(samples: Sequence[Judged]) -> Mapping[tuple[str, Part], list[Judged]]:
    """Return the samples by quantity and part, in the order in which they first occur."""
    groups: dict[tuple[str, Part], list[Judged]] = {}
    for one in samples:
        groups.setdefault((one.quantity, one.part), []).append(one)
    return groups


def rank_goal(found: Honesty) -> float:
    """Return the rank correlation asked for: what normal errors of these sigmas have, if less."""
    drawn = found.drawn_rank
    return RANK_GOAL if drawn is None else min(RANK_GOAL, drawn)


def ratio_goal(found: Honesty, goal: tuple[float, float] = RATIO_GOAL) -> tuple[float, float]:
    """Return the bounds of the mean squared ratio.

    Where so few numbers cannot tell, they are those that honest sigmas keep in 95 % of studies of
    this size.
    """
    n = _numbers(found)
    if not n:
        return goal
    least, most = chi2.ppf(INTERVAL, n) / n
    return min(goal[0], float(least)), max(goal[1], float(most))


def band_goal(found: Honesty) -> tuple[float, float]:
    """Return the bounds of the share of errors within 1.96 sigma, as `ratio_goal` does."""
    n = _numbers(found)
    if not n:
        return BAND_GOAL
    least, most = binom.ppf(INTERVAL, n, HELD) / n
    return min(BAND_GOAL[0], float(least)), max(BAND_GOAL[1], float(most))


def _numbers(found: Honesty) -> int:
    """Return how many independent numbers are judged; 0: as many as there are places.

    A common part is a few numbers a session, and what is whole has that part in it.
    """
    return {"common": found.samples, "whole": found.seeds, "local": 0}[found.part]


def rows(found: Honesty, ratio: tuple[float, float] = RATIO_GOAL) -> list[Metric]:
    """Return the figures of one quantity with their goals, and the interval of each.

    Args:
        found: The statistics.
        ratio: Bounds that are asked of the mean squared ratio.
    """
    name = f"{found.quantity}, {found.part}"
    metrics = [
        *_between(f"{name}: mean squared ratio", found.ratio, ratio_goal(found, ratio)),
        *_between(f"{name}: within the 95 % band", found.band, band_goal(found)),
    ]
    if found.rank is not None:
        goal = f"{name}: rank correlation"
        metrics += [
            Metric(goal, found.rank.value, "", "higher", rank_goal(found)),
            *_ends(goal, found.rank),
        ]
    return [*metrics, Metric(f"{name}: seeds", float(found.seeds), "", "higher")]


def _between(name: str, statistic: Statistic, goal: tuple[float, float]) -> list[Metric]:
    return [
        Metric(name, statistic.value, "", "higher", goal[0]),
        Metric(f"{name}, not more", statistic.value, "", "lower", goal[1]),
        *_ends(name, statistic),
    ]


def _ends(name: str, statistic: Statistic) -> list[Metric]:
    """Return the 95 % interval over seeds, without a goal."""
    return [
        Metric(f"{name}, 95 % sure above", statistic.low, "", "higher"),
        Metric(f"{name}, 95 % sure below", statistic.high, "", "lower"),
    ]


def _rms(parts: Sequence[Floats]) -> float:
    """Return the RMS over seeds of the RMS within each."""
    return float(np.sqrt(np.mean([(part**2).mean() for part in parts]))) if parts else float("nan")
