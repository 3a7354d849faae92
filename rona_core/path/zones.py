"""Zones of a surface from which a bed or a scan keeps away, and regions painted on it.

Painted regions: strokes of a round brush on the bone that say where to scan and where not.
Distances in a plane are never longer than on the bone, so that a pattern that keeps off a stroke in
the plane of its patch keeps off it on the bone.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from rona_core.devices.limits import require_within
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, as_floats, readonly
from rona_core.geometry.pose import Pose


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


Point = tuple[float, float, float]
PaintKind = Literal["scan", "avoid"]


@dataclass(frozen=True, slots=True)
class PaintedStroke:
    """One stroke of the brush on the bone."""

    kind: PaintKind
    points_base_mm: tuple[Point, ...]  # where its middle went, in ``base``
    radius_mm: float

    def zone(self, T_patch_base: Pose | None = None) -> Zone:
        """Return the stroke as a zone in ``base``, or in the x-y plane of another frame."""
        points = np.array(self.points_base_mm, dtype=np.float64)
        corners = points if T_patch_base is None else (T_patch_base @ points)[:, :2]
        return Zone(self.kind, corners, closed=False, distance_mm=self.radius_mm)


@dataclass(frozen=True, slots=True)
class PaintedRegions:
    """All strokes, in their order. Without one of kind "scan" everything not avoided is scanned."""

    strokes: tuple[PaintedStroke, ...] = ()

    def __len__(self) -> int:
        return len(self.strokes)

    def of(self, kind: PaintKind) -> tuple[PaintedStroke, ...]:
        """Return the strokes of a kind."""
        return tuple(stroke for stroke in self.strokes if stroke.kind == kind)

    def depths_mm(
        self, kind: PaintKind, places: Floats, T_patch_base: Pose | None = None
    ) -> Floats:
        """Return how far places (n, 3), or (n, 2) in a plane, lie within a kind; negative: outside.

        Minus infinity where nothing of the kind is painted.
        """
        depths = np.full(len(places), -np.inf)
        for stroke in self.of(kind):
            zone = stroke.zone(T_patch_base)
            depths = np.maximum(depths, zone.distance_mm - zone.distances_mm(places))
        return depths

    def reach_mm(self, center_base: Floats) -> float:
        """Return how far from a place (3,) what is to be scanned reaches; 0 where nothing is."""
        reaches = [
            float(np.linalg.norm(np.array(s.points_base_mm) - center_base, axis=1).max())
            + s.radius_mm
            for s in self.of("scan")
        ]
        return max(reaches, default=0.0)

    def avoided(self, points_base: Floats) -> Bools:
        """Return which points (n, 3) of the bone are to be avoided."""
        return self.depths_mm("avoid", points_base) >= 0.0

    def allowed(
        self,
        places: Floats,
        T_patch_base: Pose | None = None,
        *,
        clearance_mm: float = 0.0,
        margin_mm: float = 0.0,
    ) -> Bools:
        """Return where the probe may scan: places (n, 3) in ``base``, or (n, 2) in a plane.

        Args:
            places: On the bone.
            T_patch_base: Into the frame of the plane; None for places in ``base``.
            clearance_mm: Kept to what is to be avoided.
            margin_mm: Kept to the rim of what is to be scanned.
        """
        far = self.depths_mm("avoid", places, T_patch_base) < -clearance_mm
        if not self.of("scan"):
            return far
        return far & (self.depths_mm("scan", places, T_patch_base) >= margin_mm)
