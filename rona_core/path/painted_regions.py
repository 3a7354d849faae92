"""Painted regions: strokes of a round brush on the bone that say where to scan and where not.

Distances in a plane are never longer than on the bone, so that a pattern that keeps off a stroke in
the plane of its patch keeps off it on the bone.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.pose import Pose
from rona_core.path.zones import Zone

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
