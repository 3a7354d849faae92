"""Retraction of the probe straight back along its axis: after a scan, and after a stop."""

import numpy as np

from rona_core.errors import NotReachableError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Poses
from rona_core.robot.collision.edge_check import Clear
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.trajectory.path_timing import LINE_STEP_MM, ScanSettings, timed_line
from rona_core.robot.trajectory.trajectory import Trajectory, sampled_motion

RETRACT_AFTER_STOP_MM = 30.0  # as far as the stand-off of a scan
LEAST_STANDOFF_MM = 5.0  # of a scan, at both ends of the path
JUMP_RAD = float(np.deg2rad(10.0))  # within a millimetre: another branch of the arm


def retract_after_stop(
    model: RobotModel, q_rad: Floats, clear: Clear, retract_mm: float = RETRACT_AFTER_STOP_MM
) -> Trajectory:
    """Plan the motion straight back along the probe axis, at the speed of an approach.

    Args:
        model: The robot with its tool.
        q_rad: Joint angles (6,) where it stands.
        clear: Tells for joint angles (n, 6) where nothing is touched that must not be.
        retract_mm: How far to go.

    Raises:
        NotReachableError: the joints or something in the way do not allow the whole way.
    """
    line, back_mm = _line_back(model, q_rad, retract_mm, clear)
    if back_mm < retract_mm - LINE_STEP_MM / 2.0:
        raise NotReachableError(
            f"the probe can be drawn back by {back_mm:g} mm only from where it stands, "
            f"{retract_mm:g} mm are needed: move the robot away by hand"
        )
    return sampled_motion(timed_line(line, ScanSettings(), model))


def retract_line(
    model: RobotModel, q_contact_rad: Floats, standoff_mm: float, clear: Clear | None
) -> Floats:
    """Return joint angles (m, 6) straight back along the probe axis, ``LINE_STEP_MM`` apart.

    The line ends at the stand-off, or earlier where the joints allow no more or something is
    touched.

    Raises:
        NotReachableError: not even the shortest stand-off is possible.
    """
    line, back_mm = _line_back(model, q_contact_rad, standoff_mm, clear)
    if back_mm < LEAST_STANDOFF_MM:
        raise NotReachableError(
            f"the probe can only be drawn back by {back_mm:g} mm from "
            f"one end of the path, {LEAST_STANDOFF_MM:g} mm are needed"
        )
    return line


def _line_back(
    model: RobotModel, q_rad: Floats, most_mm: float, clear: Clear | None
) -> tuple[Floats, float]:
    """Return joint angles (m, 6) straight back as far as possible, and that distance."""
    T_base_probe = model.forward(q_rad[None])[0] @ model.T_flange_probe
    backs_mm = np.arange(LINE_STEP_MM, most_mm + LINE_STEP_MM / 2.0, LINE_STEP_MM)
    places = T_base_probe.translation - backs_mm[:, None] * T_base_probe.rotation[:, 2]
    probes = Poses(np.repeat(T_base_probe.rotation[None], len(backs_mm), axis=0), places)
    line = np.vstack((q_rad, model.follow(probes @ model.T_flange_probe.inv(), q_rad, JUMP_RAD)))
    free = np.ones(len(line), dtype=np.bool_) if clear is None else clear(line)
    line = line if free.all() else line[: int(np.argmin(free))]
    return line, max(0, len(line) - 1) * LINE_STEP_MM
