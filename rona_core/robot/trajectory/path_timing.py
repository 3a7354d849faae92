"""Timing of straight and curved pieces of a scan motion, sampled so that all limits are kept."""

from dataclasses import dataclass

import numpy as np

from rona_core.devices.settings import require
from rona_core.geometry.arrays import Floats
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.trajectory.joint_moves import sample_times
from rona_core.robot.trajectory.time_parameterization import (
    SpeedLimits,
    TimedPath,
    parameterize_time,
)
from rona_core.robot.trajectory.trajectory import SAMPLE_S

LINE_STEP_MM = 1.0  # between the places of a straight line
SLOWER = 6  # times that a motion is slowed down until its samples keep all limits
SHARE_ASKED = 1.0 - 1e-9


@dataclass(frozen=True, slots=True)
class ScanSettings:
    """How the scan path is driven."""

    scan_speed_mm_per_s: float = 20.0
    path_acceleration_mm_per_s2: float = 250.0
    jerk_mm_per_s3: float = 2500.0
    standoff_mm: float = 30.0  # straight along the probe axis, before and after contact
    approach_speed_mm_per_s: float = 15.0
    corner_deviation_mm: float = 0.2  # the probe may cut corners by this much

    def __post_init__(self) -> None:
        for name in ("scan_speed_mm_per_s", "approach_speed_mm_per_s"):
            value = getattr(self, name)
            require(0.5 <= value <= 100.0, f"{name} must be 0.5 to 100, not {value}")
        for name in ("path_acceleration_mm_per_s2", "jerk_mm_per_s3"):
            value = getattr(self, name)
            require(10.0 <= value <= 1e5, f"{name} must be 10 to 100000, not {value}")
        require(
            5.0 <= self.standoff_mm <= 200.0,
            f"standoff_mm must be 5 to 200, not {self.standoff_mm}",
        )
        require(
            0.05 <= self.corner_deviation_mm <= 0.25,  # the verifier allows 0.3 in all
            f"corner_deviation_mm must be 0.05 to 0.25, not {self.corner_deviation_mm}",
        )


def speed_limits(settings: ScanSettings, speed_mm_per_s: float) -> SpeedLimits:
    """Return the limits along a path that is driven at some speed."""
    return SpeedLimits(
        speed_mm_per_s, settings.path_acceleration_mm_per_s2, settings.jerk_mm_per_s3
    )


def sample_path(
    way_mm: Floats, qs_rad: Floats, points_base: Floats, limits: SpeedLimits, model: RobotModel
) -> tuple[Floats, Floats]:
    """Return way (m,) and joints (m, 6) at samples ``SAMPLE_S`` apart, from rest to rest.

    Limits are planned with some reserve at every point of the way. Should the samples, driven
    linearly, still exceed one of them, the motion is slowed down until they do not.
    """
    timed = parameterize_time(way_mm, qs_rad, points_base, limits, model.limits)
    duration_s = timed.duration_s
    ways, qs = _sampled(timed, duration_s, qs_rad)
    for _ in range(SLOWER):
        speeds = np.diff(qs, axis=0) / SAMPLE_S
        resting = np.vstack((np.zeros(6), speeds, np.zeros(6)))
        gains = np.abs(np.diff(resting, axis=0)) / SAMPLE_S
        tips = (model.forward(qs) @ model.T_flange_probe).translations
        moving = np.vstack((np.zeros(3), np.diff(tips, axis=0) / SAMPLE_S, np.zeros(3)))
        felt = np.linalg.norm(np.diff(moving, axis=0), axis=1).max() / SAMPLE_S
        excess = max(
            float((np.abs(speeds) / model.speed_rad_per_s).max()) ** 2,
            float((gains / model.acceleration_rad_per_s2).max()),
            float(felt / limits.acceleration_mm_per_s2),
        )
        if excess <= SHARE_ASKED:
            break
        duration_s *= 1.001 * np.sqrt(excess)
        ways, qs = _sampled(timed, duration_s, qs_rad)
    return ways, qs


def _sampled(timed: TimedPath, duration_s: float, qs_rad: Floats) -> tuple[Floats, Floats]:
    """Return way (m,) and joints (m, 6) at whole samples, a little slower to fill the last one."""
    times = sample_times(duration_s)
    ways = timed.way_at(times * (timed.duration_s / times[-1]))
    ways[0], ways[-1] = timed.way_mm[[0, -1]]
    qs = timed.joints(ways)
    qs[0], qs[-1] = qs_rad[0], qs_rad[-1]
    return ways, qs


def timed_line(qs_rad: Floats, settings: ScanSettings, model: RobotModel) -> Floats:
    """Return samples (m, 6) of a straight line, driven at approach speed from rest to rest."""
    points = (model.forward(qs_rad) @ model.T_flange_probe).translations
    way_mm = LINE_STEP_MM * np.arange(len(qs_rad), dtype=np.float64)
    slow = speed_limits(settings, settings.approach_speed_mm_per_s)
    return sample_path(way_mm, qs_rad, points, slow, model)[1]
