"""Pivot calibration of tracked pointers over many sweeps, beside scikit-surgerycalibration.

Set-up: four coplanar markers, about 90 mm apart, the tip 200 mm from their centroid, 1.9 m before
the tracker; every marker errs by 0.35 mm 3D RMS, white. Poses are unweighted fits, as trackers
report them. 5D: three markers on a line, the tip 160 mm beyond the last.
"""

import importlib
import io
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from benchmarks.metric import Metric, Progress
from benchmarks.reference.yardstick import beside_peer
from rona_core.calibration.handheld.pointer import PointerCalibration, calibrate_pointer
from rona_core.calibration.tracking_error import MarkerNoise
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Poses
from rona_core.geometry.rigid_fit import fit_line_many, fit_rigid_many

TRIALS = 300
CALIBRATION_S = 0.025  # on the machine that yardsticks are told by
SIGMA_MM = 0.35
MARKERS = {
    6: np.array([[-45.0, -28, 0], [43, -34, 0], [36, 31, 0], [-34, 33, 0]]),
    5: np.array([[0.0, 0, 0], [0, 0, 60], [0, 0, 130]]),
}
TIPS = {6: np.array((0.0, -200.0, 0.0)), 5: np.array((0.0, 0.0, 290.0))}
PIVOT_TRACKER = np.array((120.0, -80.0, 1900.0))
PEER = "scikit-surgery"
Tip = Callable[[Poses], Floats]


@dataclass(frozen=True, slots=True)
class Case:
    """One kind of sweep."""

    name: str
    dof: int = 6
    n: int = 100
    cone_deg: float = 20.0
    depth_ratio: float = 1.0
    spoil: str = ""  # "gross" or "slip"

    def sweep(self, trial: int) -> Poses:
        """Return the poses of one sweep; cases that differ in ``spoil`` only share their noise."""
        rng = np.random.default_rng((3, trial))
        poses = measured_sweep(rng, self.dof, self.n, self.cone_deg, MarkerNoise(self.depth_ratio))
        return spoiled(rng, poses, self.spoil) if self.spoil else poses

    def calibrate(self, poses: Poses) -> PointerCalibration:
        """Return the calibration by RONA's default method."""
        return calibrate_pointer(
            poses,
            pointer="pointer",
            dof=6 if self.dof == 6 else 5,
            positions_pointermarker=MARKERS[self.dof],
            noise=MarkerNoise(self.depth_ratio),
        )


CLEAN = Case("cone 20 deg, n=100")
GROSS = Case("cone 20 deg, n=100, 5 % gross", spoil="gross")
SLIP = Case("cone 20 deg, n=100, 20 % slip", spoil="slip")
MANY = Case("cone 10 deg, n=2000", n=2000, cone_deg=10.0)
NARROW = Case("cone 10 deg, n=100", cone_deg=10.0)
DEPTH = Case("cone 20 deg, n=100, depth x3", depth_ratio=3.0)
LINE = Case("5D, cone 20 deg, n=100, depth x3", dof=5, depth_ratio=3.0)


def pivot_metrics(progress: Progress) -> list[Metric]:
    """Return the figures of all cases."""
    linear, ransac = peer_tip("pivot_calibration"), peer_tip("pivot_calibration_with_ransac")
    errors: dict[str, Floats] = {}
    agreement: list[tuple[float, float]] = []
    metrics: list[Metric] = []
    for case, peer, goal in (
        (CLEAN, linear, 0.26),
        (NARROW, linear, None),
        (DEPTH, linear, None),
        (GROSS, ransac, None),
        (SLIP, ransac, 0.30),
        (LINE, None, 0.16),
    ):
        progress(f"{TRIALS} sweeps, {case.name}")
        sweeps = [case.sweep(trial) for trial in range(TRIALS)]
        found = [case.calibrate(sweep) for sweep in sweeps]
        errors[case.name] = np.array([f.tip_pointermarker for f in found]) - TIPS[case.dof]
        metrics.append(
            Metric(
                f"pivot tip RMS, {case.name}",
                rms(errors[case.name]),
                "mm",
                "lower",
                goal,
                PEER if peer else None,
                rms(np.array([peer(sweep) for sweep in sweeps]) - TIPS[6]) if peer else None,
            )
        )
        agreement.append(nees_and_share_inside(case, errors[case.name], found))
    ratio = rms(errors[GROSS.name]) / rms(errors[CLEAN.name])
    metrics.append(Metric("pivot tip RMS, 5 % gross over clean", ratio, "", "lower", 1.1))
    metrics += honesty(*map(list, zip(*agreement, strict=True)))
    metrics.append(narrow_bias(linear, progress))
    sweep = CLEAN.sweep(0)
    metrics.append(
        beside_peer(
            "pivot calibration, n=100, CPU",
            lambda: CLEAN.calibrate(sweep),
            CALIBRATION_S,
            PEER if linear else None,
            (lambda: linear(sweep)) if linear else None,
        )
    )
    return metrics


