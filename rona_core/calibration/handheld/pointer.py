"""Calibration of the pointer, from its pivoting here or recorded by another system.

Pivot calibration from recorded poses or markers of other systems, with a verdict. Data that
determine no tip are no accident here but an answer: the verdict is bad, with the reason.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from rona_core.calibration.pivot.maximum_likelihood import MIN_SIGMA_MM
from rona_core.calibration.pivot.motion_extent import require_swing
from rona_core.calibration.pivot.pivot_calibration import (
    METHODS,
    PivotFit,
    PivotMethod,
    RejectedPose,
    solve_pivot,
)
from rona_core.calibration.pivot.pose_convention import require_convention
from rona_core.calibration.pivot.quality import Verdict
from rona_core.calibration.tracking_error import EVEN, MarkerNoise, tracked_from_poses
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Vector3, readonly
from rona_core.geometry.pose import Poses
from rona_core.geometry.pose_covariance import cross_matrices

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


# Markers that stand in for unknown ones: a ring, or two on a line.
RING = np.array(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)))
RING_MM = (20.0, 200.0)  # its radius, least and most
LINE = np.array(((0.0, 0.0, -50.0), (0.0, 0.0, 50.0)))
NOISES = tuple(MarkerNoise(1.25**k) for k in range(10))  # depth 1 to 7.5 times lateral


@dataclass(frozen=True, slots=True, eq=False)
class RecordedPivotCalibration:
    """The tip and how well it is known; None where the data determine none."""

    verdict: Verdict
    reasons: tuple[str, ...]  # why not good, and what to do about it; none where it is good
    n_used: int
    n_rejected: int
    n_repeated: int  # poses that only repeat the one before, neither used nor rejected
    tip_marker: Vector3 | None = None  # (3,) mm
    pivot_tracker: Vector3 | None = None  # (3,) mm
    sigma_mm: float | None = None  # predicted 3D standard deviation of the tip
    rmse_mm: float | None = None  # distance of the tip from the pivot over the poses used


def calibrate_recorded_pivot(
    Ts_tracker_marker: Poses,
    *,
    dof: int = 6,
    method: str = "ml",
    geometry_marker: Floats | None = None,
    noise: MarkerNoise | None = None,
    direction_known: bool = False,
) -> RecordedPivotCalibration:
    """Return the tip of a marker that swung about it, with a verdict.

    The poses must be those of the marker in the tracker; what else they may be is looked for, see
    `require_convention`.

    "ml" takes the ratio of depth error to lateral error from the scatter of the tip. Where the
    markers are unknown, it assumes errors alike in all directions, of a ring of four whose radius
    explains that scatter.

    Args:
        Ts_tracker_marker: Poses of the marker.
        dof: 6; or 5 where only the z axis of the marker is known and the tip lies on it.
        method: "ml" or "sphere", as in `solve_pivot`.
        geometry_marker: Markers (m, 3) of the tool, where they are known.
        noise: What is known of single markers; by default the shape of their errors is estimated.
        direction_known: Whether the file names the frames of its poses.

    Raises:
        InvalidInputError: unknown method or dof, or poses in another convention, with its name.
    """
    known, n = _known_method(dof, method), len(Ts_tracker_marker)
    if n < MIN_POSES:
        return _refused(f"too few poses: at least {MIN_POSES} are needed, not {n}", n)
    try:
        require_swing(Ts_tracker_marker.rotations, dof)
        require_convention(Ts_tracker_marker, dof=dof, direction_known=direction_known)
        fit = solve_recorded_pivot(
            Ts_tracker_marker,
            dof=dof,
            method=known,
            geometry_marker=geometry_marker,
            noise=noise,
        )
    except DegenerateGeometryError as error:
        return _refused(str(error), n)
    n_used = int(fit.used.sum())
    return RecordedPivotCalibration(
        verdict=fit.verdict,
        reasons=fit.reasons,
        n_used=n_used,
        n_rejected=len(fit.used) - n_used - fit.n_repeated,
        n_repeated=fit.n_repeated,
        tip_marker=fit.tip_marker,
        pivot_tracker=fit.pivot_tracker,
        sigma_mm=fit.tip_sigma_mm,
        rmse_mm=fit.rmse_mm,
    )


def solve_recorded_pivot(
    Ts_tracker_marker: Poses,
    *,
    dof: int,
    method: PivotMethod,
    geometry_marker: Floats | None,
    noise: MarkerNoise | None = None,
    exclude: ArrayLike | None = None,
) -> PivotFit:
    """Return the tip as `calibrate_recorded_pivot` does, whatever the convention of the poses.

    Args:
        Ts_tracker_marker: Poses of the marker.
        dof: 6 or 5.
        method: "ml" or "sphere".
        geometry_marker: Markers (m, 3) of the tool, where they are known.
        noise: What is known of single markers, with their geometry.
        exclude: (n,) True for poses that must not count.

    Raises:
        InvalidInputError: too few poses.
        DegenerateGeometryError: the poses determine no tip.
    """

    def solved(positions_marker: Floats, noise: MarkerNoise = EVEN) -> PivotFit:
        return solve_pivot(
            Ts_tracker_marker,
            dof=dof,
            method=method,
            at_least=MIN_POSES,
            positions_marker=positions_marker,
            noise=noise,
            exclude=exclude,
        )

    if geometry_marker is not None and noise is not None:
        return solved(geometry_marker, noise)
    if geometry_marker is not None:
        even = solved(geometry_marker)
        if method == "sphere":
            return even
        return solved(geometry_marker, _likely_noise(Ts_tracker_marker, dof, geometry_marker, even))
    if dof == 5:  # on a line the place of its markers weighs nothing but their common noise
        return solved(LINE)
    first = solved(RING_MM[1] * RING)
    return first if method == "sphere" else solved(_stand_in(Ts_tracker_marker, first))


def _likely_noise(
    Ts_tracker_marker: Poses, dof: int, geometry_marker: Floats, fit: PivotFit
) -> MarkerNoise:
    """Return the noise whose shape makes the misses of the tip most likely, whatever its size.

    A miss w is normal with the covariance N = [L]x cov(turn) [L]x' + cov(shift) for the lever L.
    """
    used = Ts_tracker_marker.select(fit.used)
    misses = used @ fit.tip_marker - fit.pivot_tracker

    def surprise(noise: MarkerNoise) -> float:
        tracked = tracked_from_poses(used, geometry_marker, noise, dof=dof)
        crossed = cross_matrices(used.rotations @ (fit.tip_marker - tracked.reference_marker))
        Q = tracked.covariances
        N = crossed @ Q[:, :3, :3] @ np.swapaxes(crossed, 1, 2) + Q[:, 3:, 3:]
        squares = (misses * np.linalg.solve(N, misses[..., None])[..., 0]).sum()
        size = 3.0 * np.log(max(squares, np.finfo(np.float64).tiny))
        return float(np.linalg.slogdet(N)[1].mean() + size)

    return min(NOISES, key=surprise)


def _stand_in(Ts_tracker_marker: Poses, fit: PivotFit) -> Floats:
    """Return a ring of four markers about the origin whose errors scatter the tip as it was found.

    Along the lever L the tip scatters with the shift of the poses alone, across it with their turn
    as well. Four markers at radius r turn by sqrt(2) / r per unit of shift.
    """
    used = Ts_tracker_marker.select(fit.used)
    length = float(np.linalg.norm(fit.tip_marker))
    misses = used @ fit.tip_marker - fit.pivot_tracker
    along = np.einsum("ni,ni->n", misses, used.rotations @ (fit.tip_marker / length))
    shift = float((along**2).mean())
    turn = (float((misses**2).sum(axis=1).mean()) - shift) / 2.0 - shift
    radius = RING_MM[1]
    if turn > 0.0:
        radius = float(np.clip(length * np.sqrt(2.0 * shift / turn), *RING_MM))
    return radius * RING


def _known_method(dof: int, method: str) -> PivotMethod:
    if dof not in (5, 6):
        raise InvalidInputError(f"dof must be 6 or 5, not {dof}")
    for name in METHODS:
        if name == method:
            return name
    raise InvalidInputError(f"method must be one of {', '.join(METHODS)}, not {method!r}")


def _refused(reason: str, n: int) -> RecordedPivotCalibration:
    return RecordedPivotCalibration("bad", (reason,), 0, n, 0)
