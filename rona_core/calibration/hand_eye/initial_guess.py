"""Initial guess of the hand-eye poses, robust against up to a third of wrong poses.

Small subsets of the poses are solved in closed form, and the solution with the least median error
over all poses wins (least median of squares). The closed form for the rotations is that of
Shah 2013: Q B_i = M_i P summed over the poses is a 9 x 9 matrix whose first singular vectors are
the two rotations. With them, tip and tracker position are a linear least-squares problem.
"""

import numpy as np

from rona_core.geometry.arrays import Floats, Ints
from rona_core.geometry.pose import Pose, Poses
from rona_core.geometry.pose_covariance import rotation_vectors

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
