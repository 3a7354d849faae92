"""Simplify a path of positions and orientations, with a bound on each.

Millimetres and degrees never meet in one norm: each deviation is divided by its own bound, and the
larger of the two counts.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.reference.path.lower_bound import points_lower_bound
from benchmarks.reference.path.pose_path_angles import piece_turns
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints, as_floats, as_points, readonly
from rona_core.path.simplification.error_bound import ShortcutTest, deviations, rounding_of
from rona_core.path.simplification.simplify import RULES, SimplifyMethod, as_keep, chosen_points

UNIT_TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class SimplifiedPoses:
    """Which poses of a path are kept, and how far the others are from what is left."""

    index: Ints  # (k,) increasing, first and last pose among them
    tolerance_mm: float
    tolerance_deg: float
    method: str  # that was used
    n_original: int
    k1_mm: float  # largest distance of an original from its segment
    turn_deg: float  # largest angle to the orientation at the foot of an original
    where: int  # index of the original that is farthest away
    where_turn: int  # index of the kept pose that begins the piece of the largest angle
    frechet: bool  # the distance holds in the sense of Fréchet
    lower_bound: int  # no path within the same bounds has fewer poses
    exact: bool  # this one has as few as that
    rule: str  # what decides which poses stay

    def __len__(self) -> int:
        return len(self.index)


@dataclass(frozen=True, slots=True)
class PoseBound(ShortcutTest):
    """A bound on the distance and on the angle; the measure is the larger share of the two."""

    units: Floats  # (3, n) axes or (4, n) quaternions
    turn_rad: float

    def costs(self, columns: Floats, starts: Ints, ends: Ints) -> Floats:
        """Return the larger of distance and angle (q,), each as a share of its bound."""
        near = ShortcutTest.costs(self, columns, starts, ends) / self.near_mm
        return np.maximum(near, piece_turns(columns, self.units, starts, ends) / self.turn_rad)

    def holds(self, columns: Floats, starts: Ints, ends: Ints) -> Bools:
        """Return for each piece (q,) whether a segment may replace it."""
        good = self.allows(columns, starts, ends)
        some = np.flatnonzero(good)
        turns = piece_turns(columns, self.units, starts[some], ends[some])
        good[some] = turns <= self.turn_rad
        good[ends - starts == 1] = True
        return good


def simplify_poses(
    points: ArrayLike,
    orientations: ArrayLike,
    tolerance_mm: float,
    tolerance_deg: float,
    *,
    method: SimplifyMethod = "optimal",
    frechet: bool = True,
    keep: ArrayLike | None = None,
) -> SimplifiedPoses:
    """Return a path of fewer poses that stays within both tolerances of the original.

    An original is compared with the place nearest to it on the segment that replaces its piece,
    and with the orientation there: between kept poses it follows the great circle evenly.

    Args:
        points: Positions (n, 3) in mm.
        orientations: Unit axes (n, 3), or unit quaternions (n, 4) in any convention.
        tolerance_mm: Bound on the distance, above 0.
        tolerance_deg: Bound on the angle, above 0.
        method: As in :func:`rona_core.path.simplification.simplify.simplify`.
        frechet: Bound the distance in the sense of Fréchet, so that strokes that run back stay.
        keep: Mask (n,) or indices of poses that must stay; the two ends always do.

    Raises:
        InvalidInputError: wrong shapes, orientations that are not unit vectors, wrong tolerances.
    """
    p = as_points(points, at_least=1, name="points")
    units = as_units(orientations, len(p))
    if not (0.0 < tolerance_mm < np.inf and 0.0 < tolerance_deg < np.inf):
        raise InvalidInputError(
            f"tolerances must be above 0, not {tolerance_mm} mm and {tolerance_deg} deg"
        )
    rows = np.ascontiguousarray(units.T)
    near, turn = float(tolerance_mm), float(np.deg2rad(tolerance_deg))
    bound = PoseBound("k1", 1.0, near, frechet, rounding_of(p, "k1"), rows, turn)
    fixed = as_keep(keep, len(p))
    index, used = chosen_points(p, fixed, bound, method)
    columns = np.ascontiguousarray(p.T)
    least = len(index) if used == "optimal" else points_lower_bound(columns, fixed, bound)
    found = deviations(p, index)
    turns = piece_turns(columns, rows, index[:-1], index[1:])
    worst = int(turns.argmax()) if len(turns) else 0
    return SimplifiedPoses(
        index=readonly(index),
        tolerance_mm=bound.near_mm,
        tolerance_deg=float(tolerance_deg),
        method=used,
        n_original=len(p),
        k1_mm=found.k1_mm,
        turn_deg=float(np.rad2deg(turns.max(initial=0.0))),
        where=found.where,
        where_turn=int(index[worst]),
        frechet=frechet,
        lower_bound=least,
        exact=len(index) == least,
        rule=RULES[used],
    )


def as_units(orientations: ArrayLike, n: int) -> Floats:
    """Return orientations (n, 3) or (n, 4), scaled to exactly unit length.

    Raises:
        InvalidInputError: another shape, or a length that differs from 1 by more than 1e-6.
    """
    units = as_floats(orientations, name="orientations")
    if units.shape not in ((n, 3), (n, 4)):
        raise InvalidInputError(
            f"orientations must have shape ({n}, 3) or ({n}, 4), not {units.shape}"
        )
    lengths = np.linalg.norm(units, axis=1)
    if (np.abs(lengths - 1.0) > UNIT_TOLERANCE).any():
        i = int(np.abs(lengths - 1.0).argmax())
        raise InvalidInputError(f"orientations[{i}] has length {lengths[i]:.6g}, expected 1")
    return units / lengths[:, None]
