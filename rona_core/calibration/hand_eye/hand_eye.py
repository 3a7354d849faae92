"""Robot-world/hand-eye calibration by weighted least squares over poses seen by both.

    T_base_tip = T_base_tracker T_tracker_toolmarker T_toolmarker_tip

Every pose takes part with its turn and its shift, weighted by what its markers and the robot can
know (Gauss-Newton on the deviation of both unknown poses), from any motion with two axes of turn.
Gross errors are found by least median of squares and dropped; what is left gives the size of the
noise and the joint covariance of the two poses.

Initial guess of the hand-eye poses, robust against up to a third of wrong poses. Small subsets of
the poses are solved in closed form, and the solution with the least median error over all poses
wins (least median of squares). The closed form for the rotations is that of Shah 2013: Q B_i = M_i
P summed over the poses is a 9 x 9 matrix whose first singular vectors are the two rotations. With
them, tip and tracker position are a linear least-squares problem.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation
from scipy.special import chdtri

from rona_core.calibration.hand_eye.quality import require_two_axes
from rona_core.calibration.tracking_error import MarkerNoise, fit_covariances
from rona_core.devices.trackers import GEOMETRIES
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints, as_points, readonly
from rona_core.geometry.pose import Pose, Poses
from rona_core.geometry.pose_covariance import cross_matrices, rotation_vectors

SERIES = 1e-4  # of the angle; below it the expansion of the inverse Jacobian is exact enough
# Random error of the robot's tool pose, variances per axis:
TIP_VARIANCE_MM2 = 0.1**2 / 3.0  # of the tip, 0.1 mm 3D RMS
TURN_VARIANCE_RAD2 = float(np.deg2rad(0.02)) ** 2 / 3.0  # of its rotation, 0.02 degrees RMS
DOF = 6  # of one pose
FLOOR_MM = 1e-6  # of the marker error
CEILING_MM = 1e3
MEDIAN = float(chdtri(DOF, 0.5))  # of the squared distance of a good pose
GROSS = float(chdtri(DOF, 1e-3))  # one good pose in a thousand lies beyond
BISECTIONS = 45


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """Poses seen by robot and tracker, ready for the solve."""

    Ts_base_tip: Poses
    Ts_tracker_toolmarker: Poses
    centroid_toolmarker: Floats  # (3,) of the markers
    centroids_tracker: Floats  # (n, 3)
    unit_covariances: Floats  # (n, 6, 6) of (turn, shift) in tracker, marker error 1 mm 3D RMS
    # of the robot's own error: of the tip in mm^2, of its rotation in rad^2, per axis
    robot_variances: tuple[float, float] = (TIP_VARIANCE_MM2, TURN_VARIANCE_RAD2)
    gross: float = GROSS  # squared distance from which a pose is a gross error

    def __len__(self) -> int:
        return len(self.Ts_base_tip)


def observe(
    Ts_base_tip: Poses,
    Ts_tracker_toolmarker: Poses,
    positions_toolmarker: Floats,
    noise: MarkerNoise,
) -> Observations:
    """Return the observations with the covariance of every pose that the tracker fits."""
    centroid = positions_toolmarker.mean(axis=0)
    return Observations(
        Ts_base_tip,
        Ts_tracker_toolmarker,
        centroid,
        Ts_tracker_toolmarker @ centroid,
        fit_covariances(Ts_tracker_toolmarker.rotations, positions_toolmarker, noise),
    )


def residuals(observations: Observations, T_base_tracker: Pose, T_toolmarker_tip: Pose) -> Floats:
    """Return measured minus expected marker pose (n, 6): turn, shift of the centroid in tracker."""
    R_tracker_base = T_base_tracker.rotation.T
    expected = R_tracker_base @ observations.Ts_base_tip.rotations @ T_toolmarker_tip.rotation.T
    turns = rotation_vectors(
        observations.Ts_tracker_toolmarker.rotations @ np.swapaxes(expected, 1, 2)
    )
    centroid_tip = T_toolmarker_tip.inv() @ observations.centroid_toolmarker
    centroids_base = observations.Ts_base_tip @ centroid_tip
    shifts = observations.centroids_tracker - T_base_tracker.inv() @ centroids_base
    return np.concatenate((turns, shifts), axis=1)


def jacobians(
    observations: Observations,
    T_base_tracker: Pose,
    T_toolmarker_tip: Pose,
    turns: Floats,
    center_base: Floats,
) -> Floats:
    """Return the derivatives (n, 6, 12) of the residuals.

    The columns are the deviation of ``T_base_tracker`` turned about ``center_base`` instead of the
    tracker (which keeps the equations well conditioned), then that of ``T_toolmarker_tip``.
    """
    n = len(observations)
    R_tracker_base = T_base_tracker.rotation.T
    R_expected = R_tracker_base @ observations.Ts_base_tip.rotations @ T_toolmarker_tip.rotation.T
    inverse = _inverse_right_jacobians(turns)
    lever_toolmarker = observations.centroid_toolmarker - T_toolmarker_tip.translation
    centroid_tip = T_toolmarker_tip.rotation.T @ lever_toolmarker
    levers_base = observations.Ts_base_tip @ centroid_tip - center_base
    J = np.zeros((n, 6, 12))
    J[:, :3, :3] = inverse @ R_tracker_base
    J[:, :3, 6:9] = inverse @ R_expected
    J[:, 3:, :3] = -R_tracker_base @ cross_matrices(levers_base)
    J[:, 3:, 3:6] = R_tracker_base
    J[:, 3:, 6:9] = -R_expected @ cross_matrices(lever_toolmarker)
    J[:, 3:, 9:] = R_expected
    return J


def moved(
    T_base_tracker: Pose, T_toolmarker_tip: Pose, step: Floats, center_base: Floats
) -> tuple[Pose, Pose]:
    """Return both poses after a step (12,) in the tangent of ``jacobians``."""
    turn = Rotation.from_rotvec(step[:3]).as_matrix()
    R_base_tracker = turn @ T_base_tracker.rotation
    arm = turn @ (T_base_tracker.translation - center_base)
    turned = Rotation.from_rotvec(step[6:9]).as_matrix() @ T_toolmarker_tip.rotation
    return (
        Pose(R_base_tracker, center_base + arm + step[3:6]),
        Pose(turned, T_toolmarker_tip.translation + step[9:]),
    )


def tangent_at_tracker(T_base_tracker: Pose, center_base: Floats) -> Floats:
    """Return the matrix (12, 12) from the tangent of ``jacobians`` to that of pose_covariance."""
    change = np.eye(12)
    change[3:6, :3] = -cross_matrices(T_base_tracker.translation - center_base)
    return change


def robot_covariances(
    observations: Observations, T_base_tracker: Pose, T_toolmarker_tip: Pose
) -> Floats:
    """Return what the robot's own error adds to the residuals: covariances (n, 6, 6)."""
    centroid_tip = T_toolmarker_tip.inv() @ observations.centroid_toolmarker
    levers = observations.Ts_base_tip.rotations @ centroid_tip @ T_base_tracker.rotation
    crossed = cross_matrices(levers)
    tip_mm2, turn_rad2 = observations.robot_variances
    covariances = np.zeros((len(observations), 6, 6))
    covariances[:, :3, :3] = turn_rad2 * np.eye(3)
    covariances[:, :3, 3:] = turn_rad2 * crossed
    covariances[:, 3:, :3] = -turn_rad2 * crossed
    covariances[:, 3:, 3:] = tip_mm2 * np.eye(3) - turn_rad2 * crossed @ crossed
    return covariances


