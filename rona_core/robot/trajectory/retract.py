"""Retraction of the probe straight back along its axis: after a scan, and after a stop."""

import numpy as np

from rona_core.errors import NotReachableError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.geometry.pose import Pose, Poses
from rona_core.robot.collision.edge_check import Clear
from rona_core.robot.kinematics.joint_limits import TURN_RAD, unwrap
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.trajectory.joint_moves import SAMPLE_S
from rona_core.robot.trajectory.path_timing import LINE_STEP_MM, ScanSettings, timed_line
from rona_core.robot.trajectory.trajectory import Trajectory

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
    T_base_probe = model.forward(q_rad[None])[0] @ model.T_flange_probe
    distances_mm = np.arange(LINE_STEP_MM, retract_mm + LINE_STEP_MM / 2.0, LINE_STEP_MM)
    probes = Poses.stack(
        [T_base_probe @ Pose.from_translation((0.0, 0.0, -back)) for back in distances_mm]
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
    if count <= len(distances_mm):
        raise NotReachableError(
            f"the probe can be drawn back by {max(0, count - 1) * LINE_STEP_MM:g} mm only from "
            f"where it stands, {retract_mm:g} mm are needed: move the robot away by hand"
        )
    samples = timed_line(line, ScanSettings(), model)
    times = np.arange(len(samples), dtype=np.float64) * SAMPLE_S
    return Trajectory(readonly(times), readonly(samples), 0.0, 0.0, readonly(np.zeros(len(times))))


def retract_line(
    model: RobotModel,
    q_contact_rad: Floats,
    branch: int,
    standoff_mm: float,
    clear: Clear | None,
) -> Floats:
    """Return joint angles (m, 6) straight back along the probe axis, ``LINE_STEP_MM`` apart.

    The line ends at the stand-off, or earlier where the joints allow no more or something is
    touched.

    Raises:
        NotReachableError: not even the shortest stand-off is possible.
    """
    T_base_probe = model.forward(q_contact_rad[None])[0] @ model.T_flange_probe
    backs_mm = np.arange(0.0, standoff_mm + LINE_STEP_MM / 2.0, LINE_STEP_MM)
    away = Poses.stack([Pose.from_translation((0.0, 0.0, -back)) for back in backs_mm])
    rotations = T_base_probe.rotation @ away.rotations
    places = away.translations @ T_base_probe.rotation.T + T_base_probe.translation
    solutions = model.inverse(Poses(rotations, places) @ model.T_flange_probe.inv())
    qs = unwrap(np.vstack((q_contact_rad, solutions.qs_rad[:, branch])))[1:]
    possible = solutions.valid[:, branch] & (model.limits.clearance_rad(qs).min(axis=1) >= 0.0)
    if clear is not None:
        possible &= clear(qs)
    count = len(qs) if possible.all() else int(np.argmin(possible))
    if (count - 1) * LINE_STEP_MM < LEAST_STANDOFF_MM:
        raise NotReachableError(
            f"the probe can only be drawn back by {max(0, count - 1) * LINE_STEP_MM:g} mm from "
            f"one end of the path, {LEAST_STANDOFF_MM:g} mm are needed"
        )
    return qs[:count].copy()
