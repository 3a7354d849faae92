"""Pivot calibration: the fixed tip of a tracked body, for pointer and tool, and rejected poses."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from rona_core.calibration.pivot.maximum_likelihood import estimate_tip, robust_initial_guess
from rona_core.calibration.pivot.motion_extent import (
    disagreement,
    fit_sphere,
    refusal,
    repeated_poses,
    require_cone,
    require_swing,
    swing_of_shaft_deg,
)
from rona_core.calibration.pivot.quality import (
    PivotFacts,
    Verdict,
    correlated_poses,
    judge_pivot,
)
from rona_core.calibration.tracking_error import MarkerNoise, tracked_from_poses
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Vector3, readonly
from rona_core.geometry.pose import Poses

PivotMethod = Literal["ml", "sphere"]
METHODS: tuple[PivotMethod, ...] = ("ml", "sphere")

GROSS = 4.0  # the sphere drops a pose beyond this multiple of the median residual (6 sigma) ...
GROSS_FLOOR_MM = 1e-6  # ... which itself counts as at least this
MIN_SHARE = 0.7  # of the poses that must agree
MAX_RMSE_MM = 5.0  # beyond this the tip did not stay in one place


EXCLUDED, AWAY = "excluded by hand", "away from the common tip"
REPEATED = "the same as the pose before"


@dataclass(frozen=True, slots=True)
class RejectedPose:
    """One pose that does not count, and why."""

    index: int
    residual_mm: float
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class PivotFit:
    """Tip of a body in its marker frame, and the place it swung about."""

    tip_marker: Vector3  # (3,) mm
    pivot_tracker: Vector3  # (3,) mm
    covariance: Floats  # (6, 6) mm^2 of tip (in marker), then pivot (in tracker)
    residuals_mm: Floats  # (n,) distance of the tip, mapped by each pose, from the pivot
    used: Bools  # (n,) False for poses that do not count
    rejected: tuple[RejectedPose, ...]  # those, and why
    n_repeated: int  # of those, poses that only repeat the one before
    rmse_mm: float  # of the residuals that were used
    tip_sigma_mm: float  # predicted 3D standard deviation of the tip
    cone_deg: float  # half-angle covered by the lever
    marker_sigma_mm: float | None  # 3D RMS of one marker, estimated; only "ml"
    verdict: Verdict
    reasons: tuple[str, ...]  # why not good, and what to do about it


@dataclass(frozen=True, slots=True, eq=False)
class _Estimate:
    """Estimated tip and pivot, and which poses they rest on."""

    tip_marker: Vector3
    pivot_tracker: Vector3
    covariance: Floats  # (6, 6) of both, for independent errors
    used: Bools  # (n,)
    marker_sigma_mm: float | None  # 3D RMS of one marker; only "ml"


def solve_pivot(
    Ts_tracker_marker: Poses,
    *,
    dof: int,
    method: PivotMethod,
    at_least: int,
    positions_marker: ArrayLike | None = None,
    noise: MarkerNoise | None = None,
    exclude: ArrayLike | None = None,
) -> PivotFit:
    """Return the tip in ``marker`` that stays at one place in ``tracker``.

    A run of equal poses counts once: it is one measurement that the tracker repeated.

    Args:
        Ts_tracker_marker: Poses of the swinging marker, in the order they were taken.
        dof: 6; or 5 where only the z axis of the marker is known and the tip lies on it.
        method: "ml" is maximum likelihood on the errors of the markers; "sphere" fits a sphere to
            the marker origins, its centre is the pivot, and the tip is the mean of the pivot seen
            from each pose.
        at_least: Fewest poses accepted.
        positions_marker: Marker geometry (m, 3) in mm; "ml" needs it.
        noise: What "ml" assumes about single markers; by default three times as much in depth.
        exclude: (n,) True for poses that must not count.

    Raises:
        InvalidInputError: unknown method or dof, no geometry, or too few poses.
        DegenerateGeometryError: the swing is static, in one plane or too small, or the poses do
            not share a tip.
    """
    if method not in METHODS:
        raise InvalidInputError(f"method must be one of {', '.join(METHODS)}, not {method!r}")
    if dof not in (5, 6):
        raise InvalidInputError(f"dof must be 6 or 5, not {dof}")
    keep = as_keep(exclude, len(Ts_tracker_marker))
    n = int(keep.sum())
    if n < at_least:
        raise InvalidInputError(f"a pivot needs at least {at_least} poses, not {n}")
    require_swing(Ts_tracker_marker.rotations[keep], dof)
    keep = keep & ~repeated_poses(Ts_tracker_marker)
    if keep.sum() < at_least:
        raise refusal("repeated", n=int(keep.sum()), all=n, least=at_least)
    n = int(keep.sum())
    if method == "sphere":
        estimate = _by_sphere(Ts_tracker_marker, keep, dof)
    elif positions_marker is None:
        raise InvalidInputError('method "ml" needs positions_marker, the marker geometry')
    else:
        model = noise or MarkerNoise()
        estimate = _most_likely(Ts_tracker_marker, positions_marker, keep, dof, model)
    if estimate.used.sum() < max(at_least, MIN_SHARE * n):
        raise disagreement(*_equations(Ts_tracker_marker, dof), keep)
    return _judged(Ts_tracker_marker, estimate, as_keep(exclude, len(keep)), keep, dof)


def _equations(Ts_tracker_marker: Poses, dof: int) -> tuple[Floats, Floats]:
    """Return levers (n, 3, k), the ways in which the tip may move, and origins (n, 3)."""
    R = Ts_tracker_marker.rotations
    return (R if dof == 6 else R[:, :, 2:]), Ts_tracker_marker.translations


def _most_likely(
    Ts_tracker_marker: Poses,
    positions_marker: ArrayLike,
    keep: Bools,
    dof: int,
    noise: MarkerNoise,
) -> _Estimate:
    tracked = tracked_from_poses(Ts_tracker_marker, positions_marker, noise, dof=dof)
    found = estimate_tip(tracked, dof=dof, keep=keep)
    if not found.settled:
        raise disagreement(*_equations(Ts_tracker_marker, dof), keep)
    used = found.weights > 0.0
    return _Estimate(found.tip_marker, found.pivot_tracker, found.covariance, used, found.sigma_mm)


def _by_sphere(Ts_tracker_marker: Poses, keep: Bools, dof: int) -> _Estimate:
    """Fit a sphere to the marker origins of the poses that agree on a tip."""
    R, t = Ts_tracker_marker.rotations, Ts_tracker_marker.translations
    known = np.eye(3) if dof == 6 else np.diag((0.0, 0.0, 1.0))  # directions the tip may move in
    levers, _ = _equations(Ts_tracker_marker, dof)
    x = robust_initial_guess(levers, t, keep)
    misses = np.linalg.norm(levers @ x[:-3] + t - x[-3:], axis=1)
    used = keep & (misses <= GROSS * max(float(np.median(misses[keep])), GROSS_FLOOR_MM))
    sphere = fit_sphere(t[used])
    pivots_marker = np.einsum("nji,nj->ni", R, sphere.center - t)[used]
    # the tip inherits the error of the centre, seen from the middle of the swing
    R_marker_tracker = Ts_tracker_marker.select(used).mean().rotation.T
    spread = np.vstack((known @ R_marker_tracker, np.eye(3)))
    covariance = spread @ sphere.center_covariance @ spread.T
    return _Estimate(known @ pivots_marker.mean(axis=0), sphere.center, covariance, used, None)


def _judged(
    Ts_tracker_marker: Poses, estimate: _Estimate, wanted: Bools, keep: Bools, dof: int
) -> PivotFit:
    """Check the swing of the poses used, list what was rejected and judge the result.

    Args:
        Ts_tracker_marker: Poses (n,).
        estimate: Tip and pivot.
        wanted: (n,) False for poses excluded by hand.
        keep: (n,) False for those that repeat the one before, too.
        dof: 6 or 5.
    """
    tip, used = estimate.tip_marker, estimate.used
    misses = Ts_tracker_marker @ tip - estimate.pivot_tracker
    residuals = np.linalg.norm(misses, axis=1)
    require_swing(Ts_tracker_marker.rotations[used], dof)
    levers = Ts_tracker_marker.rotations[used] @ (tip / float(np.linalg.norm(tip)))
    cone_deg = require_cone(levers)
    if dof == 5 and tip[2] <= 0.0:
        raise refusal("behind", distance=-tip[2])
    rmse_mm = float(np.sqrt((residuals[used] ** 2).mean()))
    if rmse_mm > MAX_RMSE_MM:
        raise disagreement(*_equations(Ts_tracker_marker, dof), keep, rmse_mm)
    by_sphere = estimate.marker_sigma_mm is None
    alike = 1.0 if by_sphere else correlated_poses(misses[used])
    covariance = estimate.covariance * alike
    rejected = rejected_poses(residuals, used, wanted, keep)
    facts = PivotFacts(
        tip_sigma_mm=float(np.sqrt(np.trace(covariance[:3, :3]))),
        cone_deg=cone_deg,
        swing_deg=swing_of_shaft_deg(levers),
        n=int(keep.sum()),
        n_used=int(used.sum()),
        narrowness=2 if by_sphere else 1,
        marker_sigma_mm=estimate.marker_sigma_mm,
        alike=alike,
    )
    away = np.array([r.index for r in rejected if r.reason == AWAY], dtype=np.int64)
    verdict, reasons = judge_pivot(facts, away)
    return PivotFit(
        tip_marker=readonly(tip),
        pivot_tracker=readonly(estimate.pivot_tracker),
        covariance=readonly(covariance),
        residuals_mm=readonly(residuals),
        used=readonly(used),
        rejected=rejected,
        n_repeated=int((wanted & ~keep).sum()),
        rmse_mm=rmse_mm,
        tip_sigma_mm=facts.tip_sigma_mm,
        cone_deg=cone_deg,
        marker_sigma_mm=estimate.marker_sigma_mm,
        verdict=verdict,
        reasons=reasons,
    )


def rejected_poses(
    residuals: Floats, used: Bools, wanted: Bools, keep: Bools
) -> tuple[RejectedPose, ...]:
    """Return every pose that does not count.

    Args:
        residuals: (n,) distance of the tip from the pivot in mm.
        used: (n,) which poses count.
        wanted: (n,) which poses were not excluded by hand.
        keep: (n,) which of those do not repeat the one before.
    """
    reasons = np.where(keep, AWAY, np.where(wanted, REPEATED, EXCLUDED)).tolist()
    return tuple(
        RejectedPose(int(row), float(residuals[row]), reasons[row]) for row in np.flatnonzero(~used)
    )


def as_keep(exclude: ArrayLike | None, n: int) -> Bools:
    """Return the poses (n,) that may count.

    Raises:
        InvalidInputError: ``exclude`` is no mask of n poses.
    """
    if exclude is None:
        return np.ones(n, dtype=np.bool_)
    mask = np.asarray(exclude)
    if mask.shape != (n,) or mask.dtype != np.bool_:
        raise InvalidInputError(f"exclude must be bool of shape ({n},), not {mask.shape}")
    return ~mask
