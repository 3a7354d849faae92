"""Tip and pivot of a tracked body: robust first guess, maximum likelihood, repeating errors.

Robust initial guess of tip and pivot by linear least squares. Every pose says R tip - pivot = -p,
three equations that are linear in the unknowns.

Maximum-likelihood estimate of tip and pivot, robust, with its covariance. Errors in variables: each
pose is corrected by a rotation and a translation, weighted by the covariance of its errors, so that
all poses share one tip. Solved by Gauss-Helmert steps (Förstner 2016), which eliminate the
corrections pose by pose. Tukey's weights exclude poses that need too large a correction (an
MM-estimator, Yohai 1987).

Effect of repeating marker errors on a pivoted tip, and what the pivot shows of them. A field of
errors that changes under the markers while they swing acts like a change of scale and shape: a part
of it moves the tip and leaves no residual, the rest makes the tip seem to wander.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from rona_core.calibration.tracking_error import (
    LearnedField,
    MarkerNoise,
    TrackedPoses,
    fit_matrices,
    tracked_from_poses,
)
from rona_core.geometry.arrays import Bools, Floats, Ints, Vector3, readonly
from rona_core.geometry.pose import Poses
from rona_core.geometry.pose_covariance import cross_matrices
from rona_core.geometry.robust import tukey_weights_of_squares

SUBSETS = 40
SUBSET_SIZE = 6
TRIMMED = 0.6  # share of the poses that must agree
CONCENTRATIONS = 4
STEPS = 40
SEED = 1
RIDGE = 1e-12
FLOOR_MM = 1e-9


def robust_initial_guess(levers: Floats, p: Floats, keep: Bools) -> Floats:
    """Return tip and pivot (k + 3,) on which most of the poses agree.

    The best of: the least sum of distances (not of squares), and least trimmed squares from many
    small subsets (Rousseeuw and Driessen 2006).

    Args:
        levers: (n, 3, k) directions, in ``tracker``, of the k ways in which the tip may move.
        p: (n, 3) where each pose puts the origin of these ways, in mm.
        keep: (n,) False for poses that do not count.
    """
    design = np.concatenate((levers, np.broadcast_to(-np.eye(3), (len(p), 3, 3))), axis=2)[keep]
    wanted = -p[keep]
    n, k = len(wanted), design.shape[2]
    normals = (np.swapaxes(design, 1, 2) @ design).reshape(n, k * k)
    pulls = np.einsum("nij,ni->nj", design, wanted)
    trials = np.vstack((_least_distances(design, wanted, normals, pulls), _subsets(normals, pulls)))
    h = int(np.ceil(TRIMMED * n))
    score = np.zeros(len(trials))
    for _ in range(CONCENTRATIONS):
        squares = _squares(design, wanted, trials)
        limit = np.partition(squares, h - 1, axis=1)[:, h - 1 : h]
        chosen = squares <= limit
        score = np.where(chosen, squares, 0.0).sum(axis=1)
        better = _solve(chosen.astype(np.float64), normals, pulls)
        trials = np.vstack((trials[score.argmin()], better))
    return trials[0]


def _least_distances(design: Floats, wanted: Floats, normals: Floats, pulls: Floats) -> Floats:
    weights = np.ones((1, len(wanted)))
    x = _solve(weights, normals, pulls)
    for _ in range(STEPS):
        distances = np.sqrt(_squares(design, wanted, x))
        floor = max(0.05 * float(np.median(distances)), FLOOR_MM)
        new = _solve(1.0 / np.maximum(distances, floor), normals, pulls)
        settled = np.abs(new - x).max() < 1e-4 * floor
        x = new
        if settled:
            break
    return x


def _subsets(normals: Floats, pulls: Floats) -> Floats:
    """Return the solutions (s, k) of random subsets; the same subsets on every call."""
    rng = np.random.default_rng(SEED)
    n = len(normals)
    size = min(SUBSET_SIZE, n)
    chosen = rng.random((SUBSETS, n)).argsort(axis=1) < size
    return _solve(chosen.astype(np.float64), normals, pulls)


def _solve(weights: Floats, normals: Floats, pulls: Floats) -> Floats:
    """Return the weighted least-squares solutions (s, k) for weights (s, n)."""
    k = pulls.shape[1]
    total = (weights @ normals).reshape(-1, k, k)
    total += RIDGE * np.trace(total, axis1=1, axis2=2)[:, None, None] * np.eye(k)
    return np.linalg.solve(total, (weights @ pulls)[..., None])[..., 0]


def _squares(design: Floats, wanted: Floats, trials: Floats) -> Floats:
    """Return the squared distances (s, n) that solutions (s, k) leave at each pose."""
    residuals = np.tensordot(trials, design, axes=(1, 2)) - wanted
    return (residuals**2).sum(axis=2)


CUTOFF = 5.49  # standard deviations; 95 % efficient in three dimensions
MEDIAN_CHI2 = 2.366  # of three degrees of freedom
MAX_STEPS = 100
TOLERANCE = 1e-10  # of the lever, for the last step ...
SETTLED = 1e-5  # ... or at worst, after the most steps
SCALE_STEPS = 20
SCALE_TOLERANCE = 1e-3
MIN_SIGMA_MM = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class TipEstimate:
    """The most likely tip and pivot; per-pose statistics in units of the estimated noise."""

    tip_marker: Vector3  # (3,) mm
    pivot_tracker: Vector3  # (3,) mm
    covariance: Floats  # (6, 6) mm^2 of tip (in marker), then pivot (in tracker)
    sigma_mm: float  # 3D RMS of one marker, estimated from the tip's scatter
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


def estimate_tip(
    tracked: TrackedPoses,
    *,
    dof: int,
    keep: Bools,
    cutoff: float = CUTOFF,
) -> TipEstimate:
    """Return the tip that makes the measured poses most likely.

    Args:
        tracked: Poses with the covariance of their errors.
        dof: 6; or 5, where the tip is sought on the z axis of ``marker`` only.
        keep: (n,) False for poses that must not count.
        cutoff: Mahalanobis distance from which a pose counts nothing; infinity for no such limit.
    """
    R, p = tracked.Ts_tracker_marker.rotations, tracked.centers_tracker()
    basis = np.eye(3) if dof == 6 else np.eye(3)[:, 2:]  # directions the tip may move along
    k = basis.shape[1]
    origin = p[keep].mean(axis=0)
    p = p - origin
    x = robust_initial_guess(R @ basis, p, keep)
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
    tip_covariance = _covariance(step, weights, variance, cutoff) * variance
    spread = np.zeros((6, k + 3))
    spread[:3, :k], spread[3:, k:] = basis, np.eye(3)
    tip = basis @ x[:k] + (tracked.reference_marker if dof == 6 else 0.0)
    if dof == 5:
        tip = np.array((0.0, 0.0, x[0] + tracked.reference_marker[2]))
    return TipEstimate(
        tip_marker=readonly(tip),
        pivot_tracker=readonly(x[k:] + origin),
        covariance=readonly(spread @ tip_covariance @ spread.T),
        sigma_mm=float(np.sqrt(variance)),
        distances=readonly(np.sqrt(np.maximum(step.costs, 0.0) / variance)),
        weights=readonly(weights),
        settled=bool(change < SETTLED),
    )


def tip_information(tracked: TrackedPoses, tip_marker: Vector3, *, dof: int) -> Floats:
    """Return the information of each pose on tip and pivot (n, k + 3, k + 3), per mm^2 of noise.

    Its sum is the inverse of the covariance for markers with a 3D RMS of 1 mm; k is 3, or 1 for 5D.
    """
    return tip_conditions(tracked, tip_marker, dof=dof).information()


def tip_conditions(tracked: TrackedPoses, tip_marker: Vector3, *, dof: int) -> "TipConditions":
    """Return the condition equations of all poses about a tip; their misclosures mean nothing."""
    basis = np.eye(3) if dof == 6 else np.eye(3)[:, 2:]
    p = tracked.centers_tracker()
    x = np.concatenate((basis.T @ (tip_marker - tracked.reference_marker), np.zeros(3)))
    R, none = tracked.Ts_tracker_marker.rotations, np.zeros_like(p)
    return _conditions(R, p, tracked.covariances, none, x, basis)


@dataclass(frozen=True, slots=True, eq=False)
class TipConditions:
    """Condition equations of all poses, linear about the present corrections (Förstner 2016).

    f(x, v) = exp(-phi) R tip + p - d - pivot = 0 with corrections v = (phi, d) of covariance Q
    becomes A dx + B v + w = 0; N = B Q B' is the covariance of the misclosure.
    """

    w: Floats  # (n, 3) misclosure in mm
    A: Floats  # (n, 3, k + 3) df/dx
    Q_phi_B: Floats  # (n, 3, 3) covariance of phi and -w
    N_inv_A: Floats  # (n, 3, k + 3) N^-1 A
    N_inv_w: Floats  # (n, 3) N^-1 w

    def information(self) -> Floats:
        """Return the information A' N^-1 A of each pose on the unknowns (n, k + 3, k + 3)."""
        return np.swapaxes(self.A, 1, 2) @ self.N_inv_A


