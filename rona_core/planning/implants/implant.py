"""Implants: their solids, screws and dimensions, and the catalogue of them.

Catalogue of implants; every dimension says whether it is sourced or assumed. Messages, page and
REST read ``CATALOGUE``.

Only what lies in the bone is modelled: coil and receiver of a bone-conduction implant lie on it.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely

from rona_core.devices.limits import require, require_within
from rona_core.errors import NotFoundError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.planning.bed import Screw
from rona_core.planning.implants.solids import (
    Stack,
    Terrace,
    cylinder,
    stack_mesh,
    stadium,
    terraces,
)

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


MAKER = "maker's page of the Bonebridge BCI 601"
PRENZLER = "Prenzler et al., doi 10.1007/s00405-025-09786-y"
MYLANUS = "study of E. Mylanus: screws of 3 or 4 mm"


def bci_601() -> Implant:
    """Return the transducer of the Bonebridge BCI 601, with a screw on each side."""
    diameter = Dimension("diameter of the transducer", 15.8)
    depth = Dimension("depth of the transducer", 8.7, MAKER)
    return _bone_conduction("BCI 601", diameter, depth)


def bci_602() -> Implant:
    """Return the transducer of the Bonebridge BCI 602, with a screw on each side."""
    diameter = Dimension("diameter of the transducer", 18.2)
    depth = Dimension("depth of the transducer", 4.5, PRENZLER)
    return _bone_conduction("BCI 602", diameter, depth)


def ci_receiver() -> Implant:
    """Return the receiver of a cochlear implant; makers publish no numbers of its bed."""
    length, width = Dimension("length of the bed", 24.0), Dimension("width of the bed", 20.0)
    depth = Dimension("depth of the bed", 4.0)
    part = stadium(length.value_mm, width.value_mm, 0.0, depth.value_mm)
    return Implant("CI receiver", Stack((part,)), (), (length, width, depth))


def osseointegrated_screw() -> Implant:
    """Return the screw of an Osia or Baha, 4 mm long, as the hole that it needs."""
    diameter = Dimension("diameter of the screw", 4.0)
    length = Dimension("length of the screw", 4.0, MYLANUS)
    screw = Screw(0.0, 0.0, length.value_mm, diameter.value_mm)
    hole = cylinder(diameter.value_mm, 0.0, length.value_mm)
    return Implant("Osia/Baha screw", Stack((hole,)), (screw,), (diameter, length))


def _bone_conduction(name: str, diameter: Dimension, depth: Dimension) -> Implant:
    """Return a round transducer with a screw on each side of it, on wings along x."""
    spacing = Dimension("distance between the screws", 24.0)
    length = Dimension("length of the screws", 4.0, PRENZLER)
    thread = Dimension("diameter of the screws", 2.0)
    x_mm = 0.5 * spacing.value_mm
    screws = tuple(Screw(x, 0.0, length.value_mm, thread.value_mm) for x in (-x_mm, x_mm))
    transducer = cylinder(diameter.value_mm, 0.0, depth.value_mm)
    return Implant(name, Stack((transducer,)), screws, (diameter, depth, spacing, length, thread))


CATALOGUE = {
    implant.name: implant
    for implant in (bci_601(), bci_602(), ci_receiver(), osseointegrated_screw())
}


def implant_named(name: str) -> Implant:
    """Return an implant of the catalogue.

    Raises:
        NotFoundError: there is none of that name.
    """
    if name not in CATALOGUE:
        raise NotFoundError(f"no implant {name!r} is known, only {', '.join(CATALOGUE)}")
    return CATALOGUE[name]
