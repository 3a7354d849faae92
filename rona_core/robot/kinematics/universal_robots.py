"""Arms of Universal Robots, read from the descriptions of example-robot-data.

Lengths, ranges and speeds stand in the URDF file of the package; none of them is copied here.
Accelerations are assumed, as the file has none. See docs/algorithms/robot/universal_robots.md.
"""

import sys
from collections.abc import Mapping
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from rona_core.devices.robots import UNIVERSAL
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import readonly
from rona_core.robot.kinematics.parameter_sources import Figure, arrays_of, of_one_type, overridden
from rona_core.robot.kinematics.pinocchio_model import MM_PER_M, read_urdf
from rona_core.robot.kinematics.robot_model import (
    TOOL_TIP_FLANGE_MM,
    JointLimits,
    RobotModel,
    WorkArea,
    perpendicular_tool,
)
from rona_core.robot.kinematics.wrists import ParallelArm

PACKAGE = "example-robot-data"
FOLDER = Path("share") / PACKAGE / "robots" / "ur_description" / "urdf"
AXES = "ZYYYZY"
PATTERN = (  # which components of each offset the family has: joints 1 to 6 and the flange
    (0, 0, 1),
    (0, 1, 0),
    (0, 1, 1),
    (0, 1, 1),
    (0, 1, 0),
    (0, 0, 1),
    (0, 1, 0),
)
ABOUT_Y = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0))  # by a right angle
ABOUT_X = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0))  # by one the other way
STILL = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
ROTATIONS = np.array((STILL, ABOUT_Y, STILL, ABOUT_Y, STILL, STILL, ABOUT_X))  # at q = 0
CLOSE_MM, CLOSE = 1e-6, 1e-9  # rounding of the file's numbers
ROOM_LOWER_DEG = (-135.0, -180.0, -360.0, -360.0, -360.0, -180.0)
ROOM_UPPER_DEG = (135.0, 0.0, 360.0, 360.0, 360.0, 0.0)
ROOM = "work before the base, elbow above the table, tool hanging below the wrist"
TO_TRACKER = (0.966, 0.259, 0.0)


def ur(
    name: str, overrides: Mapping[str, object] | None = None, *, urdf: str | Path | None = None
) -> RobotModel:
    """Return an arm of this family, from its own description or from another file.

    Args:
        name: One of ``devices.robots.UNIVERSAL``.
        overrides: Better figures by the keys of ``provenance``.
        urdf: A description of the same build. Where its lengths are those of another type, the
            arm is named after the file; limits of acceleration, home and work area stay those of
            ``name``, assumed.

    Raises:
        InvalidInputError: no usable description, or an override is no good.
    """
    own = urdf_path(name)
    path = own if urdf is None else Path(urdf)
    arm, drawn = parallel_arm(path), parallel_arm(own)
    values = arrays_of(overridden(provenance(name, path), overrides))
    lacking = UNIVERSAL[name]
    return RobotModel(
        name=name if of_one_type(astuple(arm), astuple(drawn)) else f"arm of {path.name}",
        arm=arm,
        limits=JointLimits(
            lower_rad=np.deg2rad(np.maximum(values["lower_deg"], values["room_lower_deg"])),
            upper_rad=np.deg2rad(np.minimum(values["upper_deg"], values["room_upper_deg"])),
            speed_rad_per_s=np.deg2rad(values["speed_deg_per_s"]),
            acceleration_rad_per_s2=values["acceleration_rad_per_s2"],
        ),
        home_rad=readonly(np.deg2rad(values["home_deg"])),
        tool=perpendicular_tool(values["tip_flange_mm"]),
        held_apart=(("forearm", "wrist 2"),),  # the wrist passes beside the forearm
        work_area=WorkArea(lacking.region_base, lacking.pivot_base, TO_TRACKER),
        urdf=str(path),
    )


def urdf_path(name: str) -> Path:
    """Return the description of an arm in the package example-robot-data, wherever it is.

    Raises:
        InvalidInputError: it is not installed.
    """
    packages = (Path(folder) / "cmeel.prefix" for folder in sys.path)
    for prefix in (*packages, *Path(pin.__file__).parents):  # those of pip, and of conda
        path = prefix / FOLDER / f"{name}_robot.urdf"
        if path.is_file():
            return path
    raise InvalidInputError(
        f"the description of the {name} is not installed: it needs the package {PACKAGE} "
        f"(pip install {PACKAGE})"
    )


