"""The tool in the robot's hand: miller and probe in one holder, with a marker plate."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.devices.marker_geometry import GEOMETRIES
from rona_core.geometry.arrays import as_vector3
from rona_core.geometry.pose import Pose

TOOL_TIP_FLANGE_MM = (120.0, 0.0, 60.0)
MARKER_TILT_RAD = np.deg2rad(20.0)


@dataclass(frozen=True, slots=True, eq=False)
class Tool:
    """The rigid tool: miller and probe in one holder, and the marker plate, as drawn up.

    The probe is clamped in place of the miller, its face where the tip of the miller was. The
    marker plate looks along +z of ``flange``, away from the wrist, and somewhat back up the tool.
    """

    T_flange_tip: Pose
    T_flange_probe: Pose
    T_flange_toolmarker: Pose


def perpendicular_tool(tip_flange: ArrayLike = TOOL_TIP_FLANGE_MM) -> Tool:
    """Return the tool: its axis along +x of ``flange``, the marker plate looking away from the arm.

    The plate stands above the tool opposite the tip and is tilted back, so that a tracker above
    the working place sees it.
    """
    rotation_tip = (0.0, np.pi / 2.0, 0.0)
    T_flange_tip = Pose.from_rotvec(rotation_tip, as_vector3(tip_flange, name="tip_flange"))
    c, s = np.cos(MARKER_TILT_RAD), np.sin(MARKER_TILT_RAD)
    facing_tip, up_tip = np.array((-c, 0.0, -s)), np.array((s, 0.0, -c))
    rotation = np.column_stack((np.cross(up_tip, facing_tip), up_tip, facing_tip))
    T_tip_probe = Pose.identity()  # the face of the probe sits where the tip of the miller was
    tip_toolmarker = GEOMETRIES["toolmarker"].nominal_tip_marker
    T_tip_toolmarker = Pose(rotation, -rotation @ tip_toolmarker)
    return Tool(
        T_flange_tip=T_flange_tip,
        T_flange_probe=T_flange_tip @ T_tip_probe,
        T_flange_toolmarker=T_flange_tip @ T_tip_toolmarker,
    )
