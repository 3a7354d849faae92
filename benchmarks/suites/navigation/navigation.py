"""Pointer and tool calibration under tracker noise, beside scikit-surgerycalibration.

The noise is the stress profile of docs/metrics.md: 0.35 mm 3D RMS, white, at every marker.
"""

import importlib
from collections.abc import Callable
from typing import get_args

import numpy as np

from benchmarks.cases.pivot_sweeps import CALIBRATION_S, pivot_metrics
from benchmarks.cases.pointer_map import pointer_map_metrics
from benchmarks.cases.registration import registration_metrics
from benchmarks.metric import Metric, Progress, over_seeds
from benchmarks.reference.yardstick import beside_peer
from rona_core.app.declarations.figures import limit_of
from rona_core.calibration.hand_eye.tool_registration import register_tool
from rona_core.calibration.handheld.pointer import calibrate_pointer
from rona_core.calibration.pivot.pivot_calibration import PivotMethod
from rona_core.devices.trackers import GEOMETRIES
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose, Poses
from rona_core.geometry.rigid_fit import register_points

TRIALS = 20
FRAMES = 300
CONE_DEG = 20.0
NOISE_MM = 0.35 / np.sqrt(3.0)  # per axis
PIVOT_TRACKER = np.array((120.0, -80.0, -1900.0))
N_PIVOT, N_LINE, DWELL_FRAMES, LINE_MM = 30, 10, 30, 100.0


def run(progress: Progress) -> list[Metric]:
    """Return tip errors over trials, of RONA and of a peer on the same poses."""
    progress(f"{TRIALS} pointer calibrations, cone {CONE_DEG:.0f} degrees")
    sweeps = [pointer_sweep(np.random.default_rng((1, trial))) for trial in range(TRIALS)]
    tip = GEOMETRIES["pointer6d"].nominal_tip_marker

    def error_mm(Ts_tracker_pointermarker: Poses, method: PivotMethod) -> float:
        found = calibrate_pointer(
            Ts_tracker_pointermarker,
            pointer="pointer6d",
            dof=6,
            method=method,
            positions_pointermarker=GEOMETRIES["pointer6d"].positions_marker,
        )
        return float(np.linalg.norm(found.tip_pointermarker - tip))

    peer = peer_pivot()
    peer_errors = [float(np.linalg.norm(peer(sweep) - tip)) for sweep in sweeps] if peer else []
    peer_name = "scikit-surgery" if peer else None
    metrics: list[Metric] = []
    for method in get_args(PivotMethod):
        metrics += over_seeds(
            f"pointer_tip_error_mm, {method}",
            [error_mm(sweep, method) for sweep in sweeps],
            "mm",
            "lower",
            peer=peer_name if method == "ml" else None,  # a sphere leaves orientations aside
            peer_value=float(np.median(peer_errors)) if peer_errors and method == "ml" else None,
        )
    metrics.append(
        beside_peer(
            "pointer calibration, CPU",
            lambda: error_mm(sweeps[0], "sphere"),
            CALIBRATION_S,
            peer_name,
            (lambda: peer(sweeps[0])) if peer else None,
        )
    )
    progress(f"{TRIALS} tool registrations")
    figures = [tool_errors(np.random.default_rng((2, trial))) for trial in range(TRIALS)]
    key = "tool_tip_error_mm"
    metrics += over_seeds(key, [f[0] for f in figures], "mm", "lower", goal=limit_of(key))
    metrics += over_seeds(
        "tracker_registration_tre_mm", [f[1] for f in figures], "mm", "lower", goal=0.5
    )
    metrics += registration_metrics(progress)
    metrics += pivot_metrics(progress)
    metrics += pointer_map_metrics(progress)
    return metrics


