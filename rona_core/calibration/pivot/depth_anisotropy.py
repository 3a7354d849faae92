"""Ratio of depth error to lateral error of a tracker, estimated from marker residuals."""

import numpy as np
from numpy.typing import ArrayLike

from rona_core.calibration.tracking_error.marker_noise import MarkerNoise
from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.pose import Poses

MAX_FRAMES = 400  # more tell no more
MAX_RATIO = 6.0
MIN_FREEDOM = 60.0  # residual degrees of freedom in depth below which nothing is claimed


def estimate_marker_noise(
    points_tracker: ArrayLike, seen: Bools, Ts_tracker_marker: Poses, positions_marker: Floats
) -> MarkerNoise:
    """Return the noise whose depth ratio explains how far markers lie from their fitted bodies.

    The fit takes a part of every error away, another one along each axis. What it leaves of white
    errors with variances (a, a, b) along tracker x, y, z is linear in a and b, so the mean squares
    that were found, across and in depth, determine both.

    Args:
        points_tracker: Measured markers (n, m, 3); values of unseen ones are ignored.
        seen: (n, m) which were seen; frames that saw all of them are used.
        Ts_tracker_marker: Poses fitted to them by unweighted least squares.
        positions_marker: Marker geometry (m, 3).
    """
    rows = np.flatnonzero(seen.all(axis=1))
    rows = rows[:: max(len(rows) // MAX_FRAMES, 1)]
    if not len(rows):
        return MarkerNoise(depth_ratio=1.0)
    poses = Ts_tracker_marker.select(rows)
    turned = np.einsum("nij,mj->nmi", poses.rotations, positions_marker)
    residuals = np.asarray(points_tracker, dtype=np.float64)[rows] - turned
    residuals = residuals - poses.translations[:, None]
    projection = _left_over(turned)
    n, m = residuals.shape[:2]
    shares = (projection**2).reshape(n, m, 3, m, 3).sum(axis=(0, 1, 3))  # (found axis, true axis)
    model = np.array(
        (
            (shares[:2, :2].sum(), shares[:2, 2].sum()),
            (shares[2, :2].sum(), shares[2, 2]),
        )
    )
    mean_squares = (residuals**2).sum(axis=(0, 1))
    if shares[2, 2] < MIN_FREEDOM or shares[:2, :2].sum() < MIN_FREEDOM:
        return MarkerNoise(depth_ratio=1.0)
    across, depth = np.linalg.solve(model, (mean_squares[0] + mean_squares[1], mean_squares[2]))
    if across <= 0.0 or depth <= 0.0:
        return MarkerNoise(depth_ratio=MAX_RATIO if across <= 0.0 < depth else 1.0)
    return MarkerNoise(depth_ratio=float(np.clip(np.sqrt(depth / across), 1.0, MAX_RATIO)))


def _left_over(turned: Floats) -> Floats:
    """Return the projection (n, 3m, 3m) of marker errors onto what a rigid fit cannot take away."""
    n, m = turned.shape[:2]
    arms = turned - turned.mean(axis=1, keepdims=True)
    x, y, z = np.moveaxis(arms, 2, 0)
    zero = np.zeros_like(x)
    crosses = np.stack((zero, z, -y, -z, zero, x, y, -x, zero), axis=2).reshape(n, m, 3, 3)
    shifts = np.broadcast_to(np.eye(3), (n, m, 3, 3))
    moves = np.concatenate((crosses, shifts), axis=3).reshape(n, 3 * m, 6)
    basis = np.linalg.svd(moves, full_matrices=False)[0]
    taken = np.ones(6)[None, None]
    if np.linalg.svd(moves[0], compute_uv=False)[-1] < 1e-9 * np.abs(moves[0]).max():
        taken = np.array((1.0, 1.0, 1.0, 1.0, 1.0, 0.0))[None, None]  # markers on a line
    return np.eye(3 * m) - (basis * taken) @ np.swapaxes(basis, 1, 2)
