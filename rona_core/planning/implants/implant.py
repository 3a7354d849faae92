"""An implant: its solid, its screws, where its dimensions come from, and the bed that it needs."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely

from rona_core.devices.limits import require, require_within
from rona_core.geometry.arrays import Floats, readonly
from rona_core.planning.bed import Screw
from rona_core.planning.implants.solids import Stack, stack_mesh
from rona_core.planning.implants.terraces import Terrace, terraces

MOST_LIFT_MM = 4.0


@dataclass(frozen=True, slots=True)
class Dimension:
    """One dimension of an implant and where it comes from."""

    name: str
    value_mm: float
    source: str = ""  # empty: assumed


@dataclass(frozen=True, slots=True)
class Implant:
    """An implant that is laid into the bone, in frame ``bed``."""

    name: str
    solid: Stack
    screws: tuple[Screw, ...] = ()
    dimensions: tuple[Dimension, ...] = ()
    lift_mm: float = 0.0  # a spacer raises it by so much out of the bone

    def __post_init__(self) -> None:
        require(bool(self.name), "an implant needs a name, got none")
        require_within("lift_mm", self.lift_mm, 0.0, MOST_LIFT_MM)

    def lifted(self, lift_mm: float) -> "Implant":
        """Return it on a spacer.

        Raises:
            InvalidInputError: outside 0 to 4 mm.
        """
        return replace(self, lift_mm=lift_mm)

    def mesh(self) -> Any:
        """Return its closed trimesh in ``bed``, raised by the lift."""
        return stack_mesh(self.solid, self.lift_mm)

    def terraces(self) -> tuple[Terrace, ...]:
        """Return the regions that it needs, from the shallowest to the deepest.

        Raises:
            InvalidInputError: nothing of it is below z = 0.
        """
        found = terraces(self.solid, self.lift_mm)
        require(
            len(found) > 0,
            f"{self.name} raised by {self.lift_mm:g} mm needs no bed: nothing of it is below the "
            "bone's surface; take a smaller lift",
        )
        return found

    def outline(self) -> tuple[Floats, ...]:
        """Return the closed rings (n, 2) in ``bed`` round all that lies below z = 0."""
        region = self.terraces()[0].region
        return tuple(
            readonly(shapely.get_coordinates(ring))
            for part in shapely.get_parts(region)
            for ring in (part.exterior, *part.interiors)
        )

    def depth_mm(self, x_mm: Floats, y_mm: Floats) -> Floats:
        """Return how deep it reaches below z = 0 over a grid (nx, ny) of ``bed``; elsewhere 0."""
        x, y = np.meshgrid(x_mm, y_mm, indexing="ij")
        depth = np.zeros(x.shape)
        for terrace in self.terraces():
            shapely.prepare(terrace.region)
            depth[shapely.intersects_xy(terrace.region, x, y)] = terrace.depth_mm
        return readonly(depth)
