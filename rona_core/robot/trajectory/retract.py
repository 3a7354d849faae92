"""Retraction of the probe after a stop, straight back along its axis."""

from rona_core.errors import NotReachableError
from rona_core.geometry.arrays import Floats
from rona_core.robot.collision.edge_check import Clear
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.trajectory.lines_back import LINE_STEP_MM, line_back
from rona_core.robot.trajectory.scan_timing import ScanSettings, timed_line
from rona_core.robot.trajectory.trajectory import Trajectory, sampled_motion

RETRACT_AFTER_STOP_MM = 30.0  # as far as the stand-off of a scan


def retract_after_stop(
    model: RobotModel, q_rad: Floats, clear: Clear, retract_mm: float = RETRACT_AFTER_STOP_MM
) -> Trajectory:
    """Plan the motion straight back along the probe axis, at the speed of an approach.

    Args:
        model: The robot with its tool.
        q_rad: Joint angles (6,) where it stands.
        clear: Maps joint angles (n, 6) to where nothing is touched that must not be.
        retract_mm: How far to go.

    Raises:
        NotReachableError: the joints or something in the way do not allow the whole way.
    """
    line, back_mm = line_back(model, q_rad, retract_mm, clear)
    if back_mm < retract_mm - LINE_STEP_MM / 2.0:
        raise NotReachableError(
            f"the probe can be drawn back by {back_mm:g} mm only from where it stands, "
            f"{retract_mm:g} mm are needed: move the robot away by hand"
        )
    return sampled_motion(timed_line(line, ScanSettings(), model))
