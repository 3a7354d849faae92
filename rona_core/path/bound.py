"""What a piece of a path must fulfil so that a segment may replace it."""

from dataclasses import dataclass

import numpy as np

from rona_core.arrays import Bools, Floats, Ints
from rona_core.path.frechet import pieces_within
from rona_core.path.segment import Metric, piece_costs

ROUNDING = 16.0 * np.finfo(np.float64).eps  # of the largest coordinate: deviations below are none


def rounding_of(points: Floats, metric: Metric) -> float:
    """Return the deviation that rounding of the coordinates makes of a straight path."""
    size = float(np.abs(points).max())
    return ROUNDING * size * (size if metric == "k3" else 1.0)


@dataclass(frozen=True, slots=True)
class Bound:
    """A bound on one measure, and on the distance; Fréchet keeps strokes that run back."""

    metric: Metric
    tolerance: float  # mm, or mm^2 for "k3"
    near_mm: float  # bound on the distance; the tolerance for "k1", infinite for none
    frechet: bool  # the distance in the sense of Fréchet, not only K1
    rounding: float  # deviations up to it are none, see :func:`rounding_of`

    @property
    def walks(self) -> bool:
        """Whether the distance is bounded in the sense of Fréchet."""
        return self.frechet and self.near_mm < np.inf

    def costs(self, columns: Floats, starts: Ints, ends: Ints) -> Floats:
        """Return the measure (q,) of each piece; what rounding makes of a straight one is 0."""
        costs = piece_costs(columns, starts, ends, self.metric)
        costs[costs <= self.rounding] = 0.0
        return costs

    def allows(self, columns: Floats, starts: Ints, ends: Ints) -> Bools:
        """Return for each piece (q,) whether its distance is within the bound."""
        if self.walks:
            return pieces_within(columns, starts, ends, self.near_mm)
        if self.near_mm < np.inf:
            return piece_costs(columns, starts, ends, "k1") <= self.near_mm
        return np.ones(len(starts), dtype=np.bool_)

    def holds(self, columns: Floats, starts: Ints, ends: Ints) -> Bools:
        """Return for each piece (q,) whether a segment may replace it."""
        good = self.allows(columns, starts, ends)
        if self.metric != "k1":
            some = np.flatnonzero(good)
            good[some] = self.costs(columns, starts[some], ends[some]) <= self.tolerance
        good[ends - starts == 1] = True
        return good
