"""Greedy vertex decimation: the point whose removal deviates least goes first (the paper's way).

Source: Waringo and Henrich, Efficient smoothing of piecewise linear paths with minimal deviation.
"""

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.path.simplification.batch_decimation import decimate
from rona_core.path.simplification.error_bound import ShortcutTest

GREEDY_RULE = "least deviation first, then shorter gap between neighbours, then smaller index"


def decimation_order(points: Floats, fixed: Bools, test: ShortcutTest) -> tuple[Ints, Floats]:
    """Return the points that may go within the error bound, in order, and what each cost."""
    columns = np.ascontiguousarray(points.T)

    def costs(starts: Ints, ends: Ints) -> Floats:
        return test.costs(columns, starts, ends)

    def allowed(starts: Ints, ends: Ints) -> Bools:
        return test.allows(columns, starts, ends)

    asks = test.bounds_frechet or (test.metric != "k1" and test.near_mm < np.inf)
    return decimate(fixed, costs, allowed if asks else None, test.tolerance)


def as_keep(keep: ArrayLike | None, n: int, *, ends: bool = True) -> Bools:
    """Return a mask (n,) of the points that must stay, from a mask, indices or None.

    Raises:
        InvalidInputError: a mask of another length, or indices out of range.
    """
    fixed = np.zeros(n, dtype=np.bool_)
    fixed[[0, -1]] = ends
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
