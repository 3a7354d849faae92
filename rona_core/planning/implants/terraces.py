"""Terraces of an implant: what part of the plane it needs down to which depth.

An implant is laid in from above, so what it needs at one depth is the shadow of all of it that is
as deep or deeper. Regions get smaller downwards, and there is no undercut.
"""

from dataclasses import dataclass

import shapely
from shapely.geometry.base import BaseGeometry

from rona_core.planning.implants.solids import Stack


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
