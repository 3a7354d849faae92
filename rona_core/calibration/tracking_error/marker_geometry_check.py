"""Check of measured markers against their stated geometry; names the distance that is wrong.

Distances between markers do not depend on the pose, so a wrong geometry shows in every motion.
Markers are lettered A, B, C, ... in the order of the geometry.
"""

from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, as_floats, as_points
from rona_core.geometry.robust import mad_sigma

TOLERANCE_MM = 0.5  # a distance may be off by this much: volume bias of a tracker, machining
STANDARD_ERRORS = 5.0
MIN_FRAMES = 3
MAX_PERMUTED = 6  # markers, of which all orders are tried


@dataclass(frozen=True, slots=True)
class MarkerDistance:
    """One distance between two markers."""

    markers: tuple[int, int]  # rows of the geometry
    measured_mm: float
    stated_mm: float
    sigma_mm: float  # standard error of the measured one

    @property
    def off(self) -> bool:
        """Whether the two differ by more than noise and bias explain."""
        return abs(self.measured_mm - self.stated_mm) > max(
            TOLERANCE_MM, STANDARD_ERRORS * self.sigma_mm
        )


@dataclass(frozen=True, slots=True)
class GeometryCheck:
    """Every distance, and what is wrong with the geometry in words; nothing if it fits."""

    distances: tuple[MarkerDistance, ...]
    scale: float  # measured over stated lengths
    order: tuple[int, ...] | None  # rows of the geometry in the order that would fit, if not as is
    complaints: tuple[str, ...]


def check_marker_geometry(
    points_tracker: ArrayLike, positions_marker: ArrayLike, seen: ArrayLike | None = None
) -> GeometryCheck:
    """Compare distances between measured markers with those of the geometry.

    Args:
        points_tracker: Markers (n, m, 3) in mm; values of unseen ones are ignored.
        positions_marker: Marker geometry (m, 3) in mm.
        seen: (n, m) which markers were seen; all if None.

    Raises:
        InvalidInputError: arrays that do not belong together.
    """
    p = as_points(positions_marker, at_least=2, name="positions_marker")
    y = np.array(points_tracker, dtype=np.float64)
    if y.ndim != 3 or y.shape[1:] != p.shape:
        raise InvalidInputError(f"points_tracker must have shape (n, {len(p)}, 3), not {y.shape}")
    mask = np.ones(y.shape[:2], dtype=np.bool_) if seen is None else np.asarray(seen, np.bool_)
    if mask.shape != y.shape[:2]:
        raise InvalidInputError(f"seen must have shape {y.shape[:2]}, not {mask.shape}")
    y = as_floats(np.where(mask[:, :, None], y, 0.0), name="points_tracker")
    pairs = (_distance(y, mask, p, i, j) for i, j in combinations(range(len(p)), 2))
    distances = tuple(pair for pair in pairs if pair is not None)
    if not distances:
        return GeometryCheck((), 1.0, None, ())
    measured = np.array([d.measured_mm for d in distances])
    stated = np.array([d.stated_mm for d in distances])
    scale = float(measured @ stated / (stated @ stated))
    if not any(d.off for d in distances):
        return GeometryCheck(distances, scale, None, ())
    order = _fitting_order(distances, p)
    if order is not None:
        letters = " ".join(map(letter, order))
        complaint = f"the markers come in another order than in the geometry: {letters}"
    elif len(distances) > 1 and np.abs(measured - scale * stated).max() < TOLERANCE_MM:
        complaint = (
            f"all distances between markers are {scale:.3f} times those of the geometry: "
            "check its unit"
        )
    else:
        complaint = _worst(distances)
    return GeometryCheck(distances, scale, order, (complaint,))


def letter(row: int) -> str:
    """Return the letter of a marker."""
    return chr(ord("A") + row) if row < 26 else str(row + 1)


def _distance(y: Floats, mask: Bools, p: Floats, i: int, j: int) -> MarkerDistance | None:
    both = mask[:, i] & mask[:, j]
    if both.sum() < MIN_FRAMES:
        return None
    lengths = np.linalg.norm(y[both, i] - y[both, j], axis=1)
    middle = float(np.median(lengths))
    spread = mad_sigma(lengths, center=middle)
    stated = float(np.linalg.norm(p[i] - p[j]))
    return MarkerDistance((i, j), middle, stated, 1.25 * spread / float(np.sqrt(both.sum())))


def _fitting_order(distances: tuple[MarkerDistance, ...], p: Floats) -> tuple[int, ...] | None:
    """Return the order of the geometry's rows that fits all distances, if there is one."""
    if len(p) > MAX_PERMUTED:
        return None
    first, second = np.array([d.markers for d in distances]).T
    measured = np.array([d.measured_mm for d in distances])
    lengths = np.linalg.norm(p[:, None] - p, axis=2)
    for order in permutations(range(len(p))):
        rows = np.array(order)
        if np.abs(lengths[rows[first], rows[second]] - measured).max() < TOLERANCE_MM:
            return order
    return None


def _worst(distances: tuple[MarkerDistance, ...]) -> str:
    """Name the distance that is off most, and the marker that all wrong distances share."""
    off = [d for d in distances if d.off]
    worst = max(off, key=lambda d: abs(d.measured_mm - d.stated_mm))
    a, b = map(letter, worst.markers)
    text = (
        f"markers {a} and {b} are {worst.measured_mm:.1f} mm apart, "
        f"{worst.stated_mm:.1f} mm in the geometry"
    )
    shared = set.intersection(*(set(d.markers) for d in off))
    if len(off) > 1 and len(shared) == 1:
        text += f": marker {letter(shared.pop())} is not where the geometry has it"
    return text
