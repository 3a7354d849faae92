"""Simplification of a path: as few of its points as possible within an error bound."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.path.simplification.beam_search import FAST_RULE, beam_search
from rona_core.path.simplification.deviation import as_path, deviations
from rona_core.path.simplification.douglas_peucker import SPLIT_RULE, douglas_peucker
from rona_core.path.simplification.error_bound import ErrorBound, ShortcutTest
from rona_core.path.simplification.shortest_path import (
    MAX_WORK,
    OPTIMAL_RULE,
    fewest_points,
    work_estimate,
)
from rona_core.path.simplification.vertex_decimation import GREEDY_RULE, as_keep, decimation_order

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