def measured(
    Ts_tracker_marker: Poses, tool: str, noise_mm: float, rng: np.random.Generator
) -> Poses:
    """Return the poses that a tracker fits to noisy markers of ``tool``."""
    positions = GEOMETRIES[tool].positions_marker
    fits: list[Pose] = []
    for T_tracker_marker in Ts_tracker_marker:
        seen = T_tracker_marker @ positions + rng.normal(0.0, noise_mm, positions.shape)
        fits.append(register_points(positions, seen).T_b_a)
    return Poses.stack(fits)


def tilts(n: int, rng: np.random.Generator) -> Floats:
    """Return rotation vectors (n, 3) that spread evenly over a cone, in a random order."""
    polar = np.deg2rad(CONE_DEG) * np.sqrt((np.arange(n) + 0.5) / n)
    azimuth = np.arange(n) * np.pi * (3.0 - np.sqrt(5.0)) + rng.uniform(0.0, 2.0 * np.pi)
    vectors = np.column_stack((polar * np.cos(azimuth), np.zeros(n), polar * np.sin(azimuth)))
    return vectors[rng.permutation(n)]


def pointer_sweep(rng: np.random.Generator) -> Poses:
    """Return noisy poses of the 6D pointer that swings about its tip."""
    tip = GEOMETRIES["pointer6d"].nominal_tip_marker
    swings = [Pose.from_rotvec(tilt) for tilt in tilts(FRAMES, rng)]
    truth = Poses.stack([Pose(p.rotation, PIVOT_TRACKER - p.rotation @ tip) for p in swings])
    return measured(truth, "pointer6d", NOISE_MM, rng)


def tool_errors(rng: np.random.Generator) -> tuple[float, float]:
    """Return the tip error and the error of the registration over the scanned region, in mm."""
    T_base_tracker = Pose.from_rotvec(rng.normal(0.0, 1.0, 3), (300.0, 1500.0, 1100.0))
    tip = GEOMETRIES["toolmarker"].nominal_tip_marker
    T_toolmarker_tip = Pose.from_rotvec(rng.normal(0.0, 1.0, 3), tip)
    start = Pose.from_rotvec((np.pi, 0.0, 0.0), (600.0, 0.0, 350.0))
    poses = [start @ Pose.from_rotvec((t[0], t[2], 0.0)) for t in tilts(N_PIVOT, rng)]
    for axis in np.eye(3)[:2]:
        steps = np.linspace(-0.5, 0.5, N_LINE)[:, None] * LINE_MM * axis
        poses += [start @ Pose.from_translation(step) for step in steps]
    Ts_base_tip = Poses.stack(poses)
    phases = np.repeat((0, 1, 2), (N_PIVOT, N_LINE, N_LINE))
    Ts_tracker_toolmarker = T_base_tracker.inv() @ (Ts_base_tip @ T_toolmarker_tip.inv())
    seen = measured(Ts_tracker_toolmarker, "toolmarker", NOISE_MM / np.sqrt(DWELL_FRAMES), rng)
    found = register_tool(Ts_base_tip, seen, phases)
    tip_error = np.linalg.norm(found.T_toolmarker_tip.translation - tip)
    targets_base = np.array((600.0, 60.0, 400.0)) + 25.0 * np.vstack((np.zeros(3), *np.eye(3)))
    targets_tracker = T_base_tracker.inv() @ targets_base
    off = found.T_base_tracker @ targets_tracker - targets_base
    return float(tip_error), float(np.sqrt((off**2).sum(axis=1).mean()))


def peer_pivot() -> Callable[[Poses], Floats] | None:
    """Return the peer's pivot calibration (pose batch to tip), None where it is not installed."""
    try:
        pivot = importlib.import_module("sksurgerycalibration.algorithms.pivot")
    except ImportError:
        return None

    def tip(Ts_tracker_marker: Poses) -> Floats:
        matrices = np.stack([pose.matrix() for pose in Ts_tracker_marker])
        return np.asarray(pivot.pivot_calibration(matrices)[0], dtype=np.float64).ravel()

    return tip
