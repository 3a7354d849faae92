"""Trackers: their volumes and stated accuracies, and the markers of their tools.

Measuring volumes and stated accuracies of the trackers, in the frame ``tracker``. The frame has its
origin between the cameras and z into the volume.

Marker geometry of the tracked tools (what NDI keeps in a .rom file). The toolmarker and the 6D
pointer carry four markers in one plane; the 5D pointer three on a line, so that its roll about that
line cannot be seen. The SonoPointer is the ultrasound probe, in the hand, with a plate of four. The
base marker is a large plate: an error of its turn acts over the whole way from the robot base to
the head. The head marker is fixed to the bone, not to the clamp.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from rona_core.devices.settings import TrackerProfile
from rona_core.geometry.arrays import Bools, Floats, Vector3, readonly

DOME_BOTTOM_MM = 1200.0  # the near end of a silo is a dome that nowhere comes closer than this


@dataclass(frozen=True, slots=True)
class Silo:
    """A cylinder about z whose near end is a dome about the cameras."""

    radius_mm: float
    near_mm: float  # distance of the dome from the origin
    far_mm: float  # along z

    def contains(self, points_tracker: ArrayLike) -> Bools:
        """Return which points (n, 3) lie in the volume, (n,)."""
        p = np.asarray(points_tracker, dtype=np.float64)
        lateral = np.hypot(p[:, 0], p[:, 1])
        distance = np.sqrt((p**2).sum(axis=1))
        return (
            (lateral <= self.radius_mm)
            & (distance >= self.near_mm)
            & (p[:, 2] > 0.0)
            & (p[:, 2] <= self.far_mm)
        )

    def box(self) -> tuple[float, float, float, float]:
        """Return half width, half height, least and largest z of a box around the volume."""
        return self.radius_mm, self.radius_mm, DOME_BOTTOM_MM, self.far_mm

    def section(self, z_mm: float) -> Floats:
        """Return the outline (49, 3) across z, closed, without the dome."""
        angle = np.linspace(0.0, 2.0 * np.pi, 49)
        circle = np.stack((np.cos(angle), np.sin(angle), np.zeros(49)), axis=1)
        return self.radius_mm * circle + np.array([0.0, 0.0, z_mm])


@dataclass(frozen=True, slots=True)
class Pyramid:
    """A pyramid about z with its top cut off, higher or lower than wide."""

    near_mm: float  # along z
    far_mm: float
    near_half_mm: tuple[float, float]  # half width and half height at the near end
    far_half_mm: tuple[float, float]

    def half_mm(self, z_mm: ArrayLike) -> Floats:
        """Return half width and half height (..., 2) at depths z (...)."""
        share = (np.asarray(z_mm, dtype=np.float64) - self.near_mm) / (self.far_mm - self.near_mm)
        near, far = np.array(self.near_half_mm), np.array(self.far_half_mm)
        return near + share[..., None] * (far - near)

    def contains(self, points_tracker: ArrayLike) -> Bools:
        """Return which points (n, 3) lie in the volume, (n,)."""
        p = np.asarray(points_tracker, dtype=np.float64)
        inside = (np.abs(p[:, :2]) <= self.half_mm(p[:, 2])).all(axis=1)
        return inside & (p[:, 2] >= self.near_mm) & (p[:, 2] <= self.far_mm)

    def box(self) -> tuple[float, float, float, float]:
        """Return half width, half height, least and largest z of a box around the volume."""
        return *self.far_half_mm, self.near_mm, self.far_mm

    def section(self, z_mm: float) -> Floats:
        """Return the outline (49, 3) across z, closed: twelve points a side."""
        x, y = self.half_mm(z_mm)
        corners = np.array([[x, y], [-x, y], [-x, -y], [x, -y], [x, y]])
        places = np.linspace(0.0, 4.0, 49)
        sides = [np.interp(places, np.arange(5.0), corners[:, k]) for k in (0, 1)]
        return np.stack((*sides, np.full(49, z_mm)), axis=1)


Volume = Silo | Pyramid

SILO = Silo(radius_mm=500.0, near_mm=1400.0, far_mm=2400.0)
PYRAMID = Pyramid(950.0, 2400.0, (240.0, 224.0), (783.0, 656.0))

VOLUMES: dict[TrackerProfile, Volume] = {
    "ideal": SILO,
    "polaris": SILO,
    "white035": SILO,
    "spectra": PYRAMID,
    "vega": PYRAMID,
}

# 3D RMS error of one marker over the volume, as the maker (of "white035": the user) states it
ACCURACY_MM: dict[TrackerProfile, float] = {
    "ideal": 0.0,
    "polaris": 0.35,
    "white035": 0.35,
    "spectra": 0.25,
    "vega": 0.12,
}
# and what averaging leaves of it: white noise goes
FIELD_MM = {**ACCURACY_MM, "white035": 0.0}


@dataclass(frozen=True, slots=True, eq=False)
class MarkerGeometry:
    """Marker positions (m, 3) in the frame ``marker``, and the side that faces the tracker."""

    tool: str
    dof: Literal[5, 6]  # 6, or 5 for collinear markers
    positions_marker: Floats
    facing_marker: Vector3  # markers are seen only from this side
    nominal_tip_marker: Vector3  # where the maker says the tip is; calibration finds the real one


def _geometry(
    tool: str,
    dof: Literal[5, 6],
    positions: list[list[float]],
    facing: tuple[float, float, float],
    tip: tuple[float, float, float],
) -> MarkerGeometry:
    return MarkerGeometry(
        tool,
        dof,
        readonly(np.array(positions, dtype=np.float64)),
        readonly(np.array(facing, dtype=np.float64)),
        readonly(np.array(tip, dtype=np.float64)),
    )


# Frames: 6D tools have x, y in the plane of the markers and z towards the tracker;
# the 5D pointer has z along the line of its markers towards the tip, origin at the rear marker.
GEOMETRIES = {
    "toolmarker": _geometry(
        "toolmarker",
        6,
        [[-45.0, -28.0, 0.0], [43.0, -34.0, 0.0], [36.0, 31.0, 0.0], [-34.0, 33.0, 0.0]],
        (0.0, 0.0, 1.0),
        (0.0, -150.0, -40.0),
    ),
    "pointer6d": _geometry(
        "pointer6d",
        6,
        [[0.0, 0.0, 0.0], [0.0, 88.0, 0.0], [34.0, 52.0, 0.0], [-28.0, 35.0, 0.0]],
        (0.0, 0.0, 1.0),
        (0.0, -160.0, -20.0),
    ),
    "pointer5d": _geometry(
        "pointer5d",
        5,
        [[0.0, 0.0, 0.0], [0.0, 0.0, 60.0], [0.0, 0.0, 130.0]],
        (0.0, 0.0, 0.0),  # spheres on a stick: seen from every side
        (0.0, 0.0, 290.0),
    ),
    "basemarker": _geometry(
        "basemarker",
        6,
        [[-80.0, -50.0, 0.0], [75.0, -62.0, 0.0], [66.0, 58.0, 0.0], [-61.0, 54.0, 0.0]],
        (0.0, 0.0, 1.0),
        (0.0, 0.0, 0.0),  # it has no tip; the origin is the middle of its markers
    ),
    "sonopointer": _geometry(
        "sonopointer",
        6,
        [[0.0, 0.0, 0.0], [0.0, 96.0, 0.0], [46.0, 60.0, 0.0], [-38.0, 30.0, 0.0]],
        (0.0, 0.0, 1.0),
        (0.0, -150.0, -25.0),  # the middle of the probe's face; its axis runs along -y
    ),
    "headmarker": _geometry(
        "headmarker",
        6,
        [[-52.0, -30.0, 0.0], [44.0, -41.0, 0.0], [50.0, 33.0, 0.0], [-42.0, 38.0, 0.0]],
        (0.0, 0.0, 1.0),
        (0.0, 0.0, 0.0),  # it has no tip either
    ),
}
