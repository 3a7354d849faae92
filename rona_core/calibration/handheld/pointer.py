"""Pointer calibration: the tip in the frame of the pointer's markers."""

from dataclasses import dataclass, field
from typing import Literal

from numpy.typing import ArrayLike

from rona_core.calibration.pivot.maximum_likelihood import MIN_SIGMA_MM
from rona_core.calibration.pivot.pivot_calibration import (
    PivotFit,
    PivotMethod,
    RejectedPose,
    solve_pivot,
)
from rona_core.calibration.pivot.quality import Verdict
from rona_core.calibration.tracking_error import MarkerNoise
from rona_core.geometry.arrays import Bools, Floats, Vector3, readonly
from rona_core.geometry.pose import Poses

MIN_POSES = 10


@dataclass(frozen=True, slots=True, eq=False)
class PointerCalibration:
    """The tip of a pointer in ``pointermarker`` and how well it is known."""

    pointer: str
    dof: int
    method: str
    tip_pointermarker: Vector3  # (3,) mm
    tip_covariance_pointermarker: Floats  # (3, 3) mm^2; of a 5D pointer along its line only
    pivot_tracker: Vector3  # (3,) mm, where the tip stood
    rmse_mm: float  # scatter of the tip over the poses used; says little about the error
    residuals_mm: Floats  # (n,) of every pose
    used: Bools  # (n,) False for poses that do not count
    rejected: tuple[RejectedPose, ...]  # those, and why
    n_used: int
    cone_deg: float  # half-angle covered
    tip_sigma_mm: float  # predicted 3D standard deviation of the tip
    # 3D RMS of one marker, estimated; only "ml"
    marker_sigma_mm: float | None = field(metadata={"least": MIN_SIGMA_MM})
    verdict: Verdict
    reasons: tuple[str, ...]  # why not good, and what to do about it
    # (3, 3) the part of the tip's covariance that more poses lessen; None: all of it
    random_covariance: Floats | None = field(default=None, metadata={"omit_empty": True})


def calibrate_pointer(
    Ts_tracker_pointermarker: Poses,
    *,
    pointer: str,
    dof: Literal[6, 5],
    method: PivotMethod = "ml",
    positions_pointermarker: ArrayLike | None = None,
    noise: MarkerNoise | None = None,
    exclude: ArrayLike | None = None,
) -> PointerCalibration:
    """Return the tip of a pointer from poses swung about its resting tip.

    With ``dof=5`` the markers lie on one line, the z axis of ``pointermarker`` towards the tip. The
    result is (0, 0, L): a tip beside the line by e mm leaves an error of up to e that neither data
    nor covariance show.

    Args:
        Ts_tracker_pointermarker: Poses in which the pointer was seen, at least 10, in order.
        pointer: Name of the pointer.
        dof: 6, or 5 for collinear markers.
        method: "ml" (maximum likelihood) or "sphere" (the paper's).
        positions_pointermarker: Marker geometry (m, 3) in mm; "ml" needs it.
        noise: What "ml" assumes about single markers; by default three times as much in depth.
        exclude: (n,) True for poses that must not count.

    Raises:
        InvalidInputError: fewer than 10 poses, no geometry, unknown method or dof.
        DegenerateGeometryError: static pointer, swing in one plane or below 5 degrees half-angle,
            a slipping tip, or (5D) a z axis that points away from the tip.
    """
    fit = solve_pivot(
        Ts_tracker_pointermarker,
        dof=dof,
        method=method,
        at_least=MIN_POSES,
        positions_marker=positions_pointermarker,
        noise=noise,
        exclude=exclude,
    )
    return pointer_calibration(fit, pointer=pointer, dof=dof, method=method)


def pointer_calibration(
    fit: PivotFit, *, pointer: str, dof: int, method: PivotMethod
) -> PointerCalibration:
    """Return a pivot as the calibration of a pointer."""
    return PointerCalibration(
        pointer=pointer,
        dof=dof,
        method=method,
        tip_pointermarker=fit.tip_marker,
        tip_covariance_pointermarker=readonly(fit.covariance[:3, :3]),
        pivot_tracker=fit.pivot_tracker,
        rmse_mm=fit.rmse_mm,
        residuals_mm=fit.residuals_mm,
        used=fit.used,
        rejected=fit.rejected,
        n_used=int(fit.used.sum()),
        cone_deg=fit.cone_deg,
        tip_sigma_mm=fit.tip_sigma_mm,
        marker_sigma_mm=fit.marker_sigma_mm,
        verdict=fit.verdict,
        reasons=fit.reasons,
    )
