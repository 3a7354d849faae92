"""Burrs: ball, cylinder and bull-nose, by the corner radius of their end."""

from dataclasses import dataclass

import numpy as np

from rona_core.devices.limits import require_within
from rona_core.geometry.arrays import Floats


@dataclass(frozen=True, slots=True)
class Burr:
    """A rotating cutter; its end is flat in the middle and rounded towards its side."""

    diameter_mm: float
    corner_radius_mm: float  # half the diameter: a ball; 0: a cylinder; between: a bull-nose

    def __post_init__(self) -> None:
        require_within("diameter_mm", self.diameter_mm, 0.5, 12.0)
        require_within("corner_radius_mm", self.corner_radius_mm, 0.0, self.radius_mm)

    @property
    def radius_mm(self) -> float:
        """Return half its diameter."""
        return 0.5 * self.diameter_mm

    @property
    def is_ball(self) -> bool:
        """Return whether its end is half a ball."""
        return self.corner_radius_mm == self.radius_mm

    def rise_mm(self, distances_mm: Floats) -> Floats:
        """Return how far its upright end lies above its lowest place at distances from its axis.

        Infinite beyond its radius.
        """
        corner = self.corner_radius_mm
        over = np.maximum(distances_mm - (self.radius_mm - corner), 0.0)
        rise = corner - np.sqrt(np.maximum(corner * corner - over * over, 0.0))
        return np.where(distances_mm <= self.radius_mm, rise, np.inf)

    def reach_mm(self, height_mm: float) -> float:
        """Return its radius at a height above its lowest place, upright."""
        corner = self.corner_radius_mm
        over = max(corner - max(height_mm, 0.0), 0.0)
        return self.radius_mm - corner + float(np.sqrt(corner * corner - over * over))

    def scallop_mm(self, pitch_mm: float) -> float:
        """Return how high the ridge between two straight cuts ``pitch_mm`` apart is.

        R - sqrt(R^2 - (s / 2)^2) of a ball; what is flat of an end leaves none.
        """
        between = max(0.5 * pitch_mm - (self.radius_mm - self.corner_radius_mm), 0.0)
        corner = self.corner_radius_mm
        if between >= corner:
            return corner
        return corner - float(np.sqrt(corner * corner - between * between))


def ball(diameter_mm: float) -> Burr:
    """Return a ball burr.

    Raises:
        InvalidInputError: a diameter outside 0.5 to 12 mm.
    """
    return Burr(diameter_mm, 0.5 * diameter_mm)
