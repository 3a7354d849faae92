"""Timing of scan paths over sphere patches: CPU time, limits of the samples, steadiness."""

from collections.abc import Callable

import numpy as np

from benchmarks.metric import Metric, Progress, cpu_ms
from benchmarks.reference.trajectory_figures import TimingFigures, timing_figures
from rona_core.geometry.arrays import Floats
from rona_core.geometry.path5d import Path5D
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.redundancy.constant_roll import (
    choose_constant_roll,
    evaluate_constant_rolls,
    working_set_deg,
)
from rona_core.robot.redundancy.margins import MarginLimits, joint_path
from rona_core.robot.trajectory.scan_timing import ScanSettings, time_scan
from rona_core.robot.trajectory.time_parameterization import blend_corners
from rona_core.robot.trajectory.trajectory import Trajectory
from tests.scenes.patch_scenes import N_ROLLS, scene_model, scene_path

FEASIBLE_SCENES = ("S0", "S1", "S2", "S5")
SPEEDS = (5.0, 20.0, 50.0)
EXCESS = 1.0 + 1e-6


def run(progress: Progress) -> list[Metric]:
    """Return CPU times and what the samples of the timed motions amount to."""
    model = scene_model()
    metrics: list[Metric] = []
    worst: list[TimingFigures] = []
    for scene in FEASIBLE_SCENES:
        progress(f"scene {scene}")
        path = scene_path(scene, 306)
        qs_rad = _followed(path, model)
        for speed in SPEEDS:
            settings = ScanSettings(scan_speed_mm_per_s=speed)
            drive = _driver(path, qs_rad, model, settings)
            figures = timing_figures(drive(), path, model, speed)
            worst.append(figures)
            if scene == "S0":
                label = f"S0-306 at {speed:g} mm/s"
                share = figures.steady_share
                metrics.append(Metric(f"{label}: timing, CPU", cpu_ms(drive), "ms", "lower", 100.0))
                metrics.append(Metric(f"{label}: path at scan speed", share, "share", "higher"))
                metrics.append(
                    Metric(f"{label}: scan duration", figures.scan_duration_s, "s", "lower")
                )
                if speed == SPEEDS[1]:
                    metrics.append(_toppra(path, qs_rad, model, speed))
    limits = ScanSettings()
    shares = (
        ("joint speed", max(f.joint_speed_share for f in worst)),
        ("joint acceleration", max(f.joint_acceleration_share for f in worst)),
        (
            "path acceleration",
            max(f.path_acceleration_mm_per_s2 for f in worst) / limits.path_acceleration_mm_per_s2,
        ),
        ("jerk along the path", max(f.path_jerk_mm_per_s3 for f in worst) / limits.jerk_mm_per_s3),
    )
    metrics += [
        Metric(f"largest sampled {name} over its limit", value, "share", "lower", EXCESS)
        for name, value in shares
    ]
    deviation_mm = max(f.deviation_mm for f in worst)
    metrics.append(Metric("largest deviation from the path", deviation_mm, "mm", "lower", 0.21))
    return metrics


def _followed(path: Path5D, model: RobotModel) -> Floats:
    """Return the joint path with the best constant roll."""
    rolls_deg = working_set_deg(N_ROLLS, 0.0, 360.0)
    verdicts = evaluate_constant_rolls(path, model, rolls_deg, MarginLimits()).verdicts
    verdict = verdicts[choose_constant_roll(verdicts, "best")]
    return joint_path(path, model, float(np.deg2rad(verdict.roll_deg)), verdict.branch)


def _driver(
    path: Path5D, qs_rad: Floats, model: RobotModel, settings: ScanSettings
) -> Callable[[], Trajectory]:
    return lambda: time_scan(path, qs_rad, model, settings)


def _toppra(path: Path5D, qs_rad: Floats, model: RobotModel, speed_mm_per_s: float) -> Metric:
    """Return the duration of the same scan by TOPP-RA on the same rounded path, if installed.

    The way is its seventh joint, with the scan speed and the path acceleration as limits. Neither
    the acceleration in bends nor the jerk is limited, so that it is faster; it is no goal.
    """
    name = f"S0-306 at {speed_mm_per_s:g} mm/s: scan duration by toppra, bends and jerk free"
    try:
        import toppra
        from toppra import algorithm, constraint
    except ImportError:
        return Metric(name, None, "s", "lower")
    rounded = blend_corners(path.arc_length_mm(), qs_rad, model, ScanSettings().corner_deviation_mm)
    joints = np.column_stack((rounded.qs_rad, rounded.way_mm))
    spline = toppra.SplineInterpolator(rounded.way_mm, joints)
    speeds = np.append(model.speed_rad_per_s, speed_mm_per_s)
    gains = np.append(model.acceleration_rad_per_s2, ScanSettings().path_acceleration_mm_per_s2)
    limits = [
        constraint.JointVelocityConstraint(np.column_stack((-speeds, speeds))),
        constraint.JointAccelerationConstraint(np.column_stack((-gains, gains))),
    ]
    solver = algorithm.TOPPRA(
        limits, spline, parametrizer="ParametrizeConstAccel", gridpoints=rounded.way_mm
    )
    peer_s = float(solver.compute_trajectory().duration)
    return Metric(name, peer_s, "s", "lower")
