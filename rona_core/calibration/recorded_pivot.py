"""Calibrate a tip from poses that were recorded elsewhere, and say what the result is worth.

Data that determine no tip are no accident here but an answer: the verdict is bad, with the reason.
"""

from dataclasses import dataclass
from typing import Literal

from rona_core.arrays import Floats, Vector3
from rona_core.calibration.pivot import METHODS, PivotFit, PivotMethod, solve_pivot
from rona_core.calibration.pointer import MIN_POSES
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.pose import Poses

Verdict = Literal["good", "weak", "bad"]
WANTED: tuple[str, ...] = ("ml", "aos", "sphere")  # the methods that may be asked for
GOOD_SIGMA_MM = 0.5  # predicted 3D deviation of the tip: as good as the limit of its error
WORST_SIGMA_MM = 2.0  # beyond this the tip is not known
NARROW_DEG = 15.0  # half-angle below which the tip along the shaft is known badly
MANY_REJECTED = 0.1  # share of the poses


@dataclass(frozen=True, slots=True, eq=False)
class RecordedPivotCalibration:
    """The tip, how well it is known, and what to do where it is not; None where it is bad."""

    verdict: Verdict
    reasons: tuple[str, ...]  # none where it is good
    n_used: int
    n_rejected: int
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
) -> RecordedPivotCalibration:
    """Return the tip of a marker that swung about it, with a verdict.

    Args:
        Ts_tracker_marker: Poses of the marker.
        dof: 6; or 5 where only the z axis of the marker is known and the tip lies on it.
        method: "ml", "aos" or "sphere", see :func:`rona_core.calibration.pivot.solve_pivot`.
        geometry_marker: Markers (m, 3) of the tool, where they are known.

    Raises:
        InvalidInputError: unknown method or dof.
    """
    if method not in WANTED:
        raise InvalidInputError(f"method must be one of {', '.join(WANTED)}, not {method!r}")
    if dof not in (5, 6):
        raise InvalidInputError(f"dof must be 6 or 5, not {dof}")
    n = len(Ts_tracker_marker)
    if n < MIN_POSES:
        return _refused(f"too few poses: at least {MIN_POSES} are needed, not {n}", n)
    try:
        fit = _solve(Ts_tracker_marker, dof, method)
    except DegenerateGeometryError as error:
        return _refused(str(error), n)
    if dof == 5 and fit.tip_marker[2] <= 0.0:
        return _refused(
            f"the tip lies {-fit.tip_marker[2]:.1f} mm behind the markers: z must point to the tip",
            n,
        )
    return _judged(fit)


def _solve(Ts_tracker_marker: Poses, dof: int, method: str) -> PivotFit:
    """Return the solution; where the solver lacks the maximum-likelihood one, the algebraic one."""
    known: dict[str, PivotMethod] = {name: name for name in METHODS}
    chosen = known.get(method, "aos")
    return solve_pivot(Ts_tracker_marker, dof=dof, method=chosen, at_least=MIN_POSES)


def _refused(reason: str, n: int) -> RecordedPivotCalibration:
    return RecordedPivotCalibration("bad", (reason,), 0, n)


def _judged(fit: PivotFit) -> RecordedPivotCalibration:
    n_used = int(fit.used.sum())
    n_rejected = len(fit.used) - n_used
    if fit.tip_sigma_mm > WORST_SIGMA_MM:
        return _refused(
            f"the tip is known to {fit.tip_sigma_mm:.1f} mm only ({fit.cone_deg:.0f} degrees "
            "half-angle): record more poses over a wider cone",
            len(fit.used),
        )
    reasons: list[str] = []
    if fit.tip_sigma_mm > GOOD_SIGMA_MM:
        reasons.append(
            f"the predicted deviation of the tip is {fit.tip_sigma_mm:.2f} mm, "
            f"{GOOD_SIGMA_MM:g} mm or less is good: record more poses over a wider cone"
        )
    if fit.cone_deg < NARROW_DEG:
        reasons.append(
            f"the swing covers a cone of {fit.cone_deg:.0f} degrees half-angle, "
            f"{NARROW_DEG:.0f} or more are good: tilt farther to all sides"
        )
    if n_rejected > MANY_REJECTED * len(fit.used):
        reasons.append(
            f"{n_rejected} of {len(fit.used)} poses do not fit a common pivot and were dropped: "
            "keep the tip in its dimple and the markers in view"
        )
    return RecordedPivotCalibration(
        verdict="weak" if reasons else "good",
        reasons=tuple(reasons),
        n_used=n_used,
        n_rejected=n_rejected,
        tip_marker=fit.tip_marker,
        pivot_tracker=fit.pivot_tracker,
        sigma_mm=fit.tip_sigma_mm,
        rmse_mm=fit.rmse_mm,
    )
