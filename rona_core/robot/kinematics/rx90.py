"""The Stäubli RX90: lengths and limits, and where each figure comes from.

No data sheet of the maker was at hand. Every figure carries its source and how far to trust it,
so that they can be replaced by those of the real robot. See docs/algorithms/robot/rx90.md.
"""

from collections.abc import Mapping
from dataclasses import astuple, fields

import numpy as np

from rona_core.geometry.arrays import Floats, readonly
from rona_core.robot.kinematics.parameter_sources import Figure, arrays_of, of_one_type, overridden
from rona_core.robot.kinematics.robot_model import (
    TOOL_TIP_FLANGE_MM,
    JointLimits,
    RobotModel,
    perpendicular_tool,
)
from rona_core.robot.kinematics.wrists import SphericalWristArm

MANUAL = "drawing of the RX90B manual, Figure 2.3 (copy in sdobz/staubli_robot)"
LIMITS = "rx90l.py of dimpap5555/Staubli-RX90L-Simulator; luismarzo/rx90 agrees in J1 to J4 and J6"
SPEEDS = "joint_limits.yaml of luismarzo/rx90; the smaller of two sets in circulation"
NONE_FOUND = "no source found; chosen well below what arms of this size do"
CHOSEN = "tool perpendicular to the flange as in Figure 1 of the paper; lengths chosen"
OTHER = "arm built like an rx90"
RESTING = "tool pointing down, above the working space"

PROVENANCE = (
    Figure("base to shoulder", "shoulder_mm", (420.0,), "mm", "drawing", MANUAL),
    Figure("upper arm", "upper_arm_mm", (450.0,), "mm", "drawing", MANUAL),
    Figure("forearm", "forearm_mm", (450.0,), "mm", "drawing", MANUAL),
    Figure("wrist centre to flange", "flange_mm", (85.0,), "mm", "drawing", MANUAL),
    Figure(
        "lower limit",
        "lower_deg",
        (-160.0, -137.5, -142.5, -270.0, -105.0, -270.0),
        "deg",
        "two sources",
        LIMITS,
    ),
    Figure(
        "upper limit",
        "upper_deg",
        (160.0, 137.5, 142.5, 270.0, 120.0, 270.0),
        "deg",
        "two sources",
        LIMITS,
    ),
    Figure(
        "speed",
        "speed_deg_per_s",
        (236.0, 200.0, 286.0, 401.0, 320.0, 580.0),
        "deg/s",
        "one source",
        SPEEDS,
    ),
    Figure(
        "acceleration",
        "acceleration_rad_per_s2",
        (5.0, 5.0, 7.0, 10.0, 10.0, 15.0),
        "rad/s^2",
        "assumed",
        NONE_FOUND,
    ),
    Figure("tool tip on the flange", "tip_flange_mm", TOOL_TIP_FLANGE_MM, "mm", "assumed", CHOSEN),
    Figure("home", "home_deg", (15.0, -25.0, 130.0, 0.0, -15.0, 0.0), "deg", "assumed", RESTING),
)


def rx90(overrides: Mapping[str, object] | None = None) -> RobotModel:
    """Return the RX90 with the tool of the paper: perpendicular to the flange.

    Args:
        overrides: Better figures by the keys of ``PROVENANCE``. An arm with lengths of another type
            is named ``OTHER``.

    Raises:
        InvalidInputError: an unknown key, or values that make no robot.
    """
    values = arrays_of(overridden(PROVENANCE, overrides))
    arm, drawn = _arm(values), _arm(arrays_of(PROVENANCE))
    return RobotModel(
        name="rx90" if of_one_type(astuple(arm), astuple(drawn)) else OTHER,
        arm=arm,
        limits=JointLimits(
            lower_rad=np.deg2rad(values["lower_deg"]),
            upper_rad=np.deg2rad(values["upper_deg"]),
            speed_rad_per_s=np.deg2rad(values["speed_deg_per_s"]),
            acceleration_rad_per_s2=values["acceleration_rad_per_s2"],
        ),
        home_rad=readonly(np.deg2rad(values["home_deg"])),
        tool=perpendicular_tool(values["tip_flange_mm"]),
        held_apart=(("forearm", "flange"),),
    )


def _arm(values: Mapping[str, Floats]) -> SphericalWristArm:
    lengths = {field.name: float(values[field.name][0]) for field in fields(SphericalWristArm)}
    return SphericalWristArm(**lengths)
