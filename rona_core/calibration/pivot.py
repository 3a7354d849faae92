"""Find the fixed tip of a tracked body that swings about it: shared by pointer and tool."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from rona_core.arrays import Bools, Floats, Vector3, readonly
from rona_core.calibration.marker_geometry import check_marker_geometry
from rona_core.calibration.marker_noise import MarkerNoise
from rona_core.calibration.pivot_linear import MIN_SHARE, solve_linear, without_gross_errors
from rona_core.calibration.pivot_ml import LikelyTip, fit_likely_tip
from rona_core.calibration.pivot_verdict import PivotFacts, Verdict, judge_pivot, poses_alike
from rona_core.calibration.swing import require_cone, require_swing, swing_of_shaft_deg
from rona_core.calibration.tracked_poses import (
    TrackedPoses,
    tracked_from_markers,
    tracked_from_poses,
)
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.pose import Poses

PivotMethod = Literal["ml", "sphere", "aos"]
METHODS: tuple[PivotMethod, ...] = ("ml", "sphere", "aos")

MAX_RMSE_MM = 5.0  # beyond this the tip did not stay in one place
EXCLUDED, UNSEEN, AWAY = "excluded by hand", "too few markers seen", "away from the common tip"


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
    rmse_mm: float  # of the residuals that were used
    tip_sigma_mm: float  # predicted 3D standard deviation of the tip
    cone_deg: float  # half-angle covered by the lever
    marker_sigma_mm: float | None  # 3D RMS of one marker that the scatter tells of; only "ml"
    verdict: Verdict
    reasons: tuple[str, ...]  # why not good, and what to do about it


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

    Args:
        Ts_tracker_marker: Poses of the swinging marker, in the order they were taken.
        dof: 6; or 5 where only the z axis of the marker is known and the tip lies on it.
        method: "ml" is maximum likelihood on the errors of the markers; "sphere" fits a sphere to
            the marker origins, its centre is the pivot, and the tip is the mean of the pivot seen
            from each pose; "aos" solves R_i tip - pivot = -t_i (algebraic one step) for both.
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
    _require_dof(dof)
    keep = _as_keep(exclude, len(Ts_tracker_marker))
    _require_poses(Ts_tracker_marker, keep, dof, at_least)
    if method == "ml":
        if positions_marker is None:
            raise InvalidInputError('method "ml" needs positions_marker, the marker geometry')
        noise = noise or MarkerNoise()
        tracked = tracked_from_poses(Ts_tracker_marker, positions_marker, noise, dof=dof)
        return _solve_likely(tracked, keep, dof, at_least, noise, ())
    used = keep
    for step in ("aos", method):  # gross errors upset the sphere most, so the other one finds them
        used = without_gross_errors(Ts_tracker_marker, used, dof, step, at_least)
    found = solve_linear(Ts_tracker_marker.select(used), dof, method)
    return _finish(
        Ts_tracker_marker,
        found.tip_marker,
        found.pivot_tracker,
        found.covariance,
        used,
        {EXCLUDED: ~keep},
        dof,
        narrowness=2 if method == "sphere" else 1,
    )


def solve_pivot_from_markers(
    points_tracker: ArrayLike,
    positions_marker: ArrayLike,
    *,
    dof: int,
    at_least: int,
    seen: ArrayLike | None = None,
    noise: MarkerNoise | None = None,
    exclude: ArrayLike | None = None,
) -> PivotFit:
    """Return the most likely tip from raw markers, and complain if they do not fit the geometry.

    Args:
        points_tracker: Measured markers (n, m, 3) in mm; values of unseen ones are ignored.
        positions_marker: Marker geometry (m, 3) in mm.
        dof: 6; or 5 for markers on the z axis of ``marker``.
        at_least: Fewest poses accepted.
        seen: (n, m) which markers were seen; all if None.
        noise: What is assumed about single markers; by default three times as much in depth.
        exclude: (n,) True for frames that must not count.

    Raises:
        InvalidInputError, DegenerateGeometryError: as in :func:`solve_pivot`.
    """
    _require_dof(dof)
    noise = noise or MarkerNoise()
    tracked = tracked_from_markers(points_tracker, positions_marker, noise, dof=dof, seen=seen)
    keep = _as_keep(exclude, len(tracked.seen))
    _require_poses(tracked.Ts_tracker_marker, keep & tracked.seen, dof, at_least)
    check = check_marker_geometry(points_tracker, positions_marker, seen)
    return _solve_likely(tracked, keep, dof, at_least, noise, check.complaints)


def _solve_likely(
    tracked: TrackedPoses,
    keep: Bools,
    dof: int,
    at_least: int,
    noise: MarkerNoise,
    complaints: tuple[str, ...],
) -> PivotFit:
    counting = keep & tracked.seen
    found = fit_likely_tip(tracked, dof=dof, keep=counting, sigma_mm=noise.sigma_mm)
    used = found.weights > 0.0
    n, n_used = int(counting.sum()), int(used.sum())
    if n_used < max(at_least, MIN_SHARE * n):
        raise DegenerateGeometryError(
            f"{n - n_used} of {n} poses disagree with the tip that the others share: "
            "the tip has slipped"
        )
    if not found.settled:
        raise DegenerateGeometryError(
            f"the {n} poses do not settle on one tip: swing further, and hold the tip in its place"
        )
    return _finish(
        tracked.Ts_tracker_marker,
        found.tip_marker,
        found.pivot_tracker,
        found.covariance,
        used,
        {EXCLUDED: ~keep, UNSEEN: ~tracked.seen},
        dof,
        likely=found,
        noise=noise,
        complaints=complaints,
    )


def _finish(
    Ts_tracker_marker: Poses,
    tip: Vector3,
    pivot: Vector3,
    covariance: Floats,
    used: Bools,
    known_reasons: dict[str, Bools],
    dof: int,
    *,
    narrowness: int = 1,
    likely: LikelyTip | None = None,
    noise: MarkerNoise | None = None,
    complaints: tuple[str, ...] = (),
) -> PivotFit:
    """Check what is left of the swing, list what was rejected and judge the result."""
    misses = Ts_tracker_marker @ tip - pivot
    residuals = np.linalg.norm(misses, axis=1)
    require_swing(Ts_tracker_marker.rotations[used], dof)
    levers = Ts_tracker_marker.rotations[used] @ (tip / float(np.linalg.norm(tip)))
    cone_deg = require_cone(levers)
    rmse_mm = float(np.sqrt((residuals[used] ** 2).mean()))
    if rmse_mm > MAX_RMSE_MM:
        raise DegenerateGeometryError(
            f"the tip scatters by {rmse_mm:.1f} mm about its pivot: it has slipped"
        )
    alike = 1.0 if likely is None else poses_alike(misses[used])
    covariance = covariance * alike
    rejected = _rejected(residuals, used, known_reasons)
    sigma_mm = float(np.sqrt(np.trace(covariance[:3, :3])))
    facts = PivotFacts(
        tip_sigma_mm=sigma_mm,
        cone_deg=cone_deg,
        swing_deg=swing_of_shaft_deg(levers),
        n=len(residuals),
        n_used=int(used.sum()),
        narrowness=narrowness,
        marker_sigma_mm=None if likely is None else likely.sigma_mm,
        stated_sigma_mm=None if noise is None else noise.sigma_mm,
        alike=alike,
        geometry=complaints,
    )
    away = np.array([r.index for r in rejected if r.reason == AWAY], dtype=np.int64)
    verdict, reasons = judge_pivot(facts, away)
    return PivotFit(
        tip_marker=readonly(tip),
        pivot_tracker=readonly(pivot),
        covariance=readonly(covariance),
        residuals_mm=readonly(residuals),
        used=readonly(used),
        rejected=rejected,
        rmse_mm=rmse_mm,
        tip_sigma_mm=sigma_mm,
        cone_deg=cone_deg,
        marker_sigma_mm=facts.marker_sigma_mm,
        verdict=verdict,
        reasons=reasons,
    )


def _rejected(
    residuals: Floats, used: Bools, known_reasons: dict[str, Bools]
) -> tuple[RejectedPose, ...]:
    """Return every pose that does not count; those without a known reason miss the tip."""
    found: list[RejectedPose] = []
    for row in np.flatnonzero(~used):
        reason = next((text for text, rows in known_reasons.items() if rows[row]), AWAY)
        found.append(RejectedPose(int(row), float(residuals[row]), reason))
    return tuple(found)


def _as_keep(exclude: ArrayLike | None, n: int) -> Bools:
    """Return the poses (n,) that may count."""
    if exclude is None:
        return np.ones(n, dtype=np.bool_)
    mask = np.asarray(exclude)
    if mask.shape != (n,) or mask.dtype != np.bool_:
        raise InvalidInputError(f"exclude must be bool of shape ({n},), not {mask.shape}")
    return ~mask


def _require_dof(dof: int) -> None:
    if dof not in (5, 6):
        raise InvalidInputError(f"dof must be 6 or 5, not {dof}")


def _require_poses(Ts_tracker_marker: Poses, keep: Bools, dof: int, at_least: int) -> None:
    """Refuse too few poses, and those that leave the tip open."""
    n = int(keep.sum())
    if n < at_least:
        raise InvalidInputError(f"a pivot needs at least {at_least} poses, not {n}")
    require_swing(Ts_tracker_marker.rotations[keep], dof)
