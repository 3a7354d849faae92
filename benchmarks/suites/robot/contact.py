"""The force loop on its bench, the certified band, and the delay between poses and echoes.

Bench: a surface that swings by 2 mm about the map over 60 mm, scanned at 20 mm/s with 3 N. Where
the goals are set by the contact of the delay line (2 N/mm), stiffer ones are to keep below the
monitored force and may take longer.
"""

from dataclasses import replace

import numpy as np

from benchmarks.metric import Metric, Progress, cpu_ms
from benchmarks.reference.force_loop_bench import BenchRun, run_bench, wave_mm
from rona_core.app.declarations.figures import limit_of
from rona_core.calibration.timing.robot_latency import EchoSegment, estimate_pose_delay
from rona_core.devices.settings import ContactSettings
from rona_core.devices.wrench import JR3
from rona_core.geometry.path5d import Path5D
from rona_core.robot.force_control.correction_corridor import correction_corridor
from rona_core.robot.force_control.gravity_compensation import force_range_n, lever_mm
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.planning.plan_motion import plan_scan
from rona_core.robot.trajectory.trajectory import Trajectory

RMS_N, PEAK_N = limit_of("contact_force_rms_n"), limit_of("contact_force_peak_n")
SLOW = ContactSettings()
FAST = ContactSettings(period_ms=4.0, delay_ms=8.0, lag_ms=10.0)
LOOPS = {"16 ms loop": SLOW, "4 ms loop": FAST}
STIFFNESSES = (0.5, 2.0, 5.0, 20.0)
SPEED_MM_PER_S, LENGTH_MM = 20.0, 180.0
TRIALS, NOISE_MM = 100, 0.004


def run(progress: Progress) -> list[Metric]:
    """Return forces, times and stops of the bench, times of computing, and errors of the delay."""
    metrics: list[Metric] = []
    for loop, settings in LOOPS.items():
        for stiffness in STIFFNESSES:
            progress(f"{loop}, {stiffness:g} N/mm")
            metrics += _wave(loop, settings, stiffness)
    progress("lost contact, computing times, delay")
    metrics += [_lost(), _sensor(), _speed(), *_band(robot_model()), *_delay()]
    return metrics


def _wave(loop: str, settings: ContactSettings, stiffness: float) -> list[Metric]:
    if stiffness * settings.travel_mm < settings.force_n + 2.0 * stiffness:
        settings = replace(settings, travel_mm=10.0)  # so soft that the default band is too narrow
    done = run_bench(settings, offset_mm=wave_mm(), stiffness_n_per_mm=stiffness)
    full = run_bench(settings, offset_mm=wave_mm(), stiffness_n_per_mm=stiffness, limit_feed=False)
    where = f"{loop}, {stiffness:g} N/mm"
    goals = (RMS_N, PEAK_N) if stiffness <= 2.0 else (None, settings.monitor_n)
    share = 100.0 * LENGTH_MM / SPEED_MM_PER_S / done.duration_s
    return [
        Metric(f"force RMS, {where}", _whole(done, done.rms_n), "N", "lower", goals[0]),
        Metric(f"force peak, {where}", _whole(done, done.peak_n), "N", "lower", goals[1]),
        Metric(f"share of scan speed, {where}", share, "%", "higher"),
        Metric(f"losses of contact, {where}", done.n_losses, "", "lower"),
        Metric(f"force RMS at full speed, {where}", _whole(full, full.rms_n), "N", "lower"),
    ]


def _whole(done: BenchRun, value: float) -> float | None:
    return None if done.reason else value


def _lost() -> Metric:
    """Return how far the scan goes on after the surface dropped away by 20 mm."""
    done = run_bench(SLOW, offset_mm=lambda way_mm: 0.0 if way_mm < 60.0 else 20.0)
    way_mm = float(done.way_mm[-1]) - 60.0 if "contact was lost" in done.reason else None
    return Metric("way until lost contact stops the scan", way_mm, "mm", "lower", 10.0)


def _sensor() -> Metric:
    model = robot_model()
    limit_mm = JR3.torque_range_nmm / JR3.force_range_n
    share = 100.0 * force_range_n(model, JR3) / JR3.force_range_n
    return Metric(
        f"force range left by a lever of {lever_mm(model):.0f} mm (limit {limit_mm:.0f})",
        share,
        "%",
        "higher",
        100.0,
    )


def _speed() -> Metric:
    def scan() -> BenchRun:
        return run_bench(SLOW, offset_mm=wave_mm(), length_mm=1340.0)

    lasted_s = float(scan().times_s[-1])
    value = cpu_ms(scan, 3) * 70.0 / lasted_s
    return Metric("bench, time for 70 s of contact", value, "ms", "lower", 1000.0)


def _band(model: RobotModel) -> list[Metric]:
    trajectory = _trajectory(model)
    band = correction_corridor(model, trajectory, SLOW)
    value = cpu_ms(lambda: correction_corridor(model, trajectory, SLOW))
    off = max(c.value for c in band.certificate.checks if c.unit == "mm")
    return [
        Metric("certify the band of a scan", value, "ms", "lower", 200.0),
        Metric("width of the band, each way", band.travel_mm, "mm", "higher", SLOW.travel_mm),
        Metric("probe off its axis in the band", off, "mm", "lower", 1e-3),
    ]


def _trajectory(model: RobotModel) -> Trajectory:
    """Return the certified motion over a meander on a sphere."""
    along, across = np.meshgrid(np.linspace(-40.0, 40.0, 81), np.linspace(-40.0, 40.0, 9))
    along[1::2] = along[1::2, ::-1]
    flat = np.column_stack((along.ravel(), across.ravel(), np.full(along.size, 100.0)))
    outward = flat / np.linalg.norm(flat, axis=1, keepdims=True)
    plan = plan_scan(Path5D(np.array((600.0, 100.0, 350.0)) + 100.0 * outward, -outward), model)
    if plan.trajectory is None:
        raise RuntimeError("the path of the benchmark cannot be followed")
    return plan.trajectory


def _delay() -> list[Metric]:
    """Return errors of the delay over trials with the motion of lifting off, at 16 ms."""
    errors = np.zeros(TRIALS)
    sigmas = np.zeros(TRIALS)
    scans, joints = np.arange(0.1, 0.7, 0.016), np.arange(0.0, 1.0, 0.016)

    def place(times_s: np.typing.NDArray[np.float64]) -> np.typing.NDArray[np.float64]:
        rising = np.clip(times_s - 0.2, 0.0, 0.35)
        return -7.0 * rising**2 - 4.9 * np.maximum(times_s - 0.55, 0.0)

    for seed in range(TRIALS):
        noise = np.random.default_rng(seed).normal(0.0, NOISE_MM, len(scans))
        segment = EchoSegment(scans, 1.0 - place(scans) + noise, joints, place(joints - 0.016))
        found = estimate_pose_delay([segment])
        errors[seed], sigmas[seed] = found.delay_s - 0.016, found.sigma_s
    rms_s = float(np.sqrt((errors**2).mean()))
    return [
        Metric("pose delay, RMS error", 1e3 * rms_s, "ms", "lower", 1.0),
        Metric("the same along the path at 20 mm/s", 20.0 * rms_s, "mm", "lower", 0.02),
        Metric("true over stated deviation", rms_s / float(sigmas.mean()), "", "lower", 1.3),
    ]
