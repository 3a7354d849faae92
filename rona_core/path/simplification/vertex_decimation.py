"""Greedy vertex decimation: the point whose removal deviates least goes first (the paper's way).

Source: Waringo and Henrich, Efficient smoothing of piecewise linear paths with minimal deviation.
"""

import heapq

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.path.simplification.error_bound import ShortcutTest

GREEDY_RULE = "least deviation first, then shorter gap between neighbours, then smaller index"


def decimation_order(points: Floats, fixed: Bools, test: ShortcutTest) -> tuple[Ints, Floats]:
    """Return the points that may go within the error bound, in order, and what each cost.

    A removal changes the costs of its two neighbours alone. A point whose piece would not be
    within the bound on the distance waits until its neighbours change.

    Args:
        points: Path (n, m).
        fixed: Mask (n,) of the points that must stay, ends included.
        test: Costs of pieces, and whether a segment may replace them.
    """
    columns = np.ascontiguousarray(points.T)
    left, right = list(range(-1, len(points) - 1)), list(range(1, len(points) + 1))
    stays, costs = fixed.tolist(), [np.inf] * len(points)
    heap: list[tuple[float, int, int]] = []  # cost, gap between the neighbours, index

    def evaluate(touched: Ints) -> None:
        starts = np.array([left[i] for i in touched], dtype=np.int64)
        ends = np.array([right[i] for i in touched], dtype=np.int64)
        found = test.costs(columns, starts, ends).tolist()
        for i, cost in zip(touched.tolist(), found, strict=True):
            costs[i] = cost
            if cost <= test.tolerance:
                heapq.heappush(heap, (cost, right[i] - left[i], i))

    evaluate(np.flatnonzero(~fixed))
    order: list[int] = []
    paid: list[float] = []
    while heap:
        cost, gap, i = heapq.heappop(heap)
        a, b = left[i], right[i]
        if (costs[i], b - a) != (cost, gap):
            continue  # its neighbours have changed since
        costs[i] = np.inf
        if not test.allows(columns, np.array([a]), np.array([b]))[0]:
            continue
        order.append(i)
        paid.append(cost)
        right[a], left[b] = b, a
        evaluate(np.array([j for j in (a, b) if not stays[j]], dtype=np.int64))
    return np.array(order, dtype=np.int64), np.array(paid)


def as_keep(keep: ArrayLike | None, n: int) -> Bools:
    """Return a mask (n,) of the points that must stay: both ends, and a mask or indices.

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
