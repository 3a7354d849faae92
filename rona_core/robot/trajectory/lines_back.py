"""Straight lines back along the axis of the tool: how it leaves the bone, and comes to it."""

import numpy as np

from rona_core.errors import NotReachableError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Poses
from rona_core.robot.collision.edge_check import Clear
from rona_core.robot.kinematics.robot_model import RobotModel

LINE_STEP_MM = 1.0  # between the places of a straight line
LEAST_STANDOFF_MM = 5.0  # of a scan, at both ends of the path
JUMP_RAD = float(np.deg2rad(10.0))  # within a millimetre: another branch of the arm


def retract_line(
    model: RobotModel, q_contact_rad: Floats, standoff_mm: float, clear: Clear | None
) -> Floats:
    """Return joint angles (m, 6) straight back along the probe axis, ``LINE_STEP_MM`` apart.

    The line ends at the stand-off, or earlier where the joints allow no more or something is
    touched.

    Raises:
        NotReachableError: not even the shortest stand-off is possible.
    """
    line, back_mm = line_back(model, q_contact_rad, standoff_mm, clear)
    require_standoff(back_mm)
    return line


def require_standoff(back_mm: float) -> None:
    """Raise NotReachableError where a line back is shorter than the shortest stand-off."""
    if back_mm < LEAST_STANDOFF_MM:
        raise NotReachableError(
            f"the tool can only be drawn back by {back_mm:g} mm from "
            f"one end of the path, {LEAST_STANDOFF_MM:g} mm are needed"
        )


def line_back(
    model: RobotModel, q_rad: Floats, most_mm: float, clear: Clear | None
) -> tuple[Floats, float]:
    """Return joint angles (m, 6) straight back as far as possible, and that distance."""
    return clear_part(lines_back(model, q_rad[None], most_mm)[0], clear)


def clear_part(line: Floats, clear: Clear | None) -> tuple[Floats, float]:
    """Return how much of a line back (m, 6) touches nothing, and that distance."""
    free = np.ones(len(line), dtype=np.bool_) if clear is None else clear(line)
    line = line if free.all() else line[: int(np.argmin(free))]
    return line, max(0, len(line) - 1) * LINE_STEP_MM


def lines_back(model: RobotModel, qs_rad: Floats, most_mm: float) -> list[Floats]:
    """Return joint angles (m, 6) straight back from each of k postures (k, 6), whatever is there.

    Each begins with its posture and goes as far as the joints allow.
    """
    Ts_base_probe = model.forward(qs_rad) @ model.T_flange_probe
    backs_mm = np.arange(LINE_STEP_MM, most_mm + LINE_STEP_MM / 2.0, LINE_STEP_MM)
    axes = Ts_base_probe.rotations[:, :, 2]
    places = Ts_base_probe.translations[:, None] - backs_mm[:, None] * axes[:, None]
    rotations = np.repeat(Ts_base_probe.rotations, len(backs_mm), axis=0)
    probes = Poses.unchecked(rotations, places.reshape(-1, 3))
    ways = model.follow_each(probes @ model.T_flange_probe.inv(), qs_rad, JUMP_RAD)
    return [np.vstack((q_rad, way)) for q_rad, way in zip(qs_rad, ways, strict=True)]
