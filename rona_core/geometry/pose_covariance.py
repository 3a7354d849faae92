"""Covariance of poses: small deviations in the tangent space, and how they map.

A deviation is (rx, ry, rz, tx, ty, tz): the rotation vector (rad) and the shift (mm), both along
the axes of the left frame. ``T_a_b`` deviates to R = Exp(r) R, t = t + s, so that a point moves by

    d p_a = r x (R p_b) + s
"""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, as_floats, as_points, dots
from rona_core.geometry.pose import Pose

TINY = 1e-300
SYMMETRY = 1e-6  # relative; a covariance less symmetric than this, or less positive, is refused


def cross_matrices(vectors: Floats) -> Floats:
    """Return the matrices (..., 3, 3) with ``cross_matrices(a) @ b == cross(a, b)``."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    rows = ((zero, -z, y), (z, zero, -x), (-y, x, zero))
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rotation_vectors(rotations: Floats) -> Floats:
    """Return the rotation vectors (n, 3) in radians of rotations (n, 3, 3)."""
    across = 0.5 * (rotations - np.swapaxes(rotations, 1, 2))
    vectors = np.stack((across[:, 2, 1], across[:, 0, 2], across[:, 1, 0]), axis=1)
    sines = np.sqrt(dots(vectors, vectors))
    cosines = 0.5 * (np.trace(rotations, axis1=1, axis2=2) - 1.0)
    angles = np.arctan2(sines, cosines)
    vectors *= np.where(sines > TINY, angles / np.maximum(sines, TINY), 1.0)[:, None]
    wide = cosines < 0.0  # towards half a turn the sines vanish
    if wide.any():
        vectors[wide] = Rotation.from_matrix(rotations[wide]).as_rotvec()
    return vectors


def deviate(T_a_b: Pose, deviation: ArrayLike) -> Pose:
    """Return the pose after a deviation (6,)."""
    d = as_floats(deviation, name="deviation")
    turn = Rotation.from_rotvec(d[:3]).as_matrix()
    return Pose(turn @ T_a_b.rotation, T_a_b.translation + d[3:])


def deviation_between(T_a_b: Pose, T_a_b_other: Pose) -> Floats:
    """Return the deviation (6,) that leads from the first pose to the other one."""
    turn = Rotation.from_matrix(T_a_b_other.rotation @ T_a_b.rotation.T).as_rotvec()
    return np.concatenate((turn, T_a_b_other.translation - T_a_b.translation))


def point_jacobians(
    T_a_b: Pose, points: ArrayLike, *, direction: Literal["forward", "backward"] = "forward"
) -> Floats:
    """Return how mapped points move with a deviation of the pose: (n, 3, 6).

    Args:
        T_a_b: The pose that deviates.
        points: Places (n, 3) before they are mapped: in b if forward, in a if backward.
        direction: "forward" maps points of b into a; "backward" maps points of a into b.
    """
    p = as_points(points)
    if direction == "forward":
        turning = -cross_matrices(p @ T_a_b.rotation.T)
        return np.concatenate((turning, np.broadcast_to(np.eye(3), turning.shape)), axis=2)
    turning = cross_matrices(p - T_a_b.translation)
    blocks = np.concatenate((turning, np.broadcast_to(-np.eye(3), turning.shape)), axis=2)
    return T_a_b.rotation.T @ blocks


def as_covariance(covariance: ArrayLike, size: int, *, name: str = "covariance") -> Floats:
    """Return a covariance (size, size), symmetric to the last bit.

    Raises:
        InvalidInputError: wrong shape, not finite, not symmetric, or with a negative variance.
    """
    c = as_floats(covariance, name=name)
    if c.shape != (size, size):
        raise InvalidInputError(f"{name} must have shape ({size}, {size}), not {c.shape}")
    scale = np.sqrt(np.maximum(np.diag(c), 0.0))
    scale = np.where(scale > 0.0, scale, 1.0)
    even = c / np.outer(scale, scale)
    if np.abs(even - even.T).max() > SYMMETRY:
        raise InvalidInputError(f"{name} is not symmetric")
    if np.linalg.eigvalsh((even + even.T) / 2.0)[0] < -SYMMETRY * size:
        raise InvalidInputError(f"{name} has a direction of negative variance")
    return (c + c.T) / 2.0
