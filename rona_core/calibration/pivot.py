"""Find the fixed tip of a tracked body that swings about it: shared by pointer and tool."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rona_core.arrays import Bools, Floats, Vector3, readonly
from rona_core.calibration.sphere import cap_half_angle_deg, fit_sphere
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.pose import Poses

PivotMethod = Literal["sphere", "aos"]
METHODS: tuple[PivotMethod, ...] = ("sphere", "aos")

MIN_CONE_DEG = 5.0  # half-angle that the lever must cover
MIN_CROSS_DEG = 2.5  # half-angle of an even cone that turns as much about its weakest axis
STATIC_DEG = 1.0
GROSS = 4.0  # a pose is dropped beyond this multiple of the median residual (6 sigma) ...
GROSS_FLOOR_MM = 1e-6  # ... which itself counts as at least this
MAX_ROUNDS = 10
MIN_SHARE = 0.7  # of the poses that must survive
MAX_RMSE_MM = 5.0  # beyond this the tip did not stay in one place


@dataclass(frozen=True, slots=True, eq=False)
class PivotFit:
    """Tip of a body in its marker frame, and the place it swung about."""

    tip_marker: Vector3  # (3,) mm
    pivot_tracker: Vector3  # (3,) mm
    residuals_mm: Floats  # (n,) distance of the tip, mapped by each pose, from the pivot
    used: Bools  # (n,) False for poses dropped as gross errors
    rmse_mm: float  # of the residuals that were used
    tip_sigma_mm: float  # predicted 3D standard deviation of the tip
    cone_deg: float  # half-angle covered by the lever


def solve_pivot(
    Ts_tracker_marker: Poses, *, dof: int, method: PivotMethod, at_least: int
) -> PivotFit:
    """Return the tip in ``marker`` that stays at one place in ``tracker``.

    Args:
        Ts_tracker_marker: Poses of the swinging marker.
        dof: 6; or 5 where only the z axis of the marker is known and the tip lies on it.
        method: "sphere" fits a sphere to the marker origins, its centre is the pivot, and the
            tip is the mean of the pivot seen from each pose; "aos" solves
            R_i tip - pivot = -t_i (algebraic one step) for both at once.
        at_least: Fewest poses accepted.

    Raises:
        InvalidInputError: unknown method or dof, or too few poses.
        DegenerateGeometryError: the swing is static, in one plane or too small, or the poses do
            not share a tip.
    """
    if method not in METHODS:
        raise InvalidInputError(f"method must be one of {', '.join(METHODS)}, not {method!r}")
    if dof not in (5, 6):
        raise InvalidInputError(f"dof must be 6 or 5, not {dof}")
    n = len(Ts_tracker_marker)
    if n < at_least:
        raise InvalidInputError(f"a pivot needs at least {at_least} poses, not {n}")
    _require_swing(Ts_tracker_marker.rotations, dof)
    used = np.ones(n, dtype=np.bool_)
    for step in ("aos", method):  # gross errors upset the sphere most, so the other one finds them
        used = _without_gross_errors(Ts_tracker_marker, used, dof, step, at_least)
    tip, pivot, sigma = _solve(Ts_tracker_marker.select(used), dof, method)
    residuals = np.linalg.norm(Ts_tracker_marker @ tip - pivot, axis=1)
    _require_swing(Ts_tracker_marker.rotations[used], dof)
    length = float(np.linalg.norm(tip))
    levers = Ts_tracker_marker.rotations[used] @ (tip / length)
    cone_deg = cap_half_angle_deg(levers)
    if cone_deg < MIN_CONE_DEG:
        raise DegenerateGeometryError(
            f"the swing covers a cone of only {cone_deg:.1f} degrees half-angle, "
            f"{MIN_CONE_DEG:.0f} are needed"
        )
    rmse_mm = float(np.sqrt((residuals[used] ** 2).mean()))
    if rmse_mm > MAX_RMSE_MM:
        raise DegenerateGeometryError(
            f"the tip scatters by {rmse_mm:.1f} mm about its pivot: it has slipped"
        )
    return PivotFit(
        tip_marker=readonly(tip),
        pivot_tracker=readonly(pivot),
        residuals_mm=readonly(residuals),
        used=readonly(used),
        rmse_mm=rmse_mm,
        tip_sigma_mm=sigma,
        cone_deg=cone_deg,
    )


def _without_gross_errors(
    Ts_tracker_marker: Poses, used: Bools, dof: int, method: PivotMethod, at_least: int
) -> Bools:
    """Return which poses (n,) agree on a pivot; refuse if too many do not."""
    n = len(used)
    for _ in range(MAX_ROUNDS):
        tip, pivot, _ = _solve(Ts_tracker_marker.select(used), dof, method)
        residuals = np.linalg.norm(Ts_tracker_marker @ tip - pivot, axis=1)
        limit = GROSS * max(float(np.median(residuals)), GROSS_FLOOR_MM)
        good = residuals <= limit
        if good.sum() < max(at_least, MIN_SHARE * n):
            raise DegenerateGeometryError(
                f"{n - int(good.sum())} of {n} poses lie more than {limit:.2g} mm from a common "
                "pivot: the tip has slipped"
            )
        if np.array_equal(good, used):
            break
        used = good
    return used


def _require_swing(rotations: Floats, dof: int) -> None:
    """Refuse rotations that leave some direction of the tip unobserved.

    ``mean |R v - mean(R v)|^2`` is how much a lever along v moves, per length squared. For an even
    cone of half-angle w without spin it is w^2 / 4 across the shaft, so 2 sqrt() is the angle.
    """
    deviations = rotations - rotations.mean(axis=0)
    if dof == 5:
        mean = rotations[:, :, 2].mean(axis=0)
        across = np.linalg.svd(mean[None] / np.linalg.norm(mean))[2][1:]  # plane across the shaft
        tilts = deviations[:, :, 2] @ across.T
        spread = np.linalg.eigvalsh(tilts.T @ tilts / len(tilts))
        weakest, strongest = np.rad2deg(2.0 * np.sqrt(np.maximum(spread, 0.0)))
    else:
        moved = np.einsum("nji,njk->ik", deviations, deviations) / len(rotations)
        spread = np.linalg.eigvalsh(moved)
        weakest, _, strongest = np.rad2deg(2.0 * np.sqrt(np.maximum(spread, 0.0)))
    if strongest < STATIC_DEG:
        raise DegenerateGeometryError(
            f"the marker hardly turned ({strongest:.2g} degrees): swing it about its tip"
        )
    if weakest < MIN_CROSS_DEG and strongest > 2.0 * MIN_CROSS_DEG:
        raise DegenerateGeometryError(
            f"the swing stays in one plane ({strongest:.1f} degrees one way, {weakest:.2g} the "
            "other): swing in two directions"
        )
    if weakest < MIN_CROSS_DEG:
        raise DegenerateGeometryError(
            f"the swing covers only about {strongest:.1f} degrees half-angle, "
            f"{MIN_CONE_DEG:.0f} are needed"
        )


def _solve(Ts_tracker_marker: Poses, dof: int, method: PivotMethod) -> tuple[Floats, Floats, float]:
    """Return tip in marker, pivot in tracker and predicted tip deviation for clean poses."""
    R, t = Ts_tracker_marker.rotations, Ts_tracker_marker.translations
    if method == "aos":
        return _solve_linear(R, t, dof)
    sphere = fit_sphere(t)
    seen = np.einsum("nji,nj->ni", R, sphere.center - t)  # the pivot from each marker frame
    tip = seen.mean(axis=0)
    if dof == 5:
        tip = np.array((0.0, 0.0, tip[2]))
    return tip, sphere.center, sphere.center_sigma_mm


def _solve_linear(R: Floats, t: Floats, dof: int) -> tuple[Floats, Floats, float]:
    """Return the least-squares tip and pivot of ``R_i tip - pivot = -t_i``."""
    n, k = len(t), 3 if dof == 6 else 1
    lever = R if dof == 6 else R[:, :, 2:]
    # without its mean each pose says: (lever_i - mean lever) x = -(t_i - mean t)
    design = (lever - lever.mean(axis=0)).reshape(3 * n, k)
    wanted = -(t - t.mean(axis=0)).reshape(3 * n)
    x = np.linalg.lstsq(design, wanted)[0]
    pivot = lever.mean(axis=0) @ x + t.mean(axis=0)
    left = design @ x - wanted
    variance = (left @ left) / (3 * n - k - 3)
    sigma = float(np.sqrt(variance * np.trace(np.linalg.inv(design.T @ design))))
    tip = x if dof == 6 else np.array((0.0, 0.0, float(x[0])))
    return tip, pivot, sigma