def _conditions(
    R: Floats, p: Floats, Q: Floats, phi: Floats, x: Floats, basis: Floats
) -> TipConditions:
    """Linearise the condition equations about unknowns x (k + 3,) and rotations phi (n, 3)."""
    k = basis.shape[1]
    R_corrected = Rotation.from_rotvec(-phi).as_matrix() @ R
    lever = R_corrected @ (basis @ x[:k])
    phi_cross = cross_matrices(phi)
    # right Jacobian of the rotation, a series that suffices for small phi
    J_right = np.eye(3) - 0.5 * phi_cross + (phi_cross @ phi_cross) / 6.0
    B_phi = cross_matrices(lever) @ J_right  # d(exp(-phi) R tip)/d phi = [lever]x J; B_d = -1
    B_phi_t = np.swapaxes(B_phi, 1, 2)
    A = np.concatenate((R_corrected @ basis, np.broadcast_to(-np.eye(3), (len(p), 3, 3))), axis=2)
    w = lever + p - x[k:] - np.einsum("nij,nj->ni", B_phi, phi)
    Q_phi_B = Q[:, :3, :3] @ B_phi_t - Q[:, :3, 3:]
    N = B_phi @ Q_phi_B - Q[:, 3:, :3] @ B_phi_t + Q[:, 3:, 3:]
    right_sides = np.concatenate((A, w[..., None]), axis=2)
    solved: Floats = np.asarray(np.linalg.solve(N, right_sides), dtype=np.float64)
    return TipConditions(w, A, Q_phi_B, solved[..., :-1], solved[..., -1])


