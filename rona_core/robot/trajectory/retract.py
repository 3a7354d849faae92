"""Draw the probe straight back along its axis from where it stands on the bone."""

import numpy as np

from rona_core.errors import NotReachableError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.geometry.pose import Pose, Poses
from rona_core.robot.collision.edge_check import Clear
from rona_core.robot.kinematics.joint_limits import TURN_RAD
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.trajectory.joint_moves import SAMPLE_S
from rona_core.robot.trajectory.scan_timing import LINE_STEP_MM, ScanSettings, timed_line
from rona_core.robot.trajectory.trajectory import Trajectory

BACK_MM = 30.0  # as far as the stand-off of a scan
JUMP_RAD = float(np.deg2rad(10.0))  # within a millimetre: another branch of the arm


def draw_back(
    model: RobotModel, q_rad: Floats, clear: Clear, back_mm: float = BACK_MM
) -> Trajectory:
    """Return the motion straight back along the probe axis, at the speed of an approach.

    Args:
        model: The robot with its tool.
        q_rad: Joint angles (6,) where it stands.
        clear: Tells for joint angles (n, 6) where nothing is touched that must not be.
        back_mm: How far to go.

    Raises:
        NotReachableError: the joints or something in the way do not allow the whole way.
    """
    T_base_probe = model.forward(q_rad[None])[0] @ model.T_flange_probe
    backs_mm = np.arange(LINE_STEP_MM, back_mm + LINE_STEP_MM / 2.0, LINE_STEP_MM)
    probes = Poses.stack(
        [T_base_probe @ Pose.from_translation((0.0, 0.0, -back)) for back in backs_mm]
    )
    found = model.inverse(probes @ model.T_flange_probe.inv())
    qs = [q_rad]
    for solutions, valid in zip(found.qs_rad, found.valid, strict=True):
        steps = solutions - qs[-1]
        steps -= TURN_RAD * np.round(steps / TURN_RAD)
        size = np.where(valid, np.abs(steps).max(axis=1), np.inf)
        nearest = int(np.argmin(size))
        q_next = qs[-1] + steps[nearest]
        if size[nearest] > JUMP_RAD or model.limits.clearance_rad(q_next).min() < 0.0:
            break
        qs.append(q_next)
    line = np.array(qs)
    free = clear(line)
    count = len(line) if free.all() else int(np.argmin(free))
    if count <= len(backs_mm):
        raise NotReachableError(
            f"the probe can be drawn back by {max(0, count - 1) * LINE_STEP_MM:g} mm only from "
            f"where it stands, {back_mm:g} mm are needed: move the robot away by hand"
        )
    samples = timed_line(line, ScanSettings(), model)
    times = np.arange(len(samples), dtype=np.float64) * SAMPLE_S
    return Trajectory(readonly(times), readonly(samples), 0.0, 0.0, readonly(np.zeros(len(times))))