def _inverse_right_jacobians(turns: Floats) -> Floats:
    """Return d Log(Exp(a) Exp(d)) / d d at d = 0 for rotation vectors a (n, 3)."""
    crossed = cross_matrices(turns)
    angle = np.linalg.norm(turns, axis=1)
    safe = np.where(angle > SERIES, angle, 1.0)
    exact = 1.0 / safe**2 - 1.0 / (2.0 * safe * np.tan(safe / 2.0))
    factor = np.where(angle > SERIES, exact, 1.0 / 12.0)
    return np.eye(3) + crossed / 2.0 + factor[:, None, None] * (crossed @ crossed)


@dataclass(frozen=True, slots=True, eq=False)
class Spectrum:
    """Squared distances of the poses as a function of the marker error sigma, 1D per component.

    With marker covariance s^2 M = s^2 L L', robot covariance C and L^-1 C L'^-1 = U diag(d) U',
    e' (s^2 M + C)^-1 e = sum z^2 / (s^2 + d) with z = U' L^-1 e.
    """

    squares: Floats  # (n, 6) z^2
    robot: Floats  # (n, 6) d

    def distances(self, sigma_mm: float) -> Floats:
        """Return the squared distances (n,) for a marker error of ``sigma_mm``."""
        return (self.squares / (sigma_mm**2 + self.robot)).sum(axis=1)


