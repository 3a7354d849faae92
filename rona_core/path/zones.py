"""Zones of a surface: a point, a line or an area, from which a bed or a scan keeps away."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.devices.limits import require_within
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, as_floats, readonly


@dataclass(frozen=True, slots=True, eq=False)
class Zone:
    """A point, a line or an area, and how far from it the zone reaches.

    Corners lie in a plane (u and v of the map); those of a point or a line may be places in space.
    """

    name: str
    corners_mm: Floats  # (n, 2) or (n, 3): one is a point, more are a line
    closed: bool  # the line is the border of an area
    distance_mm: float

    def __post_init__(self) -> None:
        corners = as_floats(self.corners_mm, name="corners_mm")
        flat = corners.ndim == 2 and corners.shape[1] == 2
        in_space = corners.ndim == 2 and corners.shape[1] == 3 and not self.closed
        if not (flat or in_space) or not len(corners):
            raise InvalidInputError(
                f"zone {self.name!r} needs corners (n, 2) in a plane, or, of a line, (n, 3), "
                f"not an array {corners.shape}"
            )
        if self.closed and len(corners) < 3:
            raise InvalidInputError(
                f"zone {self.name!r} is an area of {len(corners)} corners: draw at least 3"
            )
        require_within("distance_mm", self.distance_mm, 0.0, 50.0)
        object.__setattr__(self, "corners_mm", readonly(corners))

    def distances_mm(self, places_mm: ArrayLike) -> Floats:
        """Return how far places (n, 2) or (n, 3) are from the corners' line, 0 within an area."""
        places = np.asarray(places_mm, dtype=np.float64)
        starts = self.corners_mm
        ends = np.roll(starts, -1, axis=0) if self.closed else np.vstack((starts[1:], starts[-1:]))
        distance = np.full(len(places), np.inf)
        for start, end in zip(starts, ends, strict=True):
            along = end - start
            share = np.clip((places - start) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
            gap = np.linalg.norm(places - start - share[:, None] * along, axis=1)
            distance = np.minimum(distance, gap)
        return np.where(self._inside(places), 0.0, distance) if self.closed else distance

    def _inside(self, places: Floats) -> Bools:
        """Return which places (n, 2) an area holds: a ray from there crosses its border oddly."""
        inside = np.zeros(len(places), dtype=np.bool_)
        ends = np.roll(self.corners_mm, -1, axis=0)
        for (u0, v0), (u1, v1) in zip(self.corners_mm, ends, strict=True):
            if v0 != v1:
                between = (v0 > places[:, 1]) != (v1 > places[:, 1])
                crossing = u0 + (places[:, 1] - v0) * (u1 - u0) / (v1 - v0)
                inside ^= between & (places[:, 0] < crossing)
        return inside
