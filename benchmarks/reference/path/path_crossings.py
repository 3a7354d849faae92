"""Where a scan path crosses itself: places that are scanned twice."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Vector3, as_points, readonly


@dataclass(frozen=True, slots=True, eq=False)
class Crossing:
    """One place where two segments of a path cross."""

    first: int  # number of the earlier segment, which begins at the point of that number
    second: int
    point_base: Vector3  # (3,), midway between the two
    gap_mm: float  # between the two lines, measured across both
    angle_deg: float  # between them, 0 to 90
    along_first_mm: float  # way along the path to the crossing, the first time
    along_second_mm: float  # and the second time


def crossings(
    points_base: ArrayLike, *, near_mm: float = 2.0, min_angle_deg: float = 5.0
) -> tuple[Crossing, ...]:
    """Return the crossings of a path, in the order of their first passage.

    Two segments cross if, seen along the direction across both, they intersect, and if they are
    no farther than ``near_mm`` apart there. So lines beside each other do not cross however near
    they are, and a path on a curved surface needs no map. Use the simplified path: raw samples
    cross themselves at every tremor.

    Args:
        points_base: Path (n, 3) in mm.
        near_mm: Largest gap; less than the size of what the path runs round.
        min_angle_deg: Segments that differ less in direction run along each other.

    Raises:
        InvalidInputError: wrong shape, or bounds out of range.
    """
    p = as_points(points_base, name="points_base")
    if not (0.0 <= near_mm < np.inf and 0.0 < min_angle_deg < 90.0):
        raise InvalidInputError(
            f"near_mm must be 0 or more and min_angle_deg in 0 to 90, "
            f"not {near_mm} and {min_angle_deg}"
        )
    steps = np.diff(p, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    along = np.concatenate(([0.0], np.cumsum(lengths)))
    found: list[Crossing] = []
    for i in range(len(steps) - 2):
        d, e, w = steps[i], steps[i + 2 :], p[i + 2 : -1] - p[i]
        normal = np.cross(d, e)
        normal_sq = (normal**2).sum(axis=1)
        size_sq = (lengths[i] * lengths[i + 2 :]) ** 2
        sine_sq = np.divide(normal_sq, size_sq, out=np.zeros_like(size_sq), where=size_sq > 0)
        steep = np.flatnonzero(sine_sq >= np.sin(np.deg2rad(min_angle_deg)) ** 2)
        normal, normal_sq, w = normal[steep], normal_sq[steep], w[steep]
        s = (np.cross(w, e[steep]) * normal).sum(axis=1) / normal_sq
        t = (np.cross(w, d) * normal).sum(axis=1) / normal_sq
        gap = np.abs((w * normal).sum(axis=1)) / np.sqrt(normal_sq)
        # each segment has its start, but not its end, so that a corner counts once
        meets = (s >= 0.0) & (s < 1.0) & (t >= 0.0) & (t < 1.0) & (gap <= near_mm)
        for k in np.flatnonzero(meets)[np.argsort(s[meets], kind="stable")]:
            j = int(i + 2 + steep[k])
            middle = (p[i] + s[k] * d + p[j] + t[k] * steps[j]) / 2.0
            sine = float(np.sqrt(normal_sq[k]) / (lengths[i] * lengths[j]))
            found.append(
                Crossing(
                    first=i,
                    second=j,
                    point_base=readonly(middle),
                    gap_mm=float(gap[k]),
                    angle_deg=float(np.rad2deg(np.arcsin(min(sine, 1.0)))),
                    along_first_mm=float(along[i] + s[k] * lengths[i]),
                    along_second_mm=float(along[j] + t[k] * lengths[j]),
                )
            )
    return tuple(found)