def spectrum(residuals: Floats, unit_covariances: Floats, robot_covariances: Floats) -> Spectrum:
    """Return the spectrum of residuals (n, 6) with covariances (n, 6, 6) of marker and robot."""
    inverse = np.linalg.inv(np.linalg.cholesky(unit_covariances))
    whitened = inverse @ robot_covariances @ np.swapaxes(inverse, 1, 2)
    values, vectors = np.linalg.eigh((whitened + np.swapaxes(whitened, 1, 2)) / 2.0)
    z = np.einsum("nji,njk,nk->ni", vectors, inverse, residuals)
    return Spectrum(z**2, np.maximum(values, 0.0))


def sigma_by_median(spectrum: Spectrum) -> float:
    """Return the marker error that gives the median pose the distance it should have."""

    def excess(sigma_mm: float) -> float:
        return float(np.median(spectrum.distances(sigma_mm))) - MEDIAN

    return _root(excess)


def sigma_by_mean(spectrum: Spectrum, used: Bools, unknowns: int) -> float:
    """Return the marker error with which the poses used leave what their number allows."""
    degrees = DOF * int(used.sum()) - unknowns
    squares, robot = spectrum.squares[used], spectrum.robot[used]

    def excess(sigma_mm: float) -> float:
        return float((squares / (sigma_mm**2 + robot)).sum()) - degrees

    return _root(excess)


def _root(excess: Callable[[float], float]) -> float:
    """Return where a decreasing function of sigma crosses zero, within floor and ceiling."""
    low, high = np.log(FLOOR_MM), np.log(CEILING_MM)
    for _ in range(BISECTIONS):
        middle = (low + high) / 2.0
        if excess(float(np.exp(middle))) > 0.0:
            low = middle
        else:
            high = middle
    return float(np.exp(low)) if low > np.log(FLOOR_MM) else FLOOR_MM


SUBSET = 5
N_SUBSETS = 60
SEED = 20070410
LEVER_MM = 150.0  # turns an angle into a distance when poses are ranked
RIDGE = 1e-12  # relative; keeps a subset without rotation solvable, it loses the ranking


