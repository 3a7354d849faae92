"""Matrices of files as poses: which stand for none, which are no poses, and rounded digits."""

from collections.abc import Callable

import numpy as np

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.pose import ROTATION_TOLERANCE, ROUNDING, Poses, without_rounding

SCALE = 1e-2  # relative; a matrix whose axes agree in length to this is scaled, not sheared
UNSEEN = 1e20  # larger numbers stand for a marker that was not seen: NDI writes -3.697314E28
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
    rotations, off = without_rounding(matrices[:, :3, :3])
    _refuse(off > ROUNDING, matrices, where, _not_rigid)
    _refuse(np.linalg.det(rotations) < 0.0, matrices, where, _left_handed)
    return Poses(rotations.copy(), matrices[:, :3, 3].copy()), float(off.max(initial=0.0))


def require_millimetres(translations: Floats, what: str) -> None:
    """Refuse positions (n, 3) of a marker before a tracker that can only be metres.

    Raises:
        InvalidInputError: none is 10 mm from the origin.
    """
    farthest = float(np.linalg.norm(translations, axis=1).max(initial=0.0))
    if len(translations) and farthest < NEAR_MM:
        raise InvalidInputError(
            f"{what}: no position is farther than {farthest:.3g} mm from the origin. Millimetres "
            "are expected, these look like metres: multiply the translations by 1000, or say so "
            "(--unit m)"
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


def seen_poses(matrices: Floats) -> Bools:
    """Return which matrices (n, 4, 4) are not what programs write for a marker not seen.

    That is the identity, zeros, NaN in all places, or numbers beyond all measure.
    """
    top = matrices[:, :3].reshape(-1, 12)
    unseen = beyond(top)
    for stand_in in (np.isnan(top), top == 0.0, top == np.eye(4)[:3].ravel()):
        unseen = unseen | stand_in.all(axis=1)
    return np.asarray(~unseen, dtype=np.bool_)


def beyond(values: Floats) -> Bools:
    """Return which rows (n,) have a finite number beyond all measure."""
    far = np.isfinite(values) & (np.abs(values) > UNSEEN)
    return np.asarray(far.any(axis=1), dtype=np.bool_)