def _linearise(
    R: Floats,
    p: Floats,
    covariances: Floats,
    phi: Floats,
    x: Floats,
    basis: Floats,
    weights: Floats,
) -> _Step:
    """Return the Gauss-Helmert step for these weights (n,)."""
    model = _conditions(R, p, covariances, phi, x, basis)
    information = model.information()
    # normal equations (sum A' N^-1 A) dx = -sum A' N^-1 w
    gradient = np.einsum("nij,ni->nj", model.A, model.N_inv_w)
    dx = np.linalg.solve(np.einsum("n,nij->ij", weights, information), -(weights @ gradient))
    # Lagrange multipliers lambda = N^-1 (A dx + w); corrections v = -Q B' lambda
    multipliers = model.N_inv_A @ dx + model.N_inv_w
    residuals = model.A @ dx + model.w
    return _Step(
        move=dx,
        turns=-np.einsum("nij,nj->ni", model.Q_phi_B, multipliers),
        costs=np.einsum("ni,ni->n", multipliers, residuals),
        costs_before=np.einsum("ni,ni->n", model.w, model.N_inv_w),
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


RUNS = 24  # of neighbouring poses: each counts as one
LEAST_NOISE_MM = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class PivotMotion:
    """Poses of a body that swung about its tip, in their order, and what was found of it."""

    Ts_tracker_marker: Poses  # those that count
    positions_marker: Floats  # (m, 3)
    dof: int
    tip_marker: Vector3
    pivot_tracker: Vector3


@dataclass(frozen=True, slots=True, eq=False)
class TipSensitivity:
    """How the tip moves with the errors of the markers in poses that stand for the motion."""

    points_tracker: Floats  # (p, 3) places of markers
    tip: Floats  # (3, p, 3) derivatives of the tip, in ``marker``


def tip_sensitivity(motion: PivotMotion) -> TipSensitivity:
    """Return how errors of the markers move the most likely tip, to first order."""
    _, some = _runs(motion)
    tracked = tracked_from_poses(some, motion.positions_marker, MarkerNoise(), dof=motion.dof)
    basis = _basis(motion.dof)
    k = basis.shape[1]
    model = tip_conditions(tracked, motion.tip_marker, dof=motion.dof)
    unknowns = np.linalg.inv(model.information().sum(axis=0))[:k]
    misses = _misses(motion, some)
    moved = -np.einsum("ik,njk,nmjl->inml", basis @ unknowns, model.N_inv_A, misses)
    points = some.map_points(motion.positions_marker).reshape(-1, 3)
    return TipSensitivity(readonly(points), readonly(moved.reshape(3, -1, 3)))


def field_of_pivot(motion: PivotMotion, field: LearnedField) -> LearnedField:
    """Return the field with the lengths that its residuals make likely."""
    tips = motion.Ts_tracker_marker @ motion.tip_marker - motion.pivot_tracker
    edges, some = _runs(motion)
    counts = np.diff(edges)
    wander = np.add.reduceat(tips, edges[:-1]) / counts[:, None]
    # white noise of a frame: what neighbours do not share
    steps = np.diff(tips, axis=0)
    white = steps.T @ steps / (2.0 * len(steps)) + LEAST_NOISE_MM**2 * np.eye(3)
    noise = np.kron(np.diag(1.0 / counts), white).astype(np.float64)
    held = np.broadcast_to(-np.eye(3), (len(some), 3, 3))
    fitted = np.concatenate((some.rotations @ _basis(motion.dof), held), axis=2).reshape(
        3 * len(some), -1
    )
    left: Floats = np.linalg.svd(fitted)[0][:, fitted.shape[1] :].T  # what no tip and pivot explain
    misses = _misses(motion, some)
    n, m = misses.shape[:2]
    rows = np.zeros((n, 3, n, m, 3))
    rows[np.arange(n), :, np.arange(n)] = np.swapaxes(misses, 1, 2)
    return field.learn(
        left @ wander.ravel(),
        np.einsum("ij,jpl->ipl", left, rows.reshape(3 * n, n * m, 3)),
        some.map_points(motion.positions_marker).reshape(-1, 3),
        left @ noise @ left.T,
    )


def _basis(dof: int) -> Floats:
    """Return the directions (3, k) that the tip may move along in ``marker``."""
    return np.eye(3) if dof == 6 else np.eye(3)[:, 2:]


def _runs(motion: PivotMotion) -> tuple[Ints, Poses]:
    """Return the edges (r + 1,) of runs of neighbouring poses, and the pose in their middle."""
    n = len(motion.Ts_tracker_marker)
    edges = np.linspace(0, n, min(RUNS, n) + 1).astype(np.int64)
    return edges, motion.Ts_tracker_marker.select((edges[:-1] + edges[1:]) // 2)


def _misses(motion: PivotMotion, some: Poses) -> Floats:
    """Return how the mapped tip (n, m, 3, 3) of each pose moves with each marker."""
    lever = some.rotations @ (motion.tip_marker - motion.positions_marker.mean(axis=0))
    turned = np.concatenate(
        (-cross_matrices(lever), np.broadcast_to(np.eye(3), (len(some), 3, 3))), axis=2
    )
    return turned[:, None] @ fit_matrices(some.rotations, motion.positions_marker)