def narrow_bias(linear: Tip | None, progress: Progress) -> Metric:
    """Return what stays of the error when very many poses cover a narrow cone."""
    progress(f"{TRIALS} sweeps, {MANY.name}")
    ours, theirs = np.zeros(3), np.zeros(3)
    for trial in range(TRIALS):
        sweep = MANY.sweep(trial)
        ours += (MANY.calibrate(sweep).tip_pointermarker - TIPS[6]) / TRIALS
        if linear:
            theirs += (linear(sweep) - TIPS[6]) / TRIALS
    bias = float(np.linalg.norm(ours))
    peer_bias = float(np.linalg.norm(theirs)) if linear else None
    name = f"pivot tip bias, {MANY.name}"
    return Metric(name, bias, "mm", "lower", 0.04, PEER if linear else None, peer_bias)


def nees_and_share_inside(
    case: Case, errors: Floats, found: list[PointerCalibration]
) -> tuple[float, float]:
    """Return how well the predicted covariance agrees with the errors (t, 3).

    First the squared error in units of the prediction, per freedom: 1 if honest. Then the share of
    errors within the predicted 95 % ellipsoid.
    """
    axes = slice(None) if case.dof == 6 else slice(2, 3)
    e = errors[:, axes]
    covariances = np.array([f.tip_covariance_pointermarker[axes, axes] for f in found])
    squares = np.einsum("ti,tij,tj->t", e, np.linalg.inv(covariances), e)
    k = e.shape[1]
    return float(squares.mean()) / k, float((squares <= chi2.ppf(0.95, k)).mean())


def honesty(nees: list[float], inside: list[float]) -> list[Metric]:
    """Return the extremes over the cases beside what an honest prediction keeps to."""
    cases = f"of {len(nees)} cases"
    return [
        Metric(f"pivot NEES per freedom, most {cases}", max(nees), "", "lower", 1.35),
        Metric(f"pivot NEES per freedom, least {cases}", min(nees), "", "higher", 0.75),
        Metric(f"pivot tips inside 95 % ellipsoid, least {cases}", min(inside), "", "higher", 0.92),
        Metric(f"pivot tips inside 95 % ellipsoid, most {cases}", max(inside), "", "lower", 0.99),
    ]


def rms(errors: Floats) -> float:
    """Return the root of the mean squared length of errors (t, 3)."""
    return float(np.sqrt((errors**2).sum(axis=1).mean()))


def measured_sweep(
    rng: np.random.Generator, dof: int, n: int, cone_deg: float, noise: MarkerNoise
) -> Poses:
    """Return the measured poses of a pointer that swings evenly over a cone about its tip."""
    angles = np.arccos(rng.uniform(np.cos(np.deg2rad(cone_deg)), 1.0, n))
    azimuths = rng.uniform(0.0, 2.0 * np.pi, n)
    first, second = angles * np.cos(azimuths), angles * np.sin(azimuths)
    none = np.zeros(n)
    tilts = (first, none, second) if dof == 6 else (first, second, none)
    upright = Rotation.from_euler("x", 180.0 if dof == 6 else 100.0, degrees=True)
    R = (upright * Rotation.from_rotvec(np.column_stack(tilts))).as_matrix()
    seen = PIVOT_TRACKER + np.einsum("nij,kj->nki", R, MARKERS[dof] - TIPS[dof])
    seen += rng.normal(size=seen.shape) * noise.shape() * SIGMA_MM
    there = np.ones(seen.shape[:2], dtype=np.bool_)
    if dof == 5:
        return fit_line_many(MARKERS[5][:, 2], seen, there).Ts_b_a
    return fit_rigid_many(MARKERS[6], seen, there).Ts_b_a


def spoiled(rng: np.random.Generator, poses: Poses, kind: str) -> Poses:
    """Return poses of which some are wrong.

    "gross": 5 % by 5 to 50 mm and 1 to 20 degrees. "slip": the tip is 2 to 4 mm away in 20 %.
    """
    share, low, high = (0.05, 5.0, 50.0) if kind == "gross" else (0.2, 2.0, 4.0)
    R, t = poses.rotations.copy(), poses.translations.copy()
    rows = rng.choice(len(poses), round(share * len(poses)), replace=False)
    t[rows] += directions(rng, len(rows)) * rng.uniform(low, high, (len(rows), 1))
    if kind == "gross":
        angles = np.deg2rad(rng.uniform(1.0, 20.0, (len(rows), 1)))
        R[rows] = Rotation.from_rotvec(angles * directions(rng, len(rows))).as_matrix() @ R[rows]
    return Poses(R, t)


def directions(rng: np.random.Generator, n: int) -> Floats:
    """Return unit vectors (n, 3) in all directions."""
    v = rng.normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1)[:, None]


def peer_tip(function: str) -> Tip | None:
    """Return a pivot calibration of the peer (poses to tip), None where it is not installed."""
    try:
        pivot = importlib.import_module("sksurgerycalibration.algorithms.pivot")
    except ImportError:
        return None

    def tip(Ts_tracker_marker: Poses) -> Floats:
        matrices = np.tile(np.eye(4), (len(Ts_tracker_marker), 1, 1))
        matrices[:, :3, :3] = Ts_tracker_marker.rotations
        matrices[:, :3, 3] = Ts_tracker_marker.translations
        with redirect_stdout(io.StringIO()):  # it tells of every step
            if function == "pivot_calibration":
                found = pivot.pivot_calibration(matrices)
            else:
                found = pivot.pivot_calibration_with_ransac(matrices, 10, 4.0, 0.25)
        return np.asarray(found[0], dtype=np.float64).ravel()

    return tip
