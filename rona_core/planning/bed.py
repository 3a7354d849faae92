"""Bed of an implant as what the burr takes away: depths over a grid in the frame of the bed."""

from dataclasses import dataclass

from rona_core.geometry.arrays import Bools, Floats


@dataclass(frozen=True, slots=True, eq=False)
class Bed:
    """The solid that a burr sweeps, as one depth for each cell (no undercut).

    Frame ``bed``: origin in the middle of the implant's seat, x along its longer side, z out of the
    bone. Its plane z = 0 is where the bone's surface is to be at the rim of the bed.
    """

    x_mm: Floats  # (nx,) cell centres, evenly spaced, as far apart as those of y_mm
    y_mm: Floats  # (ny,)
    depth_mm: Floats  # (nx, ny) of the lowest place that the burr reaches below z = 0; else 0

    def cut(self) -> Bools:
        """Return the cells (nx, ny) that the burr reaches."""
        return self.depth_mm > 0.0


@dataclass(frozen=True, slots=True)
class Screw:
    """A screw beside the bed, straight down into the bone."""

    x_mm: float  # of its axis, in frame ``bed``
    y_mm: float
    length_mm: float  # of bone that it needs below the outer boundary
    diameter_mm: float