def first_guess(Ts_base_tip: Poses, Ts_tracker_toolmarker: Poses) -> tuple[Pose, Pose]:
    """Return ``T_base_tracker`` and ``T_toolmarker_tip``, good to a few millimetres.

    Args:
        Ts_base_tip: Tool tip as the robot knows it, n poses.
        Ts_tracker_toolmarker: Tool marker as the tracker sees it, the same n poses.
    """
    n = len(Ts_base_tip)
    found: list[tuple[float, Pose, Pose]] = []
    for rows in (np.arange(n)[None], _subsets(n)):
        R_base_tracker, R_toolmarker_tip = _rotations(Ts_base_tip, Ts_tracker_toolmarker, rows)
        tips, origins = _translations(Ts_base_tip, Ts_tracker_toolmarker, rows, R_base_tracker)
        errors = _errors_mm(
            Ts_base_tip, Ts_tracker_toolmarker, R_base_tracker, R_toolmarker_tip, tips, origins
        )
        medians = np.median(errors, axis=1)
        i = int(np.argmin(medians))
        T_base_tracker = Pose(R_base_tracker[i].copy(), origins[i].copy())
        T_toolmarker_tip = Pose(R_toolmarker_tip[i].copy(), tips[i].copy())
        found.append((float(medians[i]), T_base_tracker, T_toolmarker_tip))
    _, T_base_tracker, T_toolmarker_tip = min(found, key=lambda one: one[0])
    return T_base_tracker, T_toolmarker_tip


def _subsets(n: int) -> Ints:
    """Return rows (N_SUBSETS, SUBSET) of the poses to be solved together; the same every time."""
    rng = np.random.default_rng(SEED)
    return np.argsort(rng.random((N_SUBSETS, n)), axis=1)[:, : min(SUBSET, n)]


def _rotations(
    Ts_base_tip: Poses, Ts_tracker_toolmarker: Poses, rows: Ints
) -> tuple[Floats, Floats]:
    """Return tracker -> base and tip -> toolmarker (k, 3, 3) for each subset (k, m)."""
    B, M = Ts_base_tip.rotations[rows], Ts_tracker_toolmarker.rotations[rows]
    K = np.einsum("kmad,kmbc->kabdc", M, B).reshape(len(rows), 9, 9)
    u, _, vt = np.linalg.svd(K)
    Q = u[:, :, 0].reshape(-1, 3, 3)
    P = vt[:, 0, :].reshape(-1, 3, 3)
    sign = np.where(np.linalg.det(Q) < 0.0, -1.0, 1.0)[:, None, None]
    return np.swapaxes(_nearest_rotations(sign * Q), 1, 2), _nearest_rotations(sign * P)


def _nearest_rotations(matrices: Floats) -> Floats:
    u, _, vt = np.linalg.svd(matrices)
    u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]
    return u @ vt


def _translations(
    Ts_base_tip: Poses, Ts_tracker_toolmarker: Poses, rows: Ints, R_base_tracker: Floats
) -> tuple[Floats, Floats]:
    """Return tip in toolmarker and tracker in base (k, 3) for each subset."""
    M, t = Ts_tracker_toolmarker.rotations[rows], Ts_tracker_toolmarker.translations[rows]
    tips_base = Ts_base_tip.translations[rows]
    wanted = np.einsum("kji,kmj->kmi", R_base_tracker, tips_base) - t  # = M x + origin, in tracker
    design = M - M.mean(axis=1, keepdims=True)
    centred = wanted - wanted.mean(axis=1, keepdims=True)
    normal = np.einsum("kmji,kmjl->kil", design, design)
    ridge = RIDGE * rows.shape[1] * np.eye(3)
    right = np.einsum("kmji,kmj->ki", design, centred)
    tips = np.linalg.solve(normal + ridge, right[..., None])[..., 0]
    offsets = tips_base - np.einsum(
        "kij,kmj->kmi", R_base_tracker, np.einsum("kmij,kj->kmi", M, tips) + t
    )
    return tips, offsets.mean(axis=1)


