"""Pivot calibration by a sphere fit or by linear least squares (algebraic one step)."""

from dataclasses import dataclass

import numpy as np

from rona_core.calibration.pivot.sphere_fit import fit_sphere
from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Bools, Floats, Vector3
from rona_core.geometry.pose import Poses

GROSS = 4.0  # a pose is dropped beyond this multiple of the median residual (6 sigma) ...
GROSS_FLOOR_MM = 1e-6  # ... which itself counts as at least this
MAX_ROUNDS = 10
MIN_SHARE = 0.7  # of the poses that must survive


@dataclass(frozen=True, slots=True, eq=False)
class LinearTip:
    """Tip and pivot by one of the two methods."""

    tip_marker: Vector3  # (3,) mm
    pivot_tracker: Vector3  # (3,) mm
    covariance: Floats  # (6, 6) mm^2 of both, as far as the method knows
    tip_sigma_mm: float


def solve_linear(Ts_tracker_marker: Poses, dof: int, method: str) -> LinearTip:
    """Return tip and pivot for poses without gross errors; ``method`` is "sphere" or "aos"."""
    R, t = Ts_tracker_marker.rotations, Ts_tracker_marker.translations
    if method == "aos":
        return _algebraic(R, t, dof)
    sphere = fit_sphere(t)
    pivots_marker = np.einsum(
        "nji,nj->ni", R, sphere.center - t
    )  # the pivot from each marker frame
    tip = pivots_marker.mean(axis=0)
    if dof == 5:
        tip = np.array((0.0, 0.0, tip[2]))
    # the tip inherits the error of the centre, seen from the middle of the swing
    R_marker_tracker = Ts_tracker_marker.mean().rotation.T
    known = np.eye(3) if dof == 6 else np.diag((0.0, 0.0, 1.0))
    spread = np.vstack((known @ R_marker_tracker, np.eye(3)))
    covariance = spread @ sphere.center_covariance @ spread.T
    return LinearTip(tip, sphere.center, covariance, sphere.center_sigma_mm)


def _algebraic(R: Floats, t: Floats, dof: int) -> LinearTip:
    """Return the least-squares tip and pivot of ``R_i tip - pivot = -t_i``."""
    n, k = len(t), 3 if dof == 6 else 1
    lever = R if dof == 6 else R[:, :, 2:]
    middle = lever.mean(axis=0)
    # without its mean each pose says: (lever_i - mean lever) x = -(t_i - mean t)
    design = (lever - middle).reshape(3 * n, k)
    target = -(t - t.mean(axis=0)).reshape(3 * n)
    x = np.linalg.lstsq(design, target)[0]
    residuals = design @ x - target
    variance = (residuals @ residuals) / (3 * n - k - 3)
    by_tip = np.linalg.inv(design.T @ design)
    sigma = float(np.sqrt(variance * np.trace(by_tip)))
    known = np.eye(3) if dof == 6 else np.eye(3)[:, 2:]
    spread = np.vstack((known, middle))  # how tip and pivot follow the unknowns
    covariance = spread @ by_tip @ spread.T
    covariance[3:, 3:] += np.eye(3) / n
    tip = x if dof == 6 else np.array((0.0, 0.0, float(x[0])))
    return LinearTip(tip, middle @ x + t.mean(axis=0), variance * covariance, sigma)


def without_gross_errors(
    Ts_tracker_marker: Poses, used: Bools, dof: int, method: str, at_least: int
) -> Bools:
    """Return which of the poses ``used`` (n,) agree on a pivot.

    Raises:
        DegenerateGeometryError: too many do not.
    """
    allowed = used
    n = int(allowed.sum())
    for _ in range(MAX_ROUNDS):
        found = solve_linear(Ts_tracker_marker.select(used), dof, method)
        residuals = np.linalg.norm(
            Ts_tracker_marker @ found.tip_marker - found.pivot_tracker, axis=1
        )
        limit = GROSS * max(float(np.median(residuals[allowed])), GROSS_FLOOR_MM)
        good = allowed & (residuals <= limit)
        if good.sum() < max(at_least, MIN_SHARE * n):
            raise DegenerateGeometryError(
                f"{n - int(good.sum())} of {n} poses lie more than {limit:.2g} mm from a common "
                "pivot: the tip has slipped"
            )
        if np.array_equal(good, used):
            break
        used = good
    return used