def provenance(name: str, path: str | Path) -> tuple[Figure, ...]:
    """Return the table of figures of an arm whose description lies at ``path``.

    Raises:
        InvalidInputError: the file cannot be read, or describes an arm of another build.
    """
    arm, (described, _) = parallel_arm(path), read_urdf(path)
    source, lacking = Path(path).name, UNIVERSAL[name]
    if Path(path) == urdf_path(name):
        source += f" of {PACKAGE}"
    lengths = [
        Figure(words, "", (getattr(arm, field),), "mm", "description", source)
        for words, field in (
            ("base to shoulder", "shoulder_mm"),
            ("column to upper arm, sideways", "shoulder_side_mm"),
            ("upper arm", "upper_arm_mm"),
            ("upper arm to forearm, sideways", "elbow_side_mm"),
            ("forearm", "forearm_mm"),
            ("forearm to axis 5, sideways", "wrist_side_mm"),
            ("axis 4 to axis 6", "wrist_mm"),
            ("axis 5 to flange", "flange_mm"),
        )
    ]
    stated = [
        Figure(words, key, _degrees(values), unit, "description", source)
        for words, key, values, unit in (
            ("lower limit", "lower_deg", described.lowerPositionLimit, "deg"),
            ("upper limit", "upper_deg", described.upperPositionLimit, "deg"),
            ("speed", "speed_deg_per_s", described.velocityLimit, "deg/s"),
        )
    ]
    chosen = [
        Figure(words, key, values, unit, "assumed", why)
        for words, key, values, unit, why in (
            ("lower limit in this room", "room_lower_deg", ROOM_LOWER_DEG, "deg", ROOM),
            ("upper limit in this room", "room_upper_deg", ROOM_UPPER_DEG, "deg", ROOM),
            (
                "acceleration",
                "acceleration_rad_per_s2",
                lacking.acceleration_rad_per_s2,
                "rad/s^2",
                "the description has none; chosen well below what such arms do",
            ),
            (
                "tool tip on the flange",
                "tip_flange_mm",
                TOOL_TIP_FLANGE_MM,
                "mm",
                "the tool of the RX90",
            ),
            (
                "home",
                "home_deg",
                lacking.home_deg,
                "deg",
                "tool pointing down, above the work",
            ),
        )
    ]
    return (*lengths, *stated, *chosen)


def parallel_arm(path: str | Path) -> ParallelArm:
    """Return the lengths of an arm with three parallel axes from its description.

    Raises:
        InvalidInputError: the file cannot be read, or describes an arm of another build.
    """
    described, flange = read_urdf(path)
    placements = [*list(described.jointPlacements)[1:], described.frames[flange].placement]
    offsets = MM_PER_M * np.array([placement.translation for placement in placements])
    rotations = np.array([placement.rotation for placement in placements])
    axes = "".join(joint.shortname()[-1] for joint in list(described.joints)[1:])
    off = np.where(np.array(PATTERN) == 1, 0.0, offsets)
    if axes != AXES or np.abs(off).max() > CLOSE_MM or np.abs(rotations - ROTATIONS).max() > CLOSE:
        raise InvalidInputError(
            f"{path}: not an arm with axes {AXES}, three parallel, as those of the UR family"
        )
    return ParallelArm(
        shoulder_mm=float(offsets[0, 2]),
        shoulder_side_mm=float(offsets[1, 1]),
        upper_arm_mm=float(offsets[2, 2]),
        elbow_side_mm=float(offsets[2, 1]),
        forearm_mm=float(offsets[3, 2]),
        wrist_side_mm=float(offsets[3, 1] + offsets[4, 1]),
        wrist_mm=float(offsets[5, 2]),
        flange_mm=float(offsets[6, 1]),
    )


def _degrees(angles_rad: Any) -> tuple[float, ...]:
    return tuple(np.rad2deg(angles_rad).tolist())
