"""Surface registration of digitised points: robust point-to-plane ICP.

Distances to the tangent plane (Chen 1991) let points slide along the surface where that fits
better, which distances to the nearest point hold back. Tukey weights leave gross errors out, and
several starts keep a bad first guess from deciding. What the patch cannot show, as a turn about the
centre of a round patch, appears as a small eigenvalue of the Hessian and is named.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.errors import CancelledError, DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, as_points, as_unit_vectors, readonly
from rona_core.geometry.pose import Pose
from rona_core.geometry.pose_covariance import cross_matrices, point_jacobians
from rona_core.geometry.robust import TUKEY_CUTOFF, mad_sigma, tukey_weights

# Points (n, 3) in the frame of the surface -> their nearest points (n, 3) and unit normals (n, 3).
Closest = Callable[[Floats], tuple[Floats, Floats]]

MIN_POINTS = 12
NEIGHBOURS = 8  # points of a sampled surface that are averaged
SCALE_FLOOR_MM = 1e-6
MAX_STEPS = 60
STEP_MM = 1e-7  # at the typical distance from the middle of the patch
COARSE_POINTS, COARSE_STEPS = 150, 20
START_TURN_RAD, START_SHIFT_MM = np.deg2rad(8.0), 5.0  # of the other starts from the given one
DAMPING = 1e-9  # of the largest eigenvalue
MIN_SHARE = 0.5  # of the points that must have a say
GOOD_MM, WEAK_MM = 0.5, 2.0  # error along the weakest direction of a good and of a usable result
GOOD_NORMALS_DEG = 45.0  # half-angle that the normals should cover


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceRegistration:
    """``T_b_a`` from the points' frame a into the surface's frame b, and what the patch shows."""

    T_b_a: Pose
    covariance: Floats  # (6, 6) of the deviation of T_b_a, as geometry/pose_covariance.py says
    residuals_mm: Floats  # (n,) signed distance of each mapped point from the surface
    weights: Floats  # (n,) 0 for points that were left out, up to 1
    used: Bools  # (n,) weight above 0
    rms_mm: float  # of the residuals, weighted
    sigma_mm: float  # of one distance, robust
    center_b: Floats  # (3,) middle of the patch
    reach_mm: float  # RMS distance of the points from it
    sigmas_mm: Floats  # (6,) predicted error along each direction, worst first
    directions_b: Floats  # (6, 6) rows: turn about the middle times reach, then shift; unit length
    normals_deg: float  # half-angle that the normals cover
    verdict: Literal["good", "weak", "bad"]
    reasons: tuple[str, ...]

    def target_errors_mm(self, targets_a: ArrayLike) -> Floats:
        """Return the expected error (k,), 3D RMS, of mapped places (k, 3)."""
        J = point_jacobians(self.T_b_a, targets_a)
        found = J @ self.covariance @ np.swapaxes(J, 1, 2)
        return np.sqrt(np.trace(found, axis1=1, axis2=2))


def point_surface(points: ArrayLike, normals: ArrayLike) -> Closest:
    """Return a surface given by dense points (n, 3) and unit normals (n, 3)."""
    p, directions = as_points(points, at_least=1), as_unit_vectors(normals, name="normals")
    if len(p) != len(directions):
        raise InvalidInputError(f"{len(p)} points need as many normals, not {len(directions)}")
    tree = KDTree(p)
    k = min(NEIGHBOURS, len(p))

    def closest(queries: Floats) -> tuple[Floats, Floats]:
        # smooth means over neighbours: the normal of the nearest point alone jumps from point to
        # point, which looks like relief where there is none
        apart, rows = (np.reshape(x, (len(queries), k)) for x in tree.query(queries, k=k))
        width = apart[:, k // 2, None] + 1e-9
        weights = np.exp(-((apart / width) ** 2))
        weights /= weights.sum(axis=1)[:, None]
        n = np.einsum("nk,nki->ni", weights, directions[rows])
        n /= np.maximum(np.linalg.norm(n, axis=1), 1e-9)[:, None]
        heights = np.einsum("nki,nki->nk", queries[:, None] - p[rows], directions[rows])
        return queries - (weights * heights).sum(axis=1)[:, None] * n, n

    return closest


def register_surface(
    points_a: ArrayLike,
    surface: Closest,
    *,
    start: Pose,
    n_starts: int = 9,
    cancel: Cancel = never,
    progress: Progress = silent,
) -> SurfaceRegistration:
    """Return ``T_b_a`` that lays digitised points onto a surface.

    Args:
        points_a: Digitised points (n, 3), mm, n >= 12.
        surface: Nearest point and normal on the surface in frame ``b``; see ``point_surface``.
        start: First guess of ``T_b_a``, within about 10 degrees and 10 mm at the patch.
        n_starts: Starts about the first guess, 1 to 27: as given, then turned and shifted.
        cancel: Asked between steps.
        progress: Receives the share that is done, 0 to 1.

    Raises:
        InvalidInputError: wrong shapes, or too few points.
        DegenerateGeometryError: the points lie in one place, or most of them off the surface.
        CancelledError: ``cancel`` returned True.
    """
    a = as_points(points_a, at_least=MIN_POINTS, name="points_a")
    if not 1 <= n_starts <= 27:
        raise InvalidInputError(f"n_starts must be 1 to 27, not {n_starts}")
    reach_mm = float(np.sqrt(((a - a.mean(axis=0)) ** 2).sum(axis=1).mean()))
    if reach_mm < 1.0:
        raise DegenerateGeometryError(
            f"the {len(a)} points lie within {reach_mm:.2g} mm: touch the bone in many places"
        )
    some = a[:: max(1, len(a) // COARSE_POINTS)] if n_starts > 1 else a
    tried: list[tuple[float, Pose]] = []
    for i, T_b_a in enumerate(_starts(start, a.mean(axis=0), n_starts)):
        found = _descend(some, surface, T_b_a, reach_mm, COARSE_STEPS, cancel)
        distances, _, _ = _linearise(some, surface, found, reach_mm)
        tried.append((float(np.median(np.abs(distances))), found))
        progress((i + 1) / (n_starts + 1))
    best = min(tried, key=lambda one: one[0])[1]
    T_b_a = _descend(a, surface, best, reach_mm, MAX_STEPS, cancel)
    progress(1.0)
    return _assemble(a, surface, T_b_a, reach_mm)


def _starts(start: Pose, center_a: Floats, n_starts: int) -> list[Pose]:
    """Return the given start and others: turned about the middle of the patch, and shifted."""
    center_b = start @ center_a
    rng = np.random.default_rng(20070412)
    found = [start]
    for turn, shift in zip(
        rng.normal(size=(n_starts - 1, 3)), rng.normal(size=(n_starts - 1, 3)), strict=True
    ):
        R = Rotation.from_rotvec(START_TURN_RAD * turn / np.linalg.norm(turn)).as_matrix()
        moved = center_b + START_SHIFT_MM * shift / np.linalg.norm(shift)
        found.append(Pose(R @ start.rotation, moved + R @ (start.translation - center_b)))
    return found


def _descend(
    a: Floats, surface: Closest, T_b_a: Pose, reach_mm: float, steps: int, cancel: Cancel
) -> Pose:
    """Return the pose after iteratively reweighted Gauss-Newton steps."""
    for _ in range(steps):
        if cancel():
            raise CancelledError("the registration of the surface was cancelled")
        distances, J, center = _linearise(a, surface, T_b_a, reach_mm)
        sigma_mm = mad_sigma(distances, floor=SCALE_FLOOR_MM)
        weights = tukey_weights(distances / sigma_mm, TUKEY_CUTOFF)
        hessian = J.T @ (weights[:, None] * J)
        damping = DAMPING * np.trace(hessian) * np.eye(6)
        step = -np.linalg.solve(hessian + damping, J.T @ (weights * distances))
        turn = Rotation.from_rotvec(step[:3] / reach_mm).as_matrix()
        moved = center + step[3:] + turn @ (T_b_a.translation - center)
        T_b_a = Pose(turn @ T_b_a.rotation, moved)
        if np.linalg.norm(step) < STEP_MM:
            break
    return T_b_a


def _linearise(
    a: Floats, surface: Closest, T_b_a: Pose, reach_mm: float
) -> tuple[Floats, Floats, Floats]:
    """Return distances (n,), derivatives (n, 6) by turn times reach and shift, and the middle."""
    p = T_b_a @ a
    feet, normals = surface(p)
    center = p.mean(axis=0)
    distances = ((p - feet) * normals).sum(axis=1)
    return distances, np.hstack((np.cross(p - center, normals) / reach_mm, normals)), center


def _assemble(a: Floats, surface: Closest, T_b_a: Pose, reach_mm: float) -> SurfaceRegistration:
    distances, J, center = _linearise(a, surface, T_b_a, reach_mm)
    scale = mad_sigma(distances, floor=SCALE_FLOOR_MM)
    weights = tukey_weights(distances / scale, TUKEY_CUTOFF)
    used = weights > 0.0
    if used.mean() < MIN_SHARE:
        raise DegenerateGeometryError(
            f"only {int(used.sum())} of {len(a)} points lie on the surface: give a better start"
        )
    # variance of an M-estimate (Huber): E psi^2 / (E psi')^2 (J'J)^-1
    u = (distances / scale / TUKEY_CUTOFF) ** 2
    slopes = np.where(used, (1.0 - u) * (1.0 - 5.0 * u), 0.0)
    psi = weights * distances
    variance = float((psi**2).sum() / (len(a) - 6) / slopes.mean() ** 2)
    values, vectors = np.linalg.eigh(J.T @ J)
    floor = DAMPING * values[-1]
    sigmas = np.sqrt(variance / np.maximum(values, floor))
    spread = (vectors * sigmas**2) @ vectors.T
    change = np.diag(np.repeat((1.0 / reach_mm, 1.0), 3))
    shift = np.eye(6)
    shift[3:, :3] = -cross_matrices(T_b_a.translation - center)
    covariance = shift @ change @ spread @ change @ shift.T
    normals = J[used, 3:]
    mean = normals.mean(axis=0)
    angles = np.arctan2(np.linalg.norm(np.cross(normals, mean), axis=1), normals @ mean)
    normals_deg = float(np.rad2deg(np.quantile(angles, 0.98)))
    verdict, reasons = _judge(sigmas, vectors[:, 0], normals_deg, used)
    return SurfaceRegistration(
        T_b_a=T_b_a,
        covariance=readonly((covariance + covariance.T) / 2.0),
        residuals_mm=readonly(distances),
        weights=readonly(weights),
        used=readonly(used),
        rms_mm=float(np.sqrt((weights * distances**2).sum() / weights.sum())),
        sigma_mm=scale,
        center_b=readonly(center),
        reach_mm=reach_mm,
        sigmas_mm=readonly(sigmas),
        directions_b=readonly(vectors.T.copy()),
        normals_deg=normals_deg,
        verdict=verdict,
        reasons=reasons,
    )


def _judge(
    sigmas_mm: Floats, weakest: Floats, normals_deg: float, used: Bools
) -> tuple[Literal["good", "weak", "bad"], tuple[str, ...]]:
    """Return the verdict and its reasons, each with a remedy."""
    reasons: list[str] = []
    if sigmas_mm[0] > GOOD_MM or normals_deg < GOOD_NORMALS_DEG:
        turn, shift = np.linalg.norm(weakest[:3]), np.linalg.norm(weakest[3:])
        kind, part = ("turn about", weakest[:3]) if turn >= shift else ("shift along", weakest[3:])
        x, y, z = part / np.linalg.norm(part)
        reasons.append(
            f"a {kind} ({x:.2f}, {y:.2f}, {z:.2f}) is expected to be off by {sigmas_mm[0]:.2f} mm "
            f"within the patch: its normals cover {normals_deg:.0f} degrees half-angle, and so "
            "small a patch of a round bone is nearly a piece of a sphere; touch it farther apart, "
            "on sides that face elsewhere"
        )
    if used.mean() < 0.9:
        reasons.append(
            f"{int((~used).sum())} of {len(used)} points lie off the surface: look for soft tissue "
            "under the pointer, or another specimen"
        )
    if sigmas_mm[0] > WEAK_MM:
        return "bad", tuple(reasons)
    return ("weak" if reasons else "good"), tuple(reasons)
