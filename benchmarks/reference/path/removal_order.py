"""Greedy removal of path points to the very end: all removable points in the order they go."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, Ints, readonly
from rona_core.path.simplification.error_bound import (
    Metric,
    ShortcutTest,
    as_metric,
    as_path,
    rounding_of,
)
from rona_core.path.simplification.simplify import as_keep, decimation_order


@dataclass(frozen=True, slots=True, eq=False)
class RemovalOrder:
    """All removable points in the order they go, so that any count or bound can be cut off it."""

    index: Ints  # (r,) original index of the point removed at each step
    cost: Floats  # (r,) deviation of the piece that its removal leaves; may also fall
    metric: str
    n_original: int

    def kept(self, n_removed: int) -> Ints:
        """Return the indices (k,) that are left after the first ``n_removed`` removals."""
        left = np.ones(self.n_original, dtype=np.bool_)
        left[self.index[:n_removed]] = False
        return np.flatnonzero(left)

    def kept_within(self, tolerance: float) -> Ints:
        """Return the indices (k,) left when the first removal above ``tolerance`` comes up."""
        above = np.flatnonzero(self.cost > tolerance)
        return self.kept(int(above[0]) if len(above) else len(self.index))


def removal_order(
    points: ArrayLike,
    metric: Metric = "k1",
    *,
    keep: ArrayLike | None = None,
    tolerance: float = np.inf,
    frechet_mm: float | None = None,
) -> RemovalOrder:
    """Return the order in which points go while the cheapest removal stays within ``tolerance``.

    The cost of a removal is the deviation of the originals between the two neighbours that are
    still there from the segment between these. Ties go to the shorter gap between the neighbours
    (counted in originals), then to the smaller index; what rounding makes of a straight path is
    a tie at 0.

    Args:
        points: Path (n, m), any m.
        metric: "k1" largest distance, "k2" root mean square, "k3" area.
        keep: Mask (n,) or indices of points that must stay; the two ends always do.
        tolerance: Bound on each cost, in mm, or mm^2 for "k3".
        frechet_mm: A point only goes while the piece it leaves is within this distance of its
            segment in the sense of Fréchet; None, as in the paper, does not ask.

    Raises:
        InvalidInputError: wrong shape, metric or tolerance.
    """
    p, metric = as_path(points), as_metric(metric)
    if not tolerance >= 0:
        raise InvalidInputError(f"tolerance must be 0 or more, not {tolerance}")
    near = np.inf if frechet_mm is None else frechet_mm
    if not near >= 0:
        raise InvalidInputError(f"frechet_mm must be 0 or more, not {frechet_mm}")
    bound = ShortcutTest(metric, tolerance, near, frechet_mm is not None, rounding_of(p, metric))
    index, cost = decimation_order(p, as_keep(keep, len(p)), bound)
    return RemovalOrder(readonly(index), readonly(cost), metric, len(p))
