"""Does a tool look like its tool file? The distances between its markers tell.

A wrong file, a bent marker or another order of markers shows in a distance that does not fit.
"""

from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np
from numpy.typing import ArrayLike

from rona_core.arrays import Floats, Ints, as_points, readonly
from rona_core.errors import InvalidInputError

TOLERANCE_MM = 1.5  # distances off by less are noise of the tracker
MAX_ORDERS = 6  # orders of up to so many markers are tried
SCALES = {1000.0: "metres", 25.4: "inches", 10.0: "centimetres"}  # by what mm are divided


@dataclass(frozen=True, slots=True, eq=False)
class MarkerCheck:
    """How the distances between markers compare with what is expected."""

    pairs: Ints  # (k, 2) indices of the markers
    expected_mm: Floats  # (k,)
    measured_mm: Floats  # (k,)
    fits: bool
    reason: str  # what does not fit and what may be wrong; empty where all fits


def check_markers(
    positions_marker: ArrayLike, points_measured: ArrayLike, *, tolerance_mm: float = TOLERANCE_MM
) -> MarkerCheck:
    """Compare measured markers with a known geometry; no pose is needed for that.

    Args:
        positions_marker: Geometry as the tool file has it (m, 3), m >= 2.
        points_measured: The same markers in any one frame (m, 3), in mm: one frame, or a mean.
        tolerance_mm: Largest difference of a distance that counts as equal.

    Raises:
        InvalidInputError: wrong shapes, or different numbers of markers.
    """
    expected = as_points(positions_marker, at_least=2, name="positions_marker")
    measured = as_points(points_measured, at_least=2, name="points_measured")
    if len(expected) != len(measured):
        raise InvalidInputError(
            f"the tool file has {len(expected)} markers, {len(measured)} were measured"
        )
    pairs = np.array(list(combinations(range(len(expected)), 2)), dtype=np.int64)
    wanted, found = _distances(expected, pairs), _distances(measured, pairs)
    off = np.abs(found - wanted)
    fits = bool(off.max() <= tolerance_mm)
    reason = "" if fits else _reason(expected, measured, pairs, tolerance_mm)
    return MarkerCheck(readonly(pairs), readonly(wanted), readonly(found), fits, reason)


def _distances(points: Floats, pairs: Ints) -> Floats:
    return np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)


def _reason(expected: Floats, measured: Floats, pairs: Ints, tolerance_mm: float) -> str:
    wanted, found = _distances(expected, pairs), _distances(measured, pairs)
    worst = int(np.argmax(np.abs(found - wanted)))
    i, j = (_letter(int(n)) for n in pairs[worst])
    named = (
        f"markers {i} and {j} are {found[worst]:.4g} mm apart, the tool file says "
        f"{wanted[worst]:.4g} mm"
    )
    for scale, unit in SCALES.items():
        if np.abs(found * scale - wanted).max() <= tolerance_mm:
            return f"{named}: were the markers measured in {unit}?"
    if len(expected) <= MAX_ORDERS:
        for order in permutations(range(len(expected))):
            if np.abs(_distances(measured[list(order)], pairs) - wanted).max() <= tolerance_mm:
                letters = " ".join(_letter(k) for k in order)
                return f"{named}: they fit in the order {letters}"
    blamed = _single_marker(expected, measured, pairs, tolerance_mm)
    if blamed is not None:
        return f"{named}: only marker {_letter(blamed)} is out of place"
    return f"{named}: is this the tool file of another tool?"


def _single_marker(
    expected: Floats, measured: Floats, pairs: Ints, tolerance_mm: float
) -> int | None:
    """Return the one marker without which everything fits, if there is just one."""
    off = np.abs(_distances(measured, pairs) - _distances(expected, pairs))
    alone = [
        k
        for k in range(len(expected))
        if (rest := ~(pairs == k).any(axis=1)).any() and off[rest].max() <= tolerance_mm
    ]
    return alone[0] if len(alone) == 1 else None


def _letter(index: int) -> str:
    return chr(ord("A") + index)
