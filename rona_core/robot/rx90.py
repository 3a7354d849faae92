"""The Stäubli RX90: lengths and limits, and where each figure comes from.

No data sheet of the maker was at hand. Every figure carries its source and how far to trust it,
so that whoever has the real robot can put in better ones. See docs/algorithms/rx90.md.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rona_core.arrays import readonly
from rona_core.devices.markers import GEOMETRIES
from rona_core.geometry.pose import Pose
from rona_core.robot.arm import SphericalWristArm
from rona_core.robot.limits import JointLimits
from rona_core.robot.model import RobotModel, Tool

Trust = Literal["drawing", "two sources", "one source", "assumed"]

MANUAL = "drawing of the RX90B manual, Figure 2.3 (copy in sdobz/staubli_robot)"
LIMITS = "rx90l.py of dimpap5555/Staubli-RX90L-Simulator; luismarzo/rx90 agrees in J1 to J4 and J6"
SPEEDS = "joint_limits.yaml of luismarzo/rx90; the smaller of two sets in circulation"


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure of the model and its origin; joint figures in degrees, joint 1 first."""

    name: str
    values: tuple[float, ...]
    unit: str
    trust: Trust
    source: str


PROVENANCE = (
    Figure("base to shoulder", (420.0,), "mm", "drawing", MANUAL),
    Figure("upper arm", (450.0,), "mm", "drawing", MANUAL),
    Figure("forearm", (450.0,), "mm", "drawing", MANUAL),
    Figure("wrist centre to flange", (85.0,), "mm", "drawing", MANUAL),
    Figure(
        "lower limit",
        (-160.0, -137.5, -142.5, -270.0, -105.0, -270.0),
        "deg",
        "two sources",
        LIMITS,
    ),
    Figure("upper limit", (160.0, 137.5, 142.5, 270.0, 120.0, 270.0), "deg", "two sources", LIMITS),
    Figure("speed", (236.0, 200.0, 286.0, 401.0, 320.0, 580.0), "deg/s", "one source", SPEEDS),
    Figure(
        "acceleration",
        (5.0, 5.0, 7.0, 10.0, 10.0, 15.0),
        "rad/s^2",
        "assumed",
        "no source found; chosen well below what arms of this size do",
    ),
    Figure(
        "tool tip on the flange",
        (120.0, 0.0, 60.0),
        "mm",
        "assumed",
        "tool perpendicular to the flange as in Figure 1 of the paper; lengths chosen",
    ),
)

HOME_DEG = (15.0, -25.0, 130.0, 0.0, -15.0, 0.0)  # tool pointing down, above the working space
TOOL_TIP_FLANGE_MM = (120.0, 0.0, 60.0)
MARKER_TILT_RAD = np.deg2rad(20.0)


def rx90() -> RobotModel:
    """Return the RX90 with the tool of the paper: perpendicular to the flange."""
    figures = {figure.name: np.array(figure.values) for figure in PROVENANCE}
    return RobotModel(
        name="rx90",
        arm=SphericalWristArm(
            shoulder_mm=float(figures["base to shoulder"][0]),
            upper_arm_mm=float(figures["upper arm"][0]),
            forearm_mm=float(figures["forearm"][0]),
            flange_mm=float(figures["wrist centre to flange"][0]),
        ),
        limits=JointLimits(
            lower_rad=np.deg2rad(figures["lower limit"]),
            upper_rad=np.deg2rad(figures["upper limit"]),
            speed_rad_per_s=np.deg2rad(figures["speed"]),
            acceleration_rad_per_s2=figures["acceleration"],
        ),
        home_rad=readonly(np.deg2rad(np.array(HOME_DEG))),
        tool=perpendicular_tool(),
    )


def perpendicular_tool() -> Tool:
    """Return the tool: its axis along +x of ``flange``, the marker plate looking away from the arm.

    The plate stands above the tool opposite the tip and is tilted back, so that a tracker above
    the working place sees it.
    """
    T_flange_tip = Pose.from_rotvec((0.0, np.pi / 2.0, 0.0), TOOL_TIP_FLANGE_MM)
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
