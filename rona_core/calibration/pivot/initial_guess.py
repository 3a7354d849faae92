"""Robust initial guess of tip and pivot by linear least squares.

Every pose says R tip - pivot = -p, three equations that are linear in the unknowns.
"""

import numpy as np

from rona_core.geometry.arrays import Bools, Floats

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
