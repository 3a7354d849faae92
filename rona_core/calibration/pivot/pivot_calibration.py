"""Pivot calibration: the fixed tip of a tracked body, for pointer and tool."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from rona_core.calibration.pivot.algebraic import MIN_SHARE, solve_linear, without_gross_errors
from rona_core.calibration.pivot.maximum_likelihood import estimate_tip
from rona_core.calibration.pivot.motion_extent import (
    require_cone,
    require_swing,
    swing_of_shaft_deg,
)
from rona_core.calibration.pivot.pose_coverage import sigma_by_cone
from rona_core.calibration.pivot.quality import (
    GOOD_SIGMA_MM,
    PivotFacts,
    correlated_poses,
    judge_pivot,
)
from rona_core.calibration.pivot.result import (
    AWAY,
    EXCLUDED,
    UNSEEN,
    PivotFit,
    as_keep,
    rejected_poses,
)
from rona_core.calibration.tracking_error.marker_geometry_check import check_marker_geometry
from rona_core.calibration.tracking_error.marker_noise import MarkerNoise
from rona_core.calibration.tracking_error.poses_with_covariance import (
    TrackedPoses,
    tracked_from_markers,
    tracked_from_poses,
)
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Vector3, as_floats, readonly
from rona_core.geometry.pose import Poses

PivotMethod = Literal["ml", "sphere", "aos"]
METHODS: tuple[PivotMethod, ...] = ("ml", "sphere", "aos")

MAX_RMSE_MM = 5.0  # beyond this the tip did not stay in one place


@dataclass(frozen=True, slots=True, eq=False)
class _Estimate:
    """Estimated tip and pivot, and which poses they rest on."""

    tip_marker: Vector3
    pivot_tracker: Vector3
    covariance: Floats  # (6, 6) of both
    used: Bools  # (n,)
    known_reasons: dict[str, Bools]  # reason -> rows (n,) that it excludes


@dataclass(frozen=True, slots=True, eq=False)
class _MarkerModel:
    """Error model of the markers behind a maximum-likelihood estimate."""

    sigma_mm: float  # 3D RMS of one marker, as estimated
    noise: MarkerNoise
    positions_marker: Floats
    complaints: tuple[str, ...]  # about the marker geometry


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
    keep = as_keep(exclude, len(Ts_tracker_marker))
    _require_poses(Ts_tracker_marker, keep, dof, at_least)
    if method == "ml":
        if positions_marker is None:
            raise InvalidInputError('method "ml" needs positions_marker, the marker geometry')
        noise = noise or MarkerNoise()
        tracked = tracked_from_poses(Ts_tracker_marker, positions_marker, noise, dof=dof)
        return _solve_likely(tracked, positions_marker, keep, dof, at_least, noise, ())
    used = keep
    for step in ("aos", method):  # gross errors upset the sphere most, so the other one finds them
        used = without_gross_errors(Ts_tracker_marker, used, dof, step, at_least)
    found = solve_linear(Ts_tracker_marker.select(used), dof, method)
    return _finish(
        Ts_tracker_marker,
        _Estimate(found.tip_marker, found.pivot_tracker, found.covariance, used, {EXCLUDED: ~keep}),
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
    keep = as_keep(exclude, len(tracked.seen))
    _require_poses(tracked.Ts_tracker_marker, keep & tracked.seen, dof, at_least)
    complaints = check_marker_geometry(points_tracker, positions_marker, seen).complaints
    try:
        return _solve_likely(tracked, positions_marker, keep, dof, at_least, noise, complaints)
    except DegenerateGeometryError as error:
        if not complaints:
            raise
        raise DegenerateGeometryError("; ".join((*complaints, str(error)))) from error


def _solve_likely(
    tracked: TrackedPoses,
    positions_marker: ArrayLike,
    keep: Bools,
    dof: int,
    at_least: int,
    noise: MarkerNoise,
    complaints: tuple[str, ...],
) -> PivotFit:
    counting = keep & tracked.seen
    found = estimate_tip(tracked, dof=dof, keep=counting, sigma_mm=noise.sigma_mm)
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
        _Estimate(
            found.tip_marker,
            found.pivot_tracker,
            found.covariance,
            used,
            {EXCLUDED: ~keep, UNSEEN: ~tracked.seen},
        ),
        dof,
        markers=_MarkerModel(found.sigma_mm, noise, as_floats(positions_marker), complaints),
    )


def _finish(
    Ts_tracker_marker: Poses,
    estimate: _Estimate,
    dof: int,
    *,
    narrowness: int = 1,
    markers: _MarkerModel | None = None,
) -> PivotFit:
    """Check the swing of the poses used, list what was rejected and judge the result."""
    tip, used = estimate.tip_marker, estimate.used
    misses = Ts_tracker_marker @ tip - estimate.pivot_tracker
    residuals = np.linalg.norm(misses, axis=1)
    require_swing(Ts_tracker_marker.rotations[used], dof)
    levers = Ts_tracker_marker.rotations[used] @ (tip / float(np.linalg.norm(tip)))
    cone_deg = require_cone(levers)
    rmse_mm = float(np.sqrt((residuals[used] ** 2).mean()))
    if rmse_mm > MAX_RMSE_MM:
        raise DegenerateGeometryError(
            f"the tip scatters by {rmse_mm:.1f} mm about its pivot: it has slipped"
        )
    alike = 1.0 if markers is None else correlated_poses(misses[used])
    covariance = estimate.covariance * alike
    rejected = rejected_poses(residuals, used, estimate.known_reasons)
    facts = PivotFacts(
        tip_sigma_mm=float(np.sqrt(np.trace(covariance[:3, :3]))),
        cone_deg=cone_deg,
        swing_deg=swing_of_shaft_deg(levers),
        n=len(residuals),
        n_used=int(used.sum()),
        narrowness=narrowness,
        alike=alike,
    )
    if markers is not None:
        facts = _with_markers(facts, markers, Ts_tracker_marker.select(used), tip, dof)
    away = np.array([r.index for r in rejected if r.reason == AWAY], dtype=np.int64)
    verdict, reasons = judge_pivot(facts, away)
    return PivotFit(
        tip_marker=readonly(tip),
        pivot_tracker=readonly(estimate.pivot_tracker),
        covariance=readonly(covariance),
        residuals_mm=readonly(residuals),
        used=readonly(used),
        rejected=rejected,
        rmse_mm=rmse_mm,
        tip_sigma_mm=facts.tip_sigma_mm,
        cone_deg=cone_deg,
        marker_sigma_mm=facts.marker_sigma_mm,
        verdict=verdict,
        reasons=reasons,
    )


def _with_markers(
    facts: PivotFacts, markers: _MarkerModel, Ts_tracker_marker: Poses, tip: Vector3, dof: int
) -> PivotFacts:
    """Return the facts with the error of the markers, and with the cone that would be enough."""
    facts = replace(
        facts,
        marker_sigma_mm=markers.sigma_mm,
        stated_sigma_mm=markers.noise.sigma_mm,
        geometry=markers.complaints,
    )
    if facts.tip_sigma_mm <= GOOD_SIGMA_MM:
        return facts
    by_cone = sigma_by_cone(
        Ts_tracker_marker.mean().rotation,
        tip,
        markers.positions_marker,
        dof=dof,
        noise=markers.noise,
        sigma_mm=markers.noise.sigma_mm or markers.sigma_mm,
        n=max(int(facts.n_used / facts.alike), 1),
    )
    return replace(facts, by_cone=by_cone)


def _require_dof(dof: int) -> None:
    if dof not in (5, 6):
        raise InvalidInputError(f"dof must be 6 or 5, not {dof}")


def _require_poses(Ts_tracker_marker: Poses, keep: Bools, dof: int, at_least: int) -> None:
    """Refuse too few poses, and those that leave the tip open."""
    n = int(keep.sum())
    if n < at_least:
        raise InvalidInputError(f"a pivot needs at least {at_least} poses, not {n}")
    require_swing(Ts_tracker_marker.rotations[keep], dof)
