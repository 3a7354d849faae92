"""Simplification of a path: as few of its points as possible within an error bound.

Ramer-Douglas-Peucker simplification: split at the farthest point until the bound holds. Source:
Ramer 1972, Douglas and Peucker 1973; here with the distance from the segment, not from the infinite
line, and all pieces of one depth at a time.

Greedy vertex decimation: the point whose removal deviates least goes first (the paper's way).
Source: Waringo and Henrich, Efficient smoothing of piecewise linear paths with minimal deviation.
"""

import heapq
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.path.simplification.error_bound import (
    ErrorBound,
    ShortcutTest,
    as_path,
    deviations,
    distances_to_segment,
)
from rona_core.path.simplification.shortest_path import (
    FAST_RULE,
    MAX_WORK,
    OPTIMAL_RULE,
    beam_search,
    fewest_points,
    work_estimate,
)

SPLIT_RULE = "split at the farthest point, the first among equals, until the bound holds"


def douglas_peucker(columns: Floats, fixed: Bools, test: ShortcutTest) -> Ints:
    """Return the indices (k,) of the points at which the path was split, ends included.

    Args:
        columns: The path as (m, n), one row per dimension.
        fixed: Mask (n,) of the points that must stay, ends included.
        test: Decides which segments may replace a piece.
    """
    kept = fixed.copy()
    stays = np.flatnonzero(fixed)
    starts, ends = stays[:-1], stays[1:]
    while len(starts):
        broken = ~test.holds(columns, starts, ends)
        starts, ends = starts[broken], ends[broken]
        at = np.array(
            [_farthest(columns, a, b) for a, b in zip(starts, ends, strict=True)], dtype=np.int64
        )
        kept[at] = True
        starts, ends = np.concatenate((starts, at)), np.concatenate((at, ends))
    return np.flatnonzero(kept)


def _farthest(columns: Floats, start: int, end: int) -> int:
    inner = columns[:, start + 1 : end].T
    distances = distances_to_segment(inner, columns[:, start], columns[:, end])
    return start + 1 + int(distances.argmax())


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


SimplifyMethod = Literal["optimal", "fast", "greedy", "rdp"]
METHODS: tuple[SimplifyMethod, ...] = ("optimal", "fast", "greedy", "rdp")
RULES = {"optimal": OPTIMAL_RULE, "fast": FAST_RULE, "greedy": GREEDY_RULE, "rdp": SPLIT_RULE}


@dataclass(frozen=True, slots=True, eq=False)
class SimplifiedPath:
    """Which points of a path are kept, and how far the others are from what is left."""

    index: Ints  # (k,) increasing; first and last point among them
    tolerance: float  # mm, or mm^2 for "k3"
    metric: str
    method: str  # that was used
    n_original: int
    k1_mm: float  # of the worst piece: largest distance of an original point
    k2_mm: float  # of the worst piece: root mean square distance
    k3_mm2: float  # of the worst piece: area between original and segment
    where: int  # index of the original point that is farthest away
    frechet: bool  # K1, or the cap on it, holds in the sense of Fréchet: no stroke is lost
    closed: bool  # always False; files know it from when closed paths were simplified too
    lower_bound: int  # proven: the number of points if exact, else of those that must stay
    exact: bool  # no path within the same bound has fewer points
    rule: str  # what decides which points stay, ties included

    def __len__(self) -> int:
        return len(self.index)


def simplify(
    points: ArrayLike,
    tolerance: float | ErrorBound,
    *,
    method: SimplifyMethod = "optimal",
    keep: ArrayLike | None = None,
) -> SimplifiedPath:
    """Simplify a path: as few of its points as possible, within an error bound in each piece.

    Args:
        points: Path (n, m), any m, in mm.
        tolerance: Largest distance in mm, in the sense of Fréchet; or another ``ErrorBound``.
        method: "optimal": the fewest points; where that would take too long, "fast" is used and
            the result says so. "fast": few points, not surely the fewest. "greedy", the paper's:
            the point of least deviation goes first, until none can. "rdp": Ramer, Douglas and
            Peucker. On a long path "k2" and "k3" without a cap leave "greedy" in place of both
            searches; ``method`` and ``rule`` of the result say so.
        keep: Mask (n,) or indices of points that must stay; the two ends always do.

    Raises:
        InvalidInputError: wrong shape, unknown method, or negative tolerance.
    """
    p = as_path(points)
    bound = tolerance if isinstance(tolerance, ErrorBound) else ErrorBound(tolerance)
    test = bound.shortcut_test(p)
    fixed = as_keep(keep, len(p))
    index, used = chosen_points(p, fixed, test, method)
    exact = used == "optimal"
    found = deviations(p, index)
    return SimplifiedPath(
        index=readonly(index),
        tolerance=test.tolerance,
        metric=test.metric,
        method=used,
        n_original=len(p),
        k1_mm=found.k1_mm,
        k2_mm=found.k2_mm,
        k3_mm2=found.k3_mm2,
        where=found.where,
        frechet=test.bounds_frechet,
        closed=False,
        lower_bound=len(index) if exact else int(fixed.sum()),
        exact=exact,
        rule=_rule(method, used, test),
    )


def chosen_points(
    points: Floats, fixed: Bools, test: ShortcutTest, method: SimplifyMethod
) -> tuple[Ints, SimplifyMethod]:
    """Return the indices (k,) that stay, and the method that was used.

    Raises:
        InvalidInputError: unknown method.
    """
    if method not in METHODS:
        raise InvalidInputError(f"method must be one of {', '.join(METHODS)}, not {method!r}")
    columns = np.ascontiguousarray(points.T)
    used = _feasible(columns, fixed, test, method)
    if used == "optimal":
        return fewest_points(columns, fixed, test), used
    if used == "fast":
        return beam_search(columns, fixed, test), used
    if used == "rdp":
        return douglas_peucker(columns, fixed, test), used
    remaining = np.ones(len(points), dtype=np.bool_)
    remaining[decimation_order(points, fixed, test)[0]] = False
    return np.flatnonzero(remaining), used


def _feasible(
    columns: Floats, fixed: Bools, test: ShortcutTest, method: SimplifyMethod
) -> SimplifyMethod:
    """Return the method that is used where the one that was chosen would take too long.

    "fast" in place of "optimal"; "greedy" where no bound on the distance limits either search.
    """
    searches = method == "optimal" or (method == "fast" and test.near_mm == np.inf)
    if not searches or columns.shape[1] < 3:
        return method
    if work_estimate(columns, fixed, test) <= MAX_WORK:
        return method
    return "greedy" if test.near_mm == np.inf else "fast"


def _rule(chosen: SimplifyMethod, used: SimplifyMethod, test: ShortcutTest) -> str:
    """Return what decides which points stay, and why another method than the chosen one does."""
    if used == "greedy" != chosen:
        return (
            f"{RULES[used]}; greedy in place of {chosen}, since {test.metric} bounds no distance "
            "and a search would compare every piece of so long a path"
        )
    return RULES[used]
