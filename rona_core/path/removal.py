"""Remove path points one by one, always the one whose removal deviates least (the paper's way).

Source: Waringo and Henrich, Efficient smoothing of piecewise linear paths with minimal deviation.
"""

import heapq
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.arrays import Bools, Floats, Ints, readonly
from rona_core.errors import InvalidInputError
from rona_core.path.deviation import Metric, as_metric, as_path
from rona_core.path.segment import distances_to_segment, feet_on_segment, strip_areas


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


def removal_order(
    points: ArrayLike,
    metric: Metric = "k1",
    *,
    keep: ArrayLike | None = None,
    tolerance: float = np.inf,
) -> RemovalOrder:
    """Return the order in which points go while the cheapest removal stays within ``tolerance``.

    The cost of a removal is the deviation of the originals between the two neighbours that are
    still there from the segment between these. Ties go to the shorter gap between the neighbours
    (counted in originals), then to the smaller index.

    Args:
        points: Path (n, m), any m.
        metric: "k1" largest distance, "k2" root mean square, "k3" area.
        keep: Mask (n,) or indices of points that must stay; the two ends always do.
        tolerance: Bound on each cost, in mm, or mm^2 for "k3".

    Raises:
        InvalidInputError: wrong shape, metric or tolerance.
    """
    p, metric = as_path(points), as_metric(metric)
    if not tolerance >= 0:
        raise InvalidInputError(f"tolerance must be 0 or more, not {tolerance}")
    n = len(p)
    fixed = as_keep(keep, n)
    left, right = np.arange(n) - 1, np.arange(n) + 1
    version = np.zeros(n, dtype=np.int64)
    heap: list[tuple[float, int, int, int]] = []

    def offer(i: int) -> None:
        if not fixed[i]:
            a, b = int(left[i]), int(right[i])
            entry = (piece_cost(p[a : b + 1], metric), b - a, i, int(version[i]))
            heapq.heappush(heap, entry)

    for i in range(n):
        offer(i)
    order: list[int] = []
    costs: list[float] = []
    while heap:
        cost, _, i, made = heapq.heappop(heap)
        if made != version[i]:
            continue  # a neighbour has gone since
        if cost > tolerance:
            break  # the cheapest is too dear, so all are
        order.append(i)
        costs.append(cost)
        a, b = int(left[i]), int(right[i])
        right[a], left[b], version[i] = b, a, -1
        for j in (a, b):
            version[j] += 1
            offer(j)
    return RemovalOrder(
        index=readonly(np.array(order, dtype=np.int64)),
        cost=readonly(np.array(costs, dtype=np.float64)),
        metric=metric,
        n_original=n,
    )


def piece_cost(piece: Floats, metric: Metric) -> float:
    """Return the deviation of the originals ``piece`` (k, m) from the segment between its ends."""
    if metric == "k3":
        return float(strip_areas(piece, feet_on_segment(piece, piece[0], piece[-1])).sum())
    distances = distances_to_segment(piece[1:-1], piece[0], piece[-1])
    if metric == "k1":
        return float(distances.max(initial=0.0))
    return float(np.sqrt((distances**2).sum() / len(piece)))


def as_keep(keep: ArrayLike | None, n: int) -> Bools:
    """Return a mask (n,) of the points that must stay, from a mask, indices or None.

    Raises:
        InvalidInputError: a mask of another length, or indices out of range.
    """
    fixed = np.zeros(n, dtype=np.bool_)
    fixed[[0, -1]] = True
    if keep is None:
        return fixed
    wanted = np.asarray(keep)
    if wanted.dtype == np.bool_ and wanted.shape == (n,):
        return fixed | wanted
    if wanted.size == 0:
        return fixed
    whole = wanted.ndim == 1 and np.issubdtype(wanted.dtype, np.integer)
    if not whole or wanted.min() < 0 or wanted.max() >= n:
        raise InvalidInputError(f"keep must be a mask of {n} points or indices 0 to {n - 1}")
    fixed[wanted] = True
    return fixed
