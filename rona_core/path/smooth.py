"""Smooth a demonstrated path: as few points as possible within a bound of the original."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from rona_core.arrays import Ints, readonly
from rona_core.devices.protocols import never
from rona_core.errors import InvalidInputError
from rona_core.path.deviation import Metric, as_metric, as_path, deviations
from rona_core.path.optimal import fewest_points
from rona_core.path.removal import as_keep, removal_order

SimplifyMethod = Literal["greedy", "optimal"]
METHODS: tuple[SimplifyMethod, ...] = ("greedy", "optimal")


@dataclass(frozen=True, slots=True, eq=False)
class SimplifiedPath:
    """Which points of a path are kept, and how far the others are from what is left."""

    index: Ints  # (k,) increasing, first and last point among them
    tolerance: float  # mm, or mm^2 for "k3"
    metric: str
    method: str
    n_original: int
    k1_mm: float  # of the worst piece: largest distance of an original point
    k2_mm: float  # of the worst piece: root mean square distance
    k3_mm2: float  # of the worst piece: area between original and segment
    where: int  # index of the original point that is farthest away

    def __len__(self) -> int:
        return len(self.index)


def simplify(
    points: ArrayLike,
    tolerance: float,
    *,
    method: SimplifyMethod = "greedy",
    metric: Metric = "k1",
    keep: ArrayLike | None = None,
    cancel: Callable[[], bool] | None = None,
) -> SimplifiedPath:
    """Return a path of fewer points that stays within ``tolerance`` of the original in each piece.

    Args:
        points: Path (n, m), any m, in mm.
        tolerance: Bound in mm, or mm^2 for "k3"; only "k1" bounds the distance itself.
        method: "greedy", the paper's: the point of least deviation goes first, until none can.
            "optimal": the fewest points that K1 and Fréchet allow, only for "k1".
        metric: "k1" largest distance, "k2" root mean square, "k3" area.
        keep: Mask (n,) or indices of points that must stay; the two ends always do.
        cancel: Asked now and then by "optimal"; True gives up.

    Raises:
        InvalidInputError: wrong shape, unknown method or metric, negative tolerance.
        CancelledError: ``cancel`` said so.
    """
    p, metric = as_path(points), as_metric(metric)
    if method not in METHODS:
        raise InvalidInputError(f"method must be one of {', '.join(METHODS)}, not {method!r}")
    if not 0.0 <= tolerance < np.inf:
        raise InvalidInputError(f"tolerance must be 0 or more, not {tolerance}")
    if method == "optimal":
        if metric != "k1":
            raise InvalidInputError(f"method optimal knows only the metric k1, not {metric}")
        fixed = as_keep(keep, len(p))
        index = fewest_points(p, tolerance, fixed, cancel=cancel or never)
    else:
        order = removal_order(p, metric, keep=keep, tolerance=tolerance)
        index = order.kept(len(order.index))
    found = deviations(p, index)
    return SimplifiedPath(
        index=readonly(index),
        tolerance=float(tolerance),
        metric=metric,
        method=method,
        n_original=len(p),
        k1_mm=found.k1_mm,
        k2_mm=found.k2_mm,
        k3_mm2=found.k3_mm2,
        where=found.where,
    )