def _errors_mm(
    Ts_base_tip: Poses,
    Ts_tracker_toolmarker: Poses,
    R_base_tracker: Floats,
    R_toolmarker_tip: Floats,
    tips_toolmarker: Floats,
    origins_base: Floats,
) -> Floats:
    """Return how far each pose (n) is off by each solution (k): (k, n), turns at a lever."""
    M, t = Ts_tracker_toolmarker.rotations, Ts_tracker_toolmarker.translations
    seen = np.einsum("nij,kj->kni", M, tips_toolmarker) + t
    placed = np.einsum("kij,knj->kni", R_base_tracker, seen) + origins_base[:, None]
    shift = np.linalg.norm(placed - Ts_base_tip.translations, axis=2)
    turned = R_base_tracker[:, None] @ M @ R_toolmarker_tip[:, None]
    apart = np.swapaxes(Ts_base_tip.rotations, 1, 2) @ turned
    angles = np.linalg.norm(rotation_vectors(apart.reshape(-1, 3, 3)), axis=1)
    return np.hypot(shift, LEVER_MM * angles.reshape(shift.shape))


UNKNOWNS = 12
MIN_POSES = 4
MIN_SHARE = 0.6  # of the poses that must agree
MAX_SIGMA_MM = 5.0  # of a marker; ten times that of a poor tracker
MAX_STEPS = 50
SETTLE_STEPS = 20  # after these the choice of poses stays
STEP_TOLERANCE = 1e-12  # of turns in rad, and of shifts in metres
MM_PER_RAD = 1e3
TURNS = np.tile(np.repeat((True, False), 3), 2)
MIN_WIDTH = 0.01  # width over length of the marker plate
TOOL_MARKERS = GEOMETRIES["toolmarker"].positions_marker
TYPICAL = MarkerNoise()


@dataclass(frozen=True, slots=True, eq=False)
class HandEyeFit:
    """Tracker in ``base`` and tip in ``toolmarker``, with the errors they share.

    ``covariance`` is that of the deviation (12,): of ``T_base_tracker``, then of
    ``T_toolmarker_tip``, each (rx, ry, rz, tx, ty, tz) in rad and mm, see
    geometry/pose_covariance.py.
    """

    T_base_tracker: Pose
    T_toolmarker_tip: Pose
    covariance: Floats  # (12, 12)
    center_base: Floats  # (3,) mean of the robot's tip positions that were used
    marker_sigma_mm: float  # 3D RMS error of one marker, estimated from the residuals
    chi_square: (
        float  # over its degrees of freedom: 1, or less where the robot errs less than assumed
    )
    residuals: Floats  # (n, 6) measured minus expected marker pose in tracker: rad, mm of centroid
    distances: Floats  # (n,) size of these in deviations, as the model expects them
    used: Bools  # (n,) False for gross errors

    @property
    def rejected(self) -> tuple[int, ...]:
        """Return the numbers of the poses that were dropped."""
        return tuple(int(i) for i in np.flatnonzero(~self.used))


def solve_hand_eye(
    Ts_base_tip: Poses,
    Ts_tracker_toolmarker: Poses,
    *,
    positions_toolmarker: ArrayLike = TOOL_MARKERS,
    noise: MarkerNoise = TYPICAL,
) -> HandEyeFit:
    """Return tracker in ``base`` and tip in ``toolmarker`` from poses seen by both.

    Args:
        Ts_base_tip: Tool tip as the robot knows it, n >= 4 poses with turns about two axes.
        Ts_tracker_toolmarker: Tool marker as the tracker sees it, the same n poses.
        positions_toolmarker: Markers (m, 3), m >= 3, not on one line.
        noise: Of one marker; its size is taken from the residuals.

    Raises:
        InvalidInputError: different numbers of poses, or too few.
        DegenerateGeometryError: the tool stood still or turned about one axis only (the message
            names what stays open), or fewer than 60 % of the poses agree.
    """
    n = len(Ts_base_tip)
    if len(Ts_tracker_toolmarker) != n:
        raise InvalidInputError(
            f"robot and tracker must have as many poses: {n} and {len(Ts_tracker_toolmarker)}"
        )
    if n < MIN_POSES:
        raise InvalidInputError(f"a registration needs at least {MIN_POSES} poses, not {n}")
    positions = _as_markers(positions_toolmarker)
    require_two_axes(Ts_base_tip.rotations, Ts_tracker_toolmarker.rotations)
    observations = observe(Ts_base_tip, Ts_tracker_toolmarker, positions, noise)
    return refine(observations, *first_guess(Ts_base_tip, Ts_tracker_toolmarker))


