"""Hand-eye calibration of recorded poses beside OpenCV's five methods, on 200 simulated sets.

Families of equal size: clean, 5 % gross errors, few poses (6 to 9), nearly parallel axes (which are
to be flagged or refused). Half of the sets have an optical tracker beside the robot, half a camera
on it. Where OpenCV (extra ``bench``) is not installed, our own Park and Martin stands in for it.
"""

from collections.abc import Sequence

import numpy as np

from benchmarks.cases.hand_eye_sets import FAMILIES, HandEyeSet, error_of, made_set, solvers
from benchmarks.metric import Metric, Progress
from rona_core.calibration.hand_eye.recorded_poses import HandEyeCalibration, calibrate_hand_eye
from rona_core.errors import RonaError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose

SEEDS = range(46_000, 46_050)
HONEST = (0.75, 1.35)  # mean square of error over its deviation
BANDS = (90.0, 98.0)  # per cent of errors in their 95 % bands
NORMAL_95 = 1.96


def run(progress: Progress) -> list[Metric]:
    """Return errors beside those of others, and how honest the covariance is."""
    metrics: list[Metric] = []
    squares: list[float] = []
    inside: list[float] = []
    for family in FAMILIES:
        progress(f"{family}: {len(SEEDS)} sets")
        sets = [made_set(family, seed) for seed in SEEDS]
        found = [_calibrated(one) for one in sets]
        if family == "parallel":
            flagged = [c is None or c.verdict != "good" for c in found]
            share = 100.0 * float(np.mean(flagged))
            metrics.append(Metric("nearly parallel axes, flagged", share, "%", "higher", 100.0))
            continue
        known = [(one, c) for one, c in zip(sets, found, strict=True) if c is not None]
        metrics.append(
            Metric(f"{family}, refused", float(len(sets) - len(known)), "", "lower", 0.0)
        )
        for sensor in ("tracker", "camera"):
            some = [(one, c) for one, c in known if one.noise == sensor]
            metrics += _beside_others(f"{family}, {sensor}", some)
        errors = [error_of(c.sensor, one.sensor) for one, c in known]
        covariances = [c.covariance[:6, :6] for _, c in known]
        pairs = list(zip(errors, covariances, strict=True))
        own = [float(e @ np.linalg.solve(C, e)) / 6.0 for e, C in pairs]
        within = [float((_ratios(e, C) < NORMAL_95).mean()) for e, C in pairs]
        metrics += _honesty(family, own, within)
        squares += own
        inside += within
    return [*metrics, *_honesty("all", squares, inside)]


def _calibrated(one: HandEyeSet) -> HandEyeCalibration | None:
    try:
        return calibrate_hand_eye(
            one.Ts_base_tip, one.Ts_tracker_marker, setup=one.setup, noise=one.noise
        )
    except RonaError:
        return None


def _beside_others(
    name: str, some: Sequence[tuple[HandEyeSet, HandEyeCalibration]]
) -> list[Metric]:
    """Return our median error of the sensor's place beside the best median of another solver."""

    def median(poses: Sequence[Pose]) -> float:
        shifts = [error_of(p, one.sensor)[3:] for p, (one, _) in zip(poses, some, strict=True)]
        return float(np.median(np.linalg.norm(shifts, axis=1)))

    others = {
        solver: median([one.solved_by(solve) for one, _ in some])
        for solver, solve in solvers().items()
    }
    peer = min(others, key=lambda solver: others[solver])
    ours = median([c.sensor for _, c in some])
    return [Metric(f"{name}, error (median)", ours, "mm", "lower", None, peer, others[peer])]


def _ratios(error: Floats, covariance: Floats) -> Floats:
    return np.abs(error) / np.sqrt(np.diag(covariance))


def _honesty(name: str, squares: list[float], inside: list[float]) -> list[Metric]:
    mean, share = float(np.mean(squares)), 100.0 * float(np.mean(inside))
    return [
        Metric(f"{name}, error / sigma, mean square", mean, "", "lower", HONEST[1]),
        Metric(f"{name}, the same, at least", mean, "", "higher", HONEST[0]),
        Metric(f"{name}, in the 95 % band", share, "%", "higher", BANDS[0]),
        Metric(f"{name}, the same, at most", share, "%", "lower", BANDS[1]),
    ]
