"""Effect of repeating marker errors on a pivoted tip, and what the pivot shows of them.

A field of errors that changes under the markers while they swing acts like a change of scale and
shape: a part of it moves the tip and leaves no residual, the rest makes the tip seem to wander.
"""

from dataclasses import dataclass

import numpy as np

from rona_core.calibration.pivot.maximum_likelihood import tip_conditions
from rona_core.calibration.tracker_field import LearnedField
from rona_core.calibration.tracking_error import MarkerNoise, fit_matrices, tracked_from_poses
from rona_core.geometry.arrays import Floats, Ints, Vector3, readonly
from rona_core.geometry.pose import Poses
from rona_core.geometry.pose_covariance import cross_matrices

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
