"""What the samples of a timed scan amount to: steadiness, shares of the limits, deviation.

Everything is measured on the samples of the trajectory by differences, nothing is taken from the
planner.
"""

from dataclasses import dataclass

import numpy as np

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.path5d import Path5D
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.trajectory.trajectory import Trajectory

STEADY = 0.99  # of the scan speed counts as the scan speed
ROUNDED_S = 1e-9


@dataclass(frozen=True, slots=True)
class TimingFigures:
    """How steadily a scan is driven, and how near it comes to each limit."""

    steady_share: float  # of the path that is driven at scan speed
    scan_duration_s: float
    ideal_duration_s: float  # of the same path at scan speed throughout
    joint_speed_share: float  # largest joint speed of the whole motion over its limit
    joint_acceleration_share: float
    path_acceleration_mm_per_s2: float  # largest of the probe during the scan, bends included
    path_jerk_mm_per_s3: float  # largest along the way during the scan
    deviation_mm: float  # largest distance of the probe from its place on the path


def timing_figures(
    trajectory: Trajectory, path: Path5D, model: RobotModel, scan_speed_mm_per_s: float
) -> TimingFigures:
    """Measure a timed scan by its samples.

    Args:
        trajectory: The whole motion, samples evenly spaced in time.
        path: The path in ``base`` that its ``path_mm`` refers to.
        model: The robot with its probe.
        scan_speed_mm_per_s: The speed that was asked for.

    Raises:
        InvalidInputError: fewer than two samples, or a motion without a scan.
    """
    times, qs = trajectory.times_s, trajectory.qs_rad
    inside = (times >= trajectory.scan_start_s - ROUNDED_S) & (
        times <= trajectory.scan_end_s + ROUNDED_S
    )
    if np.count_nonzero(inside) < 2:
        raise InvalidInputError("the trajectory has no scan: it needs two samples on the path")
    gap = float(times[1] - times[0])
    along = path.arc_length_mm()
    way = trajectory.path_mm[inside]
    steps = np.diff(way)
    places = (model.forward(qs[inside]) @ model.T_flange_probe).translations
    meant = np.stack([np.interp(way, along, p) for p in path.points_base.T], axis=1)
    steady = steps >= STEADY * scan_speed_mm_per_s * gap
    return TimingFigures(
        steady_share=float(steps[steady].sum() / along[-1]),
        scan_duration_s=trajectory.scan_end_s - trajectory.scan_start_s,
        ideal_duration_s=float(along[-1] / scan_speed_mm_per_s),
        joint_speed_share=float((np.abs(_speeds(qs, gap)) / model.speed_rad_per_s).max()),
        joint_acceleration_share=float(
            (np.abs(_changes(qs, gap)) / model.acceleration_rad_per_s2).max()
        ),
        path_acceleration_mm_per_s2=float(np.linalg.norm(_changes(places, gap), axis=1).max()),
        path_jerk_mm_per_s3=float(np.abs(np.diff(_changes(way[:, None], gap), axis=0)).max() / gap),
        deviation_mm=float(np.linalg.norm(places - meant, axis=1).max()),
    )


def _speeds(values: Floats, gap_s: float) -> Floats:
    return np.diff(values, axis=0) / gap_s


def _changes(values: Floats, gap_s: float) -> Floats:
    """Return accelerations (n, k) by differences, at rest before and afterwards."""
    still = np.zeros((1, values.shape[1]))
    return np.diff(np.vstack((still, _speeds(values, gap_s), still)), axis=0) / gap_s
