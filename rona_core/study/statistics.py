"""What the rows of a study say together: quantiles, shares, sensitivity and calibration.

Every number has its interval of 95 %, without an assumption on how the figures are distributed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from rona_core.app.declarations.figures import FIGURES, Figure
from rona_core.app.overview.acceptance import verdict
from rona_core.app.overview.bed_risk import CONFIDENCE, interval
from rona_core.geometry.arrays import Floats
from rona_core.study.patient import Row
from rona_core.study.plan import Plan, Range, number
from rona_core.study.study import is_failure

FEWEST = 10  # patients, below which neither sensitivity nor calibration is stated
RESAMPLES = 999
BANDS = 3
GOOD_COVERAGE = 0.95


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number and its interval of 95 %; a bound is None where the patients are too few for it."""

    value: float
    low: float | None
    high: float | None


@dataclass(frozen=True, slots=True)
class Share:
    """So many of so many patients, and the interval of Clopper and Pearson."""

    title: str
    count: int
    of: int

    @property
    def estimate(self) -> Estimate:
        """The share of one."""
        return Estimate(self.count / self.of, *interval(self.count, self.of))


@dataclass(frozen=True, slots=True)
class Effect:
    """How much of the ranks of a figure follows from one factor, and how likely by chance."""

    factor: str
    figure: Figure
    share: float  # of the variance of the ranks
    p: float
    medians: tuple[tuple[str, float], ...]  # level -> median; of a range its lower and upper half


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """A predicted sigma against the truth.

    ``ratios`` (n,) are truth over prediction, sorted; ``bands`` the RMS of prediction and truth
    in each third of the predictions.
    """

    figure: Figure
    ratios: Floats
    square: Estimate  # mean of the squared ratios, 1 where the sigma is honest
    bands: tuple[tuple[float, float], ...]


def values(rows: Sequence[Row], key: str) -> Floats:
    """Return the numbers that rows have for a figure (n,); those without one are left out."""
    known = [number(row.get(key)) for row in rows]
    return np.array([value for value in known if value is not None])


def quantile(sample: Floats, p: float) -> Estimate:
    """Return a quantile, with bounds that are order statistics (binomial).

    Args:
        sample: Values (n,), n >= 1.
        p: Of the quantile, between 0 and 1.
    """
    bounds = stats.quantile_test(sample, p=p).confidence_interval(CONFIDENCE)
    low, high = (float(x) if np.isfinite(x) else None for x in (bounds.low, bounds.high))
    return Estimate(float(np.quantile(sample, p)), low, high)


def worst(sample: Floats, figure: Figure) -> float:
    """Return the worst value of a figure in a sample (n,), n >= 1."""
    return float(sample[np.abs(sample).argmax()] if figure.sense == "at most" else sample.min())


def beyond_limit(rows: Sequence[Row], figure: Figure) -> Share | None:
    """Return how many patients miss the limit of a figure; None without limit or value."""
    known = values(rows, figure.key)
    if figure.limit is None or not known.size:
        return None
    missed = sum(verdict(float(x), figure.limit, figure.sense) != "pass" for x in known)
    return Share(figure.title, missed, len(known))


def shares(plan: Plan, rows: Sequence[Row]) -> list[Share]:
    """Return the shares of all patients that a study is asked for, as far as its stages go."""
    going = {stage.name for stage in plan.stages}
    asked = [("Failed: not to the end of the procedure", [is_failure(row) for row in rows])]
    if "maps" in going:
        inner = [number(row.get("inner_coverage_fraction")) or 0.0 for row in rows]
        outer = [number(row.get("coverage_fraction")) or 0.0 for row in rows]
        whole = [min(pair) >= GOOD_COVERAGE for pair in zip(inner, outer, strict=True)]
        asked += [
            ("No inner map", [share == 0.0 for share in inner]),
            (f"Both maps cover at least {GOOD_COVERAGE:.0%} of the region", whole),
        ]
    if "implant" in going:
        asked += [("No safe bed", [not has_bed(row) for row in rows])]
    broken = [any(_is_beyond(row, figure) for figure in FIGURES.values()) for row in rows]
    asked += [("A limit of any figure broken", broken)]
    return [Share(title, sum(held), len(held)) for title, held in asked if held]


