"""Burrs, and the settings by which they mill."""

from dataclasses import dataclass

import numpy as np

from rona_core.devices.limits import require, require_within
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


BALL_5, BALL_2 = ball(5.0), ball(2.0)


@dataclass(frozen=True, slots=True)
class MillingSettings:
    """How a bed is milled. The defaults are assumed but for the pitch (Federspil 2003)."""

    burr: Burr = BALL_5
    rim_burr: Burr | None = BALL_2  # for the corner that the burr leaves; None: no rim pass
    layer_mm: float = 0.5  # most depth of one layer
    pitch: float = 0.5  # most distance of neighbouring rings, as a share of the burr's radius
    over_depth_mm: float = 0.3  # every floor is so much deeper than the implant
    side_clearance_mm: float = 0.3  # every wall is so far off the implant
    tilt_deg: float = 15.0  # of a ball's axis, its pole behind; other burrs are held upright
    ramp_deg: float = 5.0  # slope at which the burr goes down into a layer
    retract_mm: float = 5.0  # above the bone between cuts

    def __post_init__(self) -> None:
        require_within("layer_mm", self.layer_mm, 0.05, 3.0)
        require_within("pitch", self.pitch, 0.05, 1.0)
        require_within("over_depth_mm", self.over_depth_mm, 0.0, 2.0)
        require_within("side_clearance_mm", self.side_clearance_mm, 0.0, 3.0)
        require_within("tilt_deg", self.tilt_deg, 0.0, 45.0)
        require_within("ramp_deg", self.ramp_deg, 0.5, 20.0)
        require_within("retract_mm", self.retract_mm, 1.0, 50.0)
        for burr in self.burrs:
            require(
                self.layer_mm <= burr.radius_mm,
                f"a layer of {self.layer_mm:g} mm is thicker than the radius of a burr of "
                f"{burr.diameter_mm:g} mm: take thinner layers",
            )
            require(
                burr.is_ball or self.tilt_deg == 0.0,
                f"a burr with a corner radius of {burr.corner_radius_mm:g} mm at "
                f"{burr.diameter_mm:g} mm is no ball, and tilted it would cut steps: set tilt_deg "
                "to 0, or take a ball",
            )
        require(
            self.tilt_deg == 0.0 or self.ramp_deg < self.tilt_deg,
            f"ramp_deg {self.ramp_deg:g} must be below tilt_deg {self.tilt_deg:g}, or the pole of "
            "the burr cuts while it goes down",
        )
        require(
            self.rim_burr is None or self.rim_burr.diameter_mm <= self.burr.diameter_mm,
            "the rim burr must not be larger than the burr",
        )

    @property
    def burrs(self) -> tuple[Burr, ...]:
        """Return the burrs in the order of their use."""
        return (self.burr,) if self.rim_burr is None else (self.burr, self.rim_burr)

    @property
    def tilt_rad(self) -> float:
        """Return the tilt of a ball's axis."""
        return float(np.deg2rad(self.tilt_deg))
