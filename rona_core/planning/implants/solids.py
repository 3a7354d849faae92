"""Solids of implants, and the terraces by which one needs the plane down to a depth.

Solids of implants: upright prisms with rounded outlines, and stacks of them. All in frame ``bed``:
z = 0 is where the bone's surface is to be at the rim, depths count downwards.

Terraces of an implant: what part of the plane it needs down to which depth. An implant is laid in
from above, so what it needs at one depth is the shadow of all of it that is as deep or deeper.
Regions get smaller downwards, and there is no undercut.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
import trimesh
from shapely.geometry import LineString, Point, Polygon, box
from shapely.geometry.base import BaseGeometry

from rona_core.devices.limits import require, require_within

LEAST_MM, MOST_MM = 1.0, 120.0  # of any side: smaller or larger is a mix-up of units
MOST_RISE_MM = 20.0  # of a solid above the plane z = 0
MOST_DEPTH_MM = 30.0
ARC_SEGMENTS = 32  # of a quarter circle: 0.0003 of its radius off


@dataclass(frozen=True, slots=True)
class Prism:
    """An upright solid whose outline is a rectangle with rounded corners, over a depth range.

    With corners of half its width it is a stadium, and as long as wide a cylinder.
    """

    length_mm: float  # along x of ``bed``
    width_mm: float  # along y
    corner_radius_mm: float
    from_mm: float  # depth of its top below z = 0; negative where it stands out of the bone
    to_mm: float  # depth of its bottom

    def __post_init__(self) -> None:
        _require_size("length_mm", self.length_mm)
        _require_size("width_mm", self.width_mm)
        most = 0.5 * min(self.length_mm, self.width_mm)
        require_within("corner_radius_mm", self.corner_radius_mm, 0.0, most)
        require_within("from_mm", self.from_mm, -MOST_RISE_MM, MOST_DEPTH_MM)
        require_within("to_mm", self.to_mm, -MOST_RISE_MM, MOST_DEPTH_MM)
        require(
            self.to_mm > self.from_mm,
            f"the depth range of a solid must go down, not from {self.from_mm:g} to "
            f"{self.to_mm:g} mm",
        )

    def region(self) -> Polygon:
        """Return its outline in the plane of ``bed``."""
        radius = self.corner_radius_mm
        x, y = 0.5 * self.length_mm - radius, 0.5 * self.width_mm - radius
        if radius == 0.0:
            return box(-x, -y, x, y)
        if x <= 0.0 or y <= 0.0:
            core = Point(0.0, 0.0) if max(x, y) <= 0.0 else LineString([(-x, -y), (x, y)])
        else:
            core = box(-x, -y, x, y)
        return core.buffer(radius, quad_segs=ARC_SEGMENTS)


def cylinder(diameter_mm: float, from_mm: float, to_mm: float) -> Prism:
    """Return an upright cylinder over a depth range.

    Raises:
        InvalidInputError: a size outside 1 to 120 mm, or a range that does not go down.
    """
    return Prism(diameter_mm, diameter_mm, 0.5 * diameter_mm, from_mm, to_mm)


def stadium(length_mm: float, width_mm: float, from_mm: float, to_mm: float) -> Prism:
    """Return an upright solid with two straight sides and round ends over a depth range.

    Raises:
        InvalidInputError: as of ``cylinder``, or wider than long.
    """
    require(
        width_mm <= length_mm,
        f"a stadium is at least as long as wide, not {length_mm:g} x {width_mm:g} mm",
    )
    return Prism(length_mm, width_mm, 0.5 * width_mm, from_mm, to_mm)


@dataclass(frozen=True, slots=True)
class Stack:
    """Prisms on one another, from the top down, without a gap between them."""

    parts: tuple[Prism, ...]

    def __post_init__(self) -> None:
        require(len(self.parts) > 0, "a stack needs at least one part, got none")
        for upper, lower in pairwise(self.parts):
            require(
                abs(upper.to_mm - lower.from_mm) <= 1e-9,
                f"each part of a stack must begin where the one above ends: {upper.to_mm:g} mm, "
                f"not {lower.from_mm:g} mm",
            )
        height_mm = self.parts[-1].to_mm - self.parts[0].from_mm
        _require_size("the height of a stack", height_mm)


def stack_mesh(stack: Stack, lift_mm: float = 0.0) -> Any:
    """Return the trimesh of a stack in ``bed``, raised by ``lift_mm``.

    Its parts are closed bodies that touch one another.
    """
    bodies = [_prism_mesh(part, lift_mm) for part in stack.parts]
    return trimesh.util.concatenate(bodies)


def _prism_mesh(part: Prism, lift_mm: float) -> Any:
    """Return the closed mesh of a prism; its outline is convex, so that fans cover its ends."""
    ring = shapely.get_coordinates(part.region().exterior)[:-1]
    if not part.region().exterior.is_ccw:
        ring = ring[::-1]
    n = len(ring)
    z = np.repeat((lift_mm - part.from_mm, lift_mm - part.to_mm), n)
    points = np.column_stack((np.vstack((ring, ring)), z))
    here, after = np.arange(n), (np.arange(n) + 1) % n
    fan = np.column_stack((np.zeros(n - 2, dtype=np.int64), here[1:-1], here[2:]))
    walls = (
        np.column_stack((here, here + n, after + n)),
        np.column_stack((here, after + n, after)),
    )
    return trimesh.Trimesh(points, np.vstack((fan, fan[:, ::-1] + n, *walls)), process=False)


def _require_size(what: str, size_mm: float) -> None:
    require(
        LEAST_MM <= size_mm <= MOST_MM,
        f"{what} is {size_mm:g} mm, expected {LEAST_MM:g} to {MOST_MM:g} mm: is it in mm?",
    )


@dataclass(frozen=True, slots=True, eq=False)
class Terrace:
    """A region of the plane of ``bed`` that is needed from the terrace above down to a depth."""

    depth_mm: float
    region: BaseGeometry


def terraces(stack: Stack, lift_mm: float = 0.0) -> tuple[Terrace, ...]:
    """Return what a stack raised by ``lift_mm`` needs below z = 0, from the shallowest down."""
    shadows: list[Terrace] = []
    for part in reversed(stack.parts):
        depth_mm, region = part.to_mm - lift_mm, part.region()
        if depth_mm > 0.0:
            if shadows:
                region = shapely.union(region, shadows[-1].region)
            shadows.append(Terrace(depth_mm, region))
    return tuple(reversed(shadows))