def has_bed(row: Row) -> bool:
    """Return whether a safe bed was found."""
    return row.get("bed_reason") is None and number(row.get("bed_probability")) is not None


def _is_beyond(row: Row, figure: Figure) -> bool:
    found = beyond_limit([row], figure)
    return found is not None and found.count > 0


# ------------------------------------------------------------------ sensitivity


def effects(plan: Plan, rows: Sequence[Row]) -> tuple[list[Effect], int]:
    """Return which factors the judged figures depend on, most first, and how many pairs were tried.

    A factor of numbers by Spearman's rank correlation, another one by Kruskal and Wallis: both
    state the share of the variance of the ranks. Kept is what stays under 5 % for all pairs
    together (Bonferroni).
    """
    judged = [figure for figure in FIGURES.values() if figure.limit is not None]
    found = [_effect(plan, rows, factor, figure) for factor in plan.varied for figure in judged]
    tried = [one for one in found if one is not None]
    kept = [one for one in tried if one.p < (1.0 - CONFIDENCE) / len(tried)]
    return sorted(kept, key=lambda one: -one.share), len(tried)


def _effect(plan: Plan, rows: Sequence[Row], factor: str, figure: Figure) -> Effect | None:
    pairs: list[tuple[Any, float]] = [
        (row.get(factor), value)
        for row in rows
        if (value := number(row.get(figure.key))) is not None
    ]
    sample = np.array([value for _, value in pairs])
    if len(pairs) < FEWEST or np.ptp(sample) == 0.0:
        return None
    of = plan.factors[factor]
    numeric = isinstance(of, Range) or all(number(level) is not None for level in of)
    if numeric and (isinstance(of, Range) or len(of) > 2):
        levels = np.array([float(level) for level, _ in pairs])
        if np.ptp(levels) == 0.0:
            return None
        found: Any = stats.spearmanr(levels, sample)
        middle = float(np.median(levels))
        groups = {f"up to {middle:.3g}": sample[levels <= middle]}
        groups[f"above {middle:.3g}"] = sample[levels > middle]
        share, p = float(found.statistic) ** 2, float(found.pvalue)
    else:
        names = np.array([str(level) for level, _ in pairs])
        groups = {name: sample[names == name] for name in dict.fromkeys(names.tolist())}
        if len(groups) < 2:
            return None
        found = stats.kruskal(*groups.values())
        share, p = float(found.statistic) / (len(sample) - 1), float(found.pvalue)
    medians = tuple((name, float(np.median(part))) for name, part in groups.items() if part.size)
    return Effect(factor, figure, share, p, medians)


# ------------------------------------------------------------------ calibration


def calibrations(rows: Sequence[Row]) -> list[Calibration]:
    """Return every predicted sigma beside its truth."""
    predicted = [figure for figure in FIGURES.values() if "sigma" in figure.truth_of]
    found = [_calibration(rows, figure) for figure in predicted]
    return [one for one in found if one is not None]


def _calibration(rows: Sequence[Row], figure: Figure) -> Calibration | None:
    pairs = [(number(row.get(figure.truth_of)), number(row.get(figure.key))) for row in rows]
    known = np.array([(p, t) for p, t in pairs if p is not None and t is not None and p > 0.0])
    if len(known) < FEWEST:
        return None
    sigma, truth = known[:, 0], np.abs(known[:, 1])
    squares = (truth / sigma) ** 2
    interval = stats.bootstrap(
        (squares,), np.mean, n_resamples=RESAMPLES, method="percentile", rng=0
    ).confidence_interval
    square = Estimate(float(squares.mean()), float(interval.low), float(interval.high))
    order = np.argsort(sigma, kind="stable")
    bands = tuple((_rms(sigma[part]), _rms(truth[part])) for part in np.array_split(order, BANDS))
    return Calibration(figure, np.sort(truth / sigma), square, bands)


def _rms(sample: Any) -> float:
    return float(np.sqrt(np.mean(np.square(sample))))
