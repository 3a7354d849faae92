"""The tip of a swinging body by maximum likelihood, robust, with its covariance.

Every pose may be corrected a little, by a turn and a shift that cost as much as the noise of the
markers makes them unlikely, until the tip stays in one place: errors in variables, solved by
Gauss-Helmert steps (the corrections are eliminated pose by pose). Poses that need too much
correction lose their weight by Tukey's function.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from rona_core.calibration.pivot.initial_guess import robust_start
from rona_core.calibration.tracking_error.poses_with_covariance import TrackedPoses, cross_matrices
from rona_core.geometry.arrays import Bools, Floats, Vector3, readonly
from rona_core.geometry.robust import tukey_weights_of_squares

CUTOFF = 5.49  # standard deviations; 95 % efficient in three dimensions
MEDIAN_CHI2 = 2.366  # of three degrees of freedom
MAX_STEPS = 100
TOLERANCE = 1e-10  # of the lever, for the last step ...
SETTLED = 1e-5  # ... or at worst, after the most steps
SCALE_STEPS = 20
SCALE_TOLERANCE = 1e-3
MIN_SIGMA_MM = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class LikelyTip:
    """The most likely tip and pivot; per-pose statistics in units of the estimated noise."""

    tip_marker: Vector3  # (3,) mm
    pivot_tracker: Vector3  # (3,) mm
    covariance: Floats  # (6, 6) mm^2 of tip (in marker), then pivot (in tracker)
    sigma_mm: float  # 3D RMS of one marker that the tip's scatter tells of
    distances: Floats  # (n,) Mahalanobis distance of each pose from a common tip, 3 freedoms
    weights: Floats  # (n,) 0 for poses that were dropped
    settled: bool


@dataclass(frozen=True, slots=True, eq=False)
class _Step:
    """One linearisation: what to add to the unknowns, and the cost of each pose."""

    move: Floats  # (k + 3,)
    turns: Floats  # (n, 3) corrections of the rotations
    costs: Floats  # (n,) squared Mahalanobis distance for markers with a 3D RMS of 1 mm
    costs_before: Floats  # (n,) the same without the move
    information: Floats  # (n, k + 3, k + 3)


def fit_likely_tip(
    tracked: TrackedPoses,
    *,
    dof: int,
    keep: Bools,
    sigma_mm: float | None = None,
    cutoff: float = CUTOFF,
) -> LikelyTip:
    """Return the tip that makes the measured poses most likely.

    Args:
        tracked: Poses with the covariance of their errors.
        dof: 6; or 5, where the tip is sought on the z axis of ``marker`` only.
        keep: (n,) False for poses that must not count.
        sigma_mm: 3D RMS of one marker for the covariance; None takes what the data tell.
        cutoff: Mahalanobis distance from which a pose counts nothing; infinity for no such limit.
    """
    R, p = tracked.Ts_tracker_marker.rotations, tracked.centers_tracker()
    basis = np.eye(3) if dof == 6 else np.eye(3)[:, 2:]  # directions the tip may move along
    k = basis.shape[1]
    origin = p[keep].mean(axis=0)
    p = p - origin
    x = robust_start(R @ basis, p, keep)
    turns = np.zeros_like(p)
    step = _linearise(R, p, tracked.covariances, turns, x, basis, keep.astype(np.float64))
    variance = max(float(np.median(step.costs_before[keep])) / MEDIAN_CHI2, MIN_SIGMA_MM**2)
    weights = tukey_weights_of_squares(step.costs_before / variance / cutoff**2) * keep
    scaled, change = False, np.inf  # first the scale, then with it the tip (an MM estimator)
    for number in range(MAX_STEPS):
        step = _linearise(R, p, tracked.covariances, turns, x, basis, weights)
        x, turns = x + step.move, step.turns
        change = np.abs(step.move).max() / np.abs(x).max()
        if not scaled:
            was, variance = variance, _variance(step.costs[keep], variance, cutoff, k + 3)
            scaled = abs(variance - was) < SCALE_TOLERANCE * was or number >= SCALE_STEPS
        weights = tukey_weights_of_squares(step.costs / variance / cutoff**2) * keep
        if scaled and change < TOLERANCE:
            break
    scale = variance if sigma_mm is None else sigma_mm**2
    tip_covariance = _covariance(step, weights, variance, cutoff) * scale
    spread = np.zeros((6, k + 3))
    spread[:3, :k], spread[3:, k:] = basis, np.eye(3)
    tip = basis @ x[:k] + (tracked.reference_marker if dof == 6 else 0.0)
    if dof == 5:
        tip = np.array((0.0, 0.0, x[0] + tracked.reference_marker[2]))
    return LikelyTip(
        tip_marker=readonly(tip),
        pivot_tracker=readonly(x[k:] + origin),
        covariance=readonly(spread @ tip_covariance @ spread.T),
        sigma_mm=float(np.sqrt(variance)),
        distances=readonly(np.sqrt(np.maximum(step.costs, 0.0) / variance)),
        weights=readonly(weights),
        settled=bool(change < SETTLED),
    )


def tip_information(tracked: TrackedPoses, tip_marker: Vector3, *, dof: int) -> Floats:
    """Return what each pose tells about tip and pivot (n, k + 3, k + 3), per mm^2 of noise.

    Its sum is the inverse of the covariance for markers with a 3D RMS of 1 mm; k is 3, or 1 for 5D.
    """
    basis = np.eye(3) if dof == 6 else np.eye(3)[:, 2:]
    p = tracked.centers_tracker()
    x = np.concatenate((basis.T @ (tip_marker - tracked.reference_marker), np.zeros(3)))
    R, none = tracked.Ts_tracker_marker.rotations, np.zeros_like(p)
    return _gaps(R, p, tracked.covariances, none, x, basis).information()


@dataclass(frozen=True, slots=True, eq=False)
class _Gaps:
    """exp(-turn) R tip + p - shift - pivot, which must vanish, linear about the corrections."""

    gaps: Floats  # (n, 3) mm
    by_unknowns: Floats  # (n, 3, k + 3)
    turn_gap: Floats  # (n, 3, 3) covariance of turn and minus gap
    whitened: Floats  # (n, 3, k + 3) inverse covariance of the gap, times by_unknowns
    whitened_gaps: Floats  # (n, 3) the same, times gaps

    def information(self) -> Floats:
        """Return what each pose tells about the unknowns (n, k + 3, k + 3)."""
        return np.swapaxes(self.by_unknowns, 1, 2) @ self.whitened


def _gaps(
    R: Floats, p: Floats, covariances: Floats, turns: Floats, x: Floats, basis: Floats
) -> _Gaps:
    k = basis.shape[1]
    turned = Rotation.from_rotvec(-turns).as_matrix() @ R
    lever = turned @ (basis @ x[:k])
    cross = cross_matrices(turns)
    right = np.eye(3) - 0.5 * cross + (cross @ cross) / 6.0  # right Jacobian of a small turn
    by_turn = cross_matrices(lever) @ right
    by_turn_t = np.swapaxes(by_turn, 1, 2)
    by_unknowns = np.concatenate(
        (turned @ basis, np.broadcast_to(-np.eye(3), (len(p), 3, 3))), axis=2
    )
    gaps = lever + p - x[k:] - np.einsum("nij,nj->ni", by_turn, turns)
    turn_gap = covariances[:, :3, :3] @ by_turn_t - covariances[:, :3, 3:]
    gap_gap = by_turn @ turn_gap - covariances[:, 3:, :3] @ by_turn_t + covariances[:, 3:, 3:]
    wanted = np.concatenate((by_unknowns, gaps[..., None]), axis=2)
    solved: Floats = np.asarray(np.linalg.solve(gap_gap, wanted), dtype=np.float64)
    return _Gaps(gaps, by_unknowns, turn_gap, solved[..., :-1], solved[..., -1])


def _linearise(
    R: Floats,
    p: Floats,
    covariances: Floats,
    turns: Floats,
    x: Floats,
    basis: Floats,
    weights: Floats,
) -> _Step:
    """Return the step to the tip that is most likely for these weights (n,)."""
    model = _gaps(R, p, covariances, turns, x, basis)
    information = model.information()
    pull = np.einsum("nij,ni->nj", model.by_unknowns, model.whitened_gaps)
    move = np.linalg.solve(np.einsum("n,nij->ij", weights, information), -(weights @ pull))
    forces = model.whitened @ move + model.whitened_gaps
    left = model.by_unknowns @ move + model.gaps
    return _Step(
        move=move,
        turns=-np.einsum("nij,nj->ni", model.turn_gap, forces),
        costs=np.einsum("ni,ni->n", forces, left),
        costs_before=np.einsum("ni,ni->n", model.gaps, model.whitened_gaps),
        information=information,
    )


def _variance(costs: Floats, variance: float, cutoff: float, unknowns: int) -> float:
    """Return the next estimate of the variance, right for normal errors of three freedoms."""
    weights = tukey_weights_of_squares(costs / variance / cutoff**2)
    # E[w r^2] / E[w] of Tukey's weights, where r^2 has a chi-square distribution
    c2 = cutoff**2
    expected = (3.0 - 30.0 / c2 + 105.0 / c2**2) / (1.0 - 6.0 / c2 + 15.0 / c2**2)
    n = float((weights > 0).sum())
    freedom = max(3.0 * n - unknowns, 1.0) / (3.0 * n)
    return max(float(weights @ costs / weights.sum()) / (expected * freedom), MIN_SIGMA_MM**2)


def _covariance(step: _Step, weights: Floats, variance: float, cutoff: float) -> Floats:
    """Return the covariance of an M-estimator per unit of variance (Huber's formula)."""
    used = weights > 0
    share = step.costs[used] / variance / cutoff**2
    spread = float((weights[used] ** 2 * step.costs[used]).mean()) / (3.0 * variance)
    slope = float(((1.0 - share) ** 2 - 4.0 / 3.0 * share * (1.0 - share)).mean())
    n = float(used.sum())
    unknowns = step.information.shape[1]
    spread *= 3.0 * n / max(3.0 * n - unknowns, 1.0)
    return np.linalg.inv(step.information[used].sum(axis=0)) * (spread / slope**2)
