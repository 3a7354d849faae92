"""Poses from 4 x 4 matrices in files; names each fault with its place and size."""

from collections.abc import Callable

import numpy as np

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.pose import ROTATION_TOLERANCE, Poses

ROUNDING = 1e-3  # R R' may differ from the identity by this: files are printed with few digits
SCALE = 1e-2  # relative; a matrix whose axes agree in length to this is scaled, not sheared
NEAR_MM = 10.0  # no marker stays so close to a tracker: then the unit is metres


def poses_from_matrices(matrices: Floats, where: Callable[[int], str]) -> tuple[Poses, float]:
    """Return the poses of homogeneous matrices (n, 4, 4), and how far they were from rigid.

    Rotations that differ from rigid ones by the rounding of their digits become the nearest rigid
    ones; those that are rigid keep every bit.

    Args:
        matrices: Read row by row.
        where: Says the place of matrix i, for the message.

    Raises:
        InvalidInputError: values not finite, a last row that is not 0 0 0 1 (transposed?), or
            a rotation that is scaled, sheared or left-handed.
    """
    infinite = (~np.isfinite(matrices)).sum(axis=(1, 2)) > 0
    _refuse(infinite, matrices, where, _not_finite)
    last = np.abs(matrices[:, 3] - (0.0, 0.0, 0.0, 1.0)).max(axis=1, initial=0.0)
    _refuse(last > ROTATION_TOLERANCE, matrices, where, _wrong_last_row)
    rotations = matrices[:, :3, :3]
    off = np.abs(rotations @ np.swapaxes(rotations, 1, 2) - np.eye(3)).max(axis=(1, 2), initial=0.0)
    _refuse(off > ROUNDING, matrices, where, _not_rigid)
    _refuse(np.linalg.det(rotations) < 0.0, matrices, where, _left_handed)
    rounded = off > ROTATION_TOLERANCE / 2.0
    if rounded.any():
        u, _, vt = np.linalg.svd(rotations[rounded])
        rotations = rotations.copy()
        rotations[rounded] = u @ vt
    return Poses(rotations.copy(), matrices[:, :3, 3].copy()), float(off.max(initial=0.0))


def require_millimetres(translations: Floats, what: str) -> None:
    """Refuse positions (n, 3) of a marker before a tracker that can only be metres.

    Raises:
        InvalidInputError: none is 10 mm from the origin.
    """
    farthest = float(np.linalg.norm(translations, axis=1).max(initial=0.0))
    if len(translations) and farthest < NEAR_MM:
        raise InvalidInputError(
            f"{what}: no marker is farther than {farthest:.3g} mm from the tracker. Millimetres "
            "are expected, these look like metres: multiply the translations by 1000"
        )


def _refuse(
    bad: Bools, matrices: Floats, where: Callable[[int], str], say: Callable[[Floats], str]
) -> None:
    if bad.any():
        i = int(np.argmax(bad))
        more = int(bad.sum()) - 1
        others = f" (and {more} more)" if more else ""
        raise InvalidInputError(f"{where(i)}: {say(matrices[i])}{others}")


def _not_finite(matrix: Floats) -> str:
    value = matrix[~np.isfinite(matrix)][0]
    return f"expected finite numbers, got {value}; leave out poses that were not seen"


def _wrong_last_row(matrix: Floats) -> str:
    row = " ".join(f"{v:g}" for v in matrix[3])
    column = np.abs(matrix[:, 3] - (0.0, 0.0, 0.0, 1.0)).max()
    if column <= ROTATION_TOLERANCE:
        return (
            f"expected the last row 0 0 0 1, got {row}: the matrix is transposed. Write it row by "
            "row, with the translation in the last column"
        )
    return f"expected the last row 0 0 0 1, got {row}"


def _not_rigid(matrix: Floats) -> str:
    rotation = matrix[:3, :3]
    off = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    lengths = np.linalg.norm(rotation, axis=1)
    scale = float(lengths.mean())
    square = rotation @ rotation.T / max(scale * scale, 1e-300)
    if np.abs(square - np.eye(3)).max() <= SCALE:
        return f"expected a rotation, got one scaled by {scale:.4g}: R R' is off by {off:.2g}"
    return (
        f"expected a rotation, got a matrix whose R R' differs from the identity by {off:.2g} "
        f"({ROUNDING:g} is allowed for rounding)"
    )


def _left_handed(matrix: Floats) -> str:
    determinant = float(np.linalg.det(matrix[:3, :3]))
    return (
        f"expected a right-handed rotation, got a determinant of {determinant:.3g}: one axis is "
        "mirrored"
    )
