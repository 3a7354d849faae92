"""5D path: positions with a probe axis; the roll about the axis is free."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import (
    Floats,
    Ints,
    Vector3,
    as_floats,
    as_points,
    as_unit_vectors,
    as_vector3,
    readonly,
)
from rona_core.geometry.pose import Poses

STEP_MM = 1.0
STEP_RAD = float(np.deg2rad(1.0))
SLACK = 1.25  # a path that is nearly dense enough is left as it is
REFERENCE_CONE_RAD = np.deg2rad(30.0)  # closer to the axis than this, base x is no reference
ANTIPARALLEL = (
    1e-9  # 1 + cos of the angle between neighbouring axes; below it the turn is undefined
)


@dataclass(frozen=True, slots=True, eq=False)
class Path5D:
    """Positions on the bone (n, 3) and probe axes (n, 3) that point into it, both in ``base``."""

    points_base: Floats
    axes_base: Floats

    def __post_init__(self) -> None:
        points = as_points(self.points_base, at_least=1, name="points_base")
        axes = as_unit_vectors(self.axes_base, name="axes_base")
        if len(points) != len(axes):
            raise InvalidInputError(f"{len(points)} points need as many axes, not {len(axes)}")
        object.__setattr__(self, "points_base", readonly(points))
        object.__setattr__(self, "axes_base", readonly(axes))

    def __len__(self) -> int:
        return len(self.points_base)

    def arc_length_mm(self) -> Floats:
        """Return the distance travelled up to each point (n,), starting at 0."""
        steps = np.linalg.norm(np.diff(self.points_base, axis=0), axis=1)
        return np.concatenate(([0.0], np.cumsum(steps)))

    def steps(self) -> tuple[Floats, Floats]:
        """Return the distance in mm and the turn of the axis in radians of each step (n - 1,)."""
        before, after = self.axes_base[:-1], self.axes_base[1:]
        sines = np.linalg.norm(np.cross(before, after), axis=1)
        turns_rad = np.arctan2(sines, np.einsum("ij,ij->i", before, after))
        return np.linalg.norm(np.diff(self.points_base, axis=0), axis=1), turns_rad

    def references(self) -> Floats:
        """Return the direction of roll zero at each point (n, 3), carried by parallel transport.

        At the first point it is the base x axis projected onto the tangent plane, or base y where
        x lies within 30 degrees of the axis; from there it turns only as much as the axis does.

        Raises:
            DegenerateGeometryError: neighbouring axes point in opposite directions.
        """
        return _references(self)

    def Ts_base_probe(self, rolls_rad: ArrayLike) -> Poses:  # noqa: N802 (frame grammar)
        """Return the 6D poses for one roll (scalar) or one roll each (n,)."""
        rolls = np.broadcast_to(as_floats(rolls_rad, name="rolls_rad"), (len(self),))
        z, x0 = self.axes_base, self.references()
        y0 = np.cross(z, x0)
        x = np.cos(rolls)[:, None] * x0 + np.sin(rolls)[:, None] * y0
        y = np.cross(z, x)
        return Poses(np.stack((x, y, z), axis=2), self.points_base)


@dataclass(frozen=True, slots=True, eq=False)
class UpheldPath5D(Path5D):
    """A path whose axes stay near one direction, and whose roll is counted from one that is fixed.

    Where the axis goes round and round a cone, parallel transport would turn the reference at each
    round by the solid angle of that cone; one that is projected anew at every point comes back.
    """

    zero_base: Vector3  # (3,) away from all axes; roll zero is its direction across the axis

    def __post_init__(self) -> None:
        Path5D.__post_init__(self)
        object.__setattr__(self, "zero_base", readonly(as_vector3(self.zero_base)))
        if np.abs(self.axes_base @ self.zero_base).max() > np.cos(REFERENCE_CONE_RAD):
            raise DegenerateGeometryError("an axis of the path lies along its roll zero")

    def references(self) -> Floats:
        """Return the direction of roll zero at each point (n, 3): the fixed one across the axis."""
        along = self.axes_base @ self.zero_base
        across = self.zero_base - along[:, None] * self.axes_base
        return readonly(across / np.linalg.norm(across, axis=1, keepdims=True))


@lru_cache(maxsize=8)  # a search asks for those of one path again for every roll
def _references(path: Path5D) -> Floats:
    axes = path.axes_base
    start = np.array((1.0, 0.0, 0.0))
    if abs(axes[0] @ start) > np.cos(REFERENCE_CONE_RAD):
        start = np.array((0.0, 1.0, 0.0))
    references = np.zeros_like(axes)
    reference = start - (start @ axes[0]) * axes[0]
    references[0] = reference / np.linalg.norm(reference)
    for i in range(1, len(axes)):
        a, b, reference = axes[i - 1], axes[i], references[i - 1]
        bisector = a + b
        if 1.0 + a @ b < ANTIPARALLEL:
            raise DegenerateGeometryError(
                f"the axes of path points {i - 1} and {i} are opposite: roll is undefined"
            )
        # smallest rotation a -> b, as two reflections
        turned = reference - 2.0 * (bisector @ reference) / (bisector @ bisector) * bisector
        turned = turned - (turned @ b) * b  # remove rounding along the axis
        references[i] = turned / np.linalg.norm(turned)
    return readonly(references)


def resample_path(path: Path5D) -> Path5D:
    """Return the path with steps of at most about 1 mm and 1 degree; its own points stay.

    Positions in between lie on straight lines, axes turn evenly. A path that is dense already is
    returned unchanged.

    Raises:
        DegenerateGeometryError: neighbouring axes are opposite.
    """
    points, axes = path.points_base, path.axes_base
    steps_mm, turns = path.steps()
    strides = np.maximum(steps_mm / STEP_MM, turns / STEP_RAD)
    if strides.max(initial=0.0) <= SLACK:
        return path
    path.references()  # refuses opposite axes
    counts = np.where(strides <= SLACK, 1, np.ceil(strides)).astype(np.int64)
    segment, shares = subdivided(counts)
    shares = shares[:, None]
    between = points[segment] * (1.0 - shares) + points[segment + 1] * shares
    turned = turned_between(axes[segment], axes[segment + 1], shares, turns[segment][:, None])
    return Path5D(np.vstack((between, points[-1:])), np.vstack((turned, axes[-1:])))


def subdivided(counts: Ints) -> tuple[Ints, Floats]:
    """Return the segment (m,) of each place, and its share of it, for so many places a segment."""
    segment = np.repeat(np.arange(len(counts)), counts)
    first = np.repeat(np.cumsum(counts) - counts, counts)
    return segment, (np.arange(len(segment)) - first) / counts[segment]


def turned_between(start: Floats, end: Floats, shares: Floats, turns_rad: Floats) -> Floats:
    """Return unit vectors (n, 3) that turn evenly from ``start`` to ``end`` (slerp)."""
    small = turns_rad < 1e-8
    sine = np.where(small, 1.0, np.sin(turns_rad))
    a = np.where(small, 1.0 - shares, np.sin((1.0 - shares) * turns_rad) / sine)
    b = np.where(small, shares, np.sin(shares * turns_rad) / sine)
    mixed = a * start + b * end
    return mixed / np.linalg.norm(mixed, axis=1, keepdims=True)