def refine(observations: Observations, T_base_tracker: Pose, T_toolmarker_tip: Pose) -> HandEyeFit:
    """Iterate weights, choice of poses and both unknowns until none of them changes."""
    used = np.ones(len(observations), dtype=np.bool_)
    for step in range(MAX_STEPS):
        e = residuals(observations, T_base_tracker, T_toolmarker_tip)
        robot = robot_covariances(observations, T_base_tracker, T_toolmarker_tip)
        sizes = spectrum(e, observations.unit_covariances, robot)
        before = used
        if step < SETTLE_STEPS:
            # the unknowns take their share of what is left over
            rough = sigma_by_median(sizes) / np.sqrt(1.0 - UNKNOWNS / (DOF * len(observations)))
            used = sizes.distances(rough) <= observations.gross
            _require_agreement(used)
        sigma = sigma_by_mean(sizes, used, UNKNOWNS)
        center = observations.Ts_base_tip.translations[used].mean(axis=0)
        J = jacobians(observations, T_base_tracker, T_toolmarker_tip, e[:, :3], center)[used]
        weighted = np.linalg.inv(sigma**2 * observations.unit_covariances + robot)[used] @ J
        information = np.einsum("nij,nik->jk", J, weighted)
        change = -np.linalg.solve(information, np.einsum("nij,ni->j", weighted, e[used]))
        size = max(np.abs(change[TURNS]).max(), np.abs(change[~TURNS]).max() / MM_PER_RAD)
        if size < STEP_TOLERANCE and np.array_equal(before, used):
            break
        T_base_tracker, T_toolmarker_tip = moved(T_base_tracker, T_toolmarker_tip, change, center)
    else:
        raise DegenerateGeometryError(
            "robot and tracker find no registration that stays: the poses tell too little"
        )
    distances = sizes.distances(sigma)
    chi_square = float(distances[used].sum() / (DOF * used.sum() - UNKNOWNS))
    _require_belief(sigma * np.sqrt(max(1.0, chi_square)))
    change = tangent_at_tracker(T_base_tracker, center)
    covariance = chi_square * change @ np.linalg.inv(information) @ change.T
    return HandEyeFit(
        T_base_tracker=T_base_tracker,
        T_toolmarker_tip=T_toolmarker_tip,
        covariance=readonly((covariance + covariance.T) / 2.0),
        center_base=readonly(center),
        marker_sigma_mm=float(sigma),
        chi_square=chi_square,
        residuals=readonly(e),
        distances=readonly(np.sqrt(distances)),
        used=readonly(used),
    )


def _require_agreement(used: Bools) -> None:
    if used.sum() < max(MIN_POSES, MIN_SHARE * len(used)):
        raise DegenerateGeometryError(
            f"only {int(used.sum())} of {len(used)} poses agree on where the tracker and the tip "
            "are: the marker or the tracker has moved, or another tool was tracked"
        )


def _require_belief(sigma_mm: float) -> None:
    if sigma_mm > MAX_SIGMA_MM:
        raise DegenerateGeometryError(
            f"robot and tracker do not agree: single markers would be off by {sigma_mm:.1f} mm; "
            "the marker or the tracker has moved, or the two were not read at the same time"
        )


def _as_markers(positions_toolmarker: ArrayLike) -> Floats:
    """Return the markers (m, 3) after checking that they determine a turn."""
    positions = as_points(positions_toolmarker, at_least=3, name="positions_toolmarker")
    spread = np.linalg.svd(positions - positions.mean(axis=0), compute_uv=False)
    if spread[1] <= MIN_WIDTH * spread[0]:
        raise DegenerateGeometryError("the markers lie on one line: the turn about it is unseen")
    return positions
