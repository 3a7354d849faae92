"""Marker geometry of the tracked tools (what NDI keeps in a .rom file).

The toolmarker and the 6D pointer carry four markers in one plane; the 5D pointer three on a line,
so that its roll about that line cannot be seen. The SonoPointer is the ultrasound probe, in the
hand, with a plate of four. The base marker is a large plate: an error of its turn acts over the
whole way from the robot base to the head. The head marker is fixed to the bone, not to the clamp.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rona_core.geometry.arrays import Floats, Vector3, readonly


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
